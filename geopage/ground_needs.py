# SPDX-License-Identifier: Apache-2.0
"""Which terrain the pictures of the next seconds miss, by area.

Where a ray ends, the coarsest cell whose error is small enough there is needed; a picture
is good when at least `GOOD` of its rays have theirs. So what counts is what a person
would see, by area, and not the selection's bound, which must hold for every pixel. Cells
between what is there and what is needed are skipped; all that is needed to leave no gap
beside it is needed, too.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.outlook import COLUMNS, LINES, Ahead, ray_ends
from geopage.terrain_selection import all_uploaded, has_children
from geopage.tree import F8, U1, Tree
from tiles.forest import Rows
from tiles.kernels import kernel

GOOD = 0.96
"""A little more than the 95 % that are asked for."""
COARSER = 4.0
"""Each next goal of a picture allows so many times the error of the one before."""


class Needs(NamedTuple):
    """Which tiles each goal misses."""

    start: NDArray[np.int32]
    """(g + 1,) where each goal's rows begin"""
    rows: Rows
    """missing tiles of one goal after the other"""
    share: NDArray[np.float32]
    """for each of them, the share of the picture's rays below its parent"""
    keep: Rows
    """what is there and is part of a goal"""


class Work(NamedTuple):
    """Room for `ground_needs_of`, over all rows; zeros between two calls."""

    rays: NDArray[np.int32]
    """rays of one picture that need something below a cell"""
    kept: U1


def work_of(tree: Tree) -> Work:
    """Return room for one tree."""
    n = len(tree.parent)
    return Work(np.zeros(n, np.int32), np.zeros(n, np.uint8))


@kernel
def ground_needs_of(
    tree: Tree, uploaded: U1, ahead: Ahead, tau: float, goals: int, work: Work
) -> Needs:
    """Say what pictures ahead miss of being good.

    Parameters
    ----------
    tree, uploaded : the terrain, and (n,) 1 where the tile can be drawn
    ahead : k views
    tau : largest screen error, px
    goals : for each view, the first for `tau`, each next one `COARSER` times as coarse
    work : see `Work`

    Returns
    -------
    Needs of k * goals goals, those of one view together
    """
    along, ends = np.empty(3), np.empty((COLUMNS * LINES, 3))
    opened = np.empty(len(tree.parent), np.int32)
    count = len(ahead.ahead_s)
    start = np.zeros(count * goals + 1, np.int32)
    rows, share = [np.int32(0) for _ in range(0)], [np.float32(0) for _ in range(0)]
    keep = [np.int32(0) for _ in range(0)]
    for k in range(count):
        rays = ray_ends(ahead, k, along, ends)
        limit = tau
        for goal in range(goals):
            if goal and len(rows) == start[k * goals + goal - 1]:
                start[k * goals + goal + 1] = len(rows)  # nothing missing, nor coarser
                continue
            slope = limit / ahead.focal_px
            some = open_cells(tree, ends[:rays], slope, work.rays, opened)
            if goal == 0:
                spare = int(rays * (1.0 - GOOD))
                prune(tree, uploaded, work.rays, opened[:some], spare)
            for i in range(some):
                above = opened[i]
                for j in range(4):
                    row = tree.children[above, j]
                    if work.rays[above] == 0 or work.rays[row] > 0:
                        continue
                    if not is_covered(tree, uploaded, row):
                        rows.append(row)
                        share.append(np.float32(work.rays[above] / max(rays, 1)))
                    elif not work.kept[row]:
                        work.kept[row] = 1
                        keep.append(row)
            work.rays[opened[:some]] = 0
            limit *= COARSER
            start[k * goals + goal + 1] = len(rows)
    kept = np.array(keep, np.int32)
    work.kept[kept] = 0
    return Needs(start, np.array(rows, np.int32), np.array(share, np.float32), kept)


@kernel
def open_cells(
    tree: Tree,
    ends: F8,
    slope: float,
    below: NDArray[np.int32],
    opened: Rows,
) -> int:
    """Walk down to the coarsest cell that is good enough for each ray.

    Parameters
    ----------
    ends : (rays, 3) see `ray_ends`
    slope : largest error over view depth
    below : (n,) receives how many rays go on below each cell
    opened : (n,) receives the cells that some ray goes on below, parents first

    Returns
    -------
    number of opened cells
    """
    count = 0
    cells = 2.0**28 / (math.pi / 4)
    for depth_m, lon, lat in ends:
        line = min(int((lat + math.pi / 2) * cells), 2**30 - 1)
        column = int((lon + math.pi) * cells) & (2**31 - 1)
        row = (line >> 28) * 8 + (column >> 28)
        level = 0
        while tree.error_m[row] > slope * depth_m and has_children(tree, row):
            if below[row] == 0:
                opened[count] = row
                count += 1
            below[row] += 1
            shift = 27 - level
            row = tree.children[row, (line >> shift & 1) * 2 + (column >> shift & 1)]
            level += 1
    return count


@kernel
def is_covered(tree: Tree, uploaded: U1, row: int) -> bool:
    """Say whether the tile, or finer ones up to two levels down, can be drawn."""
    if uploaded[row]:
        return True
    if not has_children(tree, row):
        return False
    for k in range(4):
        child = tree.children[row, k]
        if uploaded[child]:
            continue
        if not has_children(tree, child) or not all_uploaded(tree, child, uploaded):
            return False
    return True


@kernel
def cost_of(tree: Tree, uploaded: U1, below: NDArray[np.int32], row: int) -> int:
    """Return the bytes that opening a cell takes; -1 when a child is open, too."""
    cost = 0
    for k in range(4):
        child = tree.children[row, k]
        if below[child] > 0:
            return -1
        if not is_covered(tree, uploaded, child):
            cost += tree.tile_bytes[child]
    if cost and not is_covered(tree, uploaded, row):
        cost -= tree.tile_bytes[row]
    return max(cost, 0)


@kernel
def prune(
    tree: Tree, uploaded: U1, below: NDArray[np.int32], opened: Rows, spare: int
) -> None:
    """Close the cells that cost most for each ray, as far as few rays need them."""
    cost = np.empty(len(opened))
    for i in range(len(opened)):
        cost[i] = cost_of(tree, uploaded, below, opened[i])
    while spare > 0:
        worst, at = 0.0, -1
        for i in range(len(opened)):
            rays = below[opened[i]]
            if 0 < rays <= spare and cost[i] > worst * rays:
                worst, at = cost[i] / rays, i
        if at < 0:
            return
        closed = opened[at]
        spare -= below[closed]
        below[closed] = 0
        for i in range(at):
            if opened[i] == tree.parent[closed]:
                cost[i] = cost_of(tree, uploaded, below, opened[i])
