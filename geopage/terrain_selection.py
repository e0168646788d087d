# SPDX-License-Identifier: Apache-2.0
"""What terrain one view draws and wants: six named passes over arrays.

refine walks down from the zones to the targets, cells whose screen error is small
enough. cover walks back up and says where the uploaded tiles leave no gap. emit walks
down again and takes the finest tiles without gap or overlap; a coarser tile that is
taken instead of missing ones is a stand-in. rungs chooses the coarsest mesh of a tile
that is good enough. skirts closes the cracks between tiles.
want lists what is missing below the stand-ins and what each missing tile would gain.

A *held* cell lies below a target that is not uploaded: its finer tiles are there from
before, and stay on the screen until the coarser one comes.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.cell_error import error_px_per_m
from geopage.drawn_meshes import COARSEN, rungs, skirts
from geopage.screen_error import Lens, blur_px
from geopage.tree import F4, F8, U1, Tree
from tiles.forest import Rows
from tiles.kernels import kernel

HELD, TARGET, REFINED = 0, 1, 2
JUMP_LEVELS = 3
"""From this many levels below its stand-in on, a target wants cells in between."""
FIRST_GAIN = 1e12
"""Benefit of a zone root: nothing can stand in for it."""


class Plan(NamedTuple):
    """The cells that refine visited, parents before children."""

    rows: Rows
    scale: F8
    """pixels per metre of error in the cell"""
    kind: U1
    """HELD, TARGET or REFINED"""
    below: Rows
    """place of the first of the four children in this plan, -1 where it ends"""
    above: Rows
    """place of the parent in this plan, -1 for roots"""


class Terrain(NamedTuple):
    """What the passes come to."""

    drawn: Rows
    """(d,) rows"""
    rung: U1
    """(d,) the mesh of each that is drawn: 0 the whole one, then its rungs"""
    skirt_m: F4
    """(d,)"""
    stand_in: U1
    """(d,) 1 where the tile is coarser than its target"""
    targets: Rows
    refined: U1
    """(n,) 1 where it went on to the children, 2 and the rung of a drawn tile: `before`
    of the next selection"""
    wanted: Rows
    """(w,) rows"""
    benefit: F8
    error_px: F8


@kernel
def select_terrain(tree: Tree, lens: Lens, tau: float, uploaded: U1, before: U1) -> Terrain:
    """Run the passes, in one call without the GIL; see each for its parameters."""
    plan = refine(tree, lens, tau, uploaded, before)
    _, by_children = cover(plan, uploaded)
    taken, stand = emit(plan, uploaded, by_children)
    drawn = plan.rows[taken]
    wanted, benefit, error_px = want(tree, lens, plan, uploaded, by_children, stand)
    rung, error_m = rungs(tree, lens, tau, drawn, plan.scale[taken], before)
    refined = np.zeros(len(tree.parent), np.uint8)
    refined[plan.rows[plan.below >= 0]] = 1
    refined[drawn] = 2 + rung
    return Terrain(
        drawn,
        rung,
        skirts(tree, drawn, error_m),
        (plan.kind[taken] == REFINED).astype(np.uint8),
        plan.rows[plan.kind == TARGET],
        refined,
        wanted,
        benefit,
        error_px,
    )


@kernel
def refine(tree: Tree, lens: Lens, tau: float, uploaded: U1, before: U1) -> Plan:
    """Walk down until the screen error is at most `tau` pixels.

    Parameters
    ----------
    tree, lens : the terrain and the view
    tau : threshold, px
    uploaded : (n,) 1 where the tile can be drawn
    before : (n,) 1 where the last selection went on to the children, 2 and the rung of
        what it drew
    """
    n = len(tree.parent)
    rows, below, above = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    scale, kind = np.empty(n, np.float64), np.empty(n, np.uint8)
    count = len(tree.roots)
    rows[:count], above[:count], kind[:count] = tree.roots, -1, TARGET
    i = 0
    while i < count:
        row = rows[i]
        c = tree.centre[row]
        scale[i] = error_px_per_m(
            lens, c, tree.radius_m[row], tree.box_m[row], tree.box_rad[row]
        )
        limit = tau
        if lens.sweep.shutter_s > 0.0:
            limit = max(tau, blur_px(lens, c[0], c[1], c[2], tree.radius_m[row]))
        went_on = before[row] == 1
        limit = limit * COARSEN if went_on else limit
        whole = has_children(tree, row)
        demanded = kind[i] == TARGET and whole and tree.error_m[row] * scale[i] > limit
        finer = whole and (went_on or all_uploaded(tree, row, uploaded))
        kept = finer and not uploaded[row]
        below[i] = -1
        if demanded:
            kind[i] = REFINED
        if demanded or kept:
            below[i] = count
            for k in range(4):
                rows[count], above[count] = tree.children[row, k], i
                kind[count] = TARGET if demanded else HELD
                count += 1
        i += 1
    rows, below, above = rows[:count].copy(), below[:count].copy(), above[:count].copy()
    return Plan(rows, scale[:count].copy(), kind[:count].copy(), below, above)


@kernel
def has_children(tree: Tree, row: int) -> bool:
    """Say whether all four children are in the index."""
    kids = tree.children[row]
    return bool(kids[0] >= 0 and kids[1] >= 0 and kids[2] >= 0 and kids[3] >= 0)


@kernel
def all_uploaded(tree: Tree, row: int, uploaded: U1) -> bool:
    """Say whether all four children's tiles can be drawn."""
    kids = tree.children[row]
    first, last = (
        uploaded[kids[0]] and uploaded[kids[1]],
        uploaded[kids[2]] and uploaded[kids[3]],
    )
    return bool(first and last)


@kernel
def cover(plan: Plan, uploaded: U1) -> tuple[U1, U1]:
    """Say where uploaded tiles leave no gap.

    Returns
    -------
    covered : (m,) 1 where the cell itself, or what lies below it, can be drawn
    by_children : (m,) 1 where all four children are covered
    """
    m = len(plan.rows)
    covered, by_children = np.zeros(m, np.uint8), np.zeros(m, np.uint8)
    for i in range(m - 1, -1, -1):
        first = plan.below[i]
        if first >= 0:
            by_children[i] = (
                covered[first]
                and covered[first + 1]
                and covered[first + 2]
                and covered[first + 3]
            )
        covered[i] = uploaded[plan.rows[i]] or by_children[i]
    return covered, by_children


@kernel
def emit(plan: Plan, uploaded: U1, by_children: U1) -> tuple[Rows, Rows]:
    """Take the finest tiles that cover the globe without gap or overlap.

    Returns
    -------
    taken : (d,) places in the plan that are drawn
    stand : (m,) place that is drawn at or above each cell, -1 where none is
    """
    m = len(plan.rows)
    stand, taken = np.empty(m, np.int32), np.empty(m, np.int32)
    count = 0
    for i in range(m):
        stand[i] = stand[plan.above[i]] if plan.above[i] >= 0 else -1
        if stand[i] < 0 and not by_children[i] and uploaded[plan.rows[i]]:
            stand[i] = i
            taken[count] = i
            count += 1
    return taken[:count].copy(), stand


@kernel
def want(
    tree: Tree, lens: Lens, plan: Plan, uploaded: U1, by_children: U1, stand: Rows
) -> tuple[Rows, F8, F8]:
    """List the tiles that are missing, and what each would gain.

    Siblings share the area of their parent: nobody sees one of them before the
    stand-in of all four can go.

    Returns
    -------
    rows : (w,) int32
    benefit : (w,) px of screen error, times px of area, removed for each byte read
    error_px : (w,) screen error of what is drawn there now
    """
    m = len(plan.rows)
    rows = np.empty(m, np.int32)
    benefit, error_px = np.empty(m, np.float64), np.empty(m, np.float64)
    deepest = deepest_levels(tree, plan)
    count = 0
    for i in range(m):
        row, s = plan.rows[i], stand[i]
        if uploaded[row] or plan.kind[i] == HELD:
            continue
        if plan.kind[i] == REFINED and plan.above[i] >= 0:
            if by_children[i] or s < 0:
                continue
            base = tree.level[plan.rows[s]]
            if deepest[i] - base < JUMP_LEVELS or (tree.level[row] - base) % 2:
                continue
        rows[count] = row
        error_px[count] = standing_error_px(tree, lens, plan, s, by_children[i])
        benefit[count] = gain(tree, lens, plan, i, error_px[count])
        count += 1
    return rows[:count].copy(), benefit[:count].copy(), error_px[:count].copy()


@kernel
def deepest_levels(tree: Tree, plan: Plan) -> NDArray[np.int16]:
    """Return the level of the deepest target at or below each cell of the plan."""
    deepest = np.zeros(len(plan.rows), np.int16)
    for i in range(len(plan.rows) - 1, -1, -1):
        if plan.kind[i] == TARGET:
            deepest[i] = tree.level[plan.rows[i]]
        if plan.above[i] >= 0:
            deepest[plan.above[i]] = max(deepest[plan.above[i]], deepest[i])
    return deepest


@kernel
def standing_error_px(tree: Tree, lens: Lens, plan: Plan, s: int, finer: int) -> float:
    """Return the screen error of the stand-in: a picture's side without one."""
    most = lens.width_px + lens.height_px
    if s >= 0:
        return float(min(tree.error_m[plan.rows[s]] * plan.scale[s], most))
    return 0.0 if finer else most


@kernel
def gain(tree: Tree, lens: Lens, plan: Plan, i: int, error_px: float) -> float:
    """Return the benefit of the tile at place `i`, which `error_px` stands in for."""
    row, parent = plan.rows[i], plan.above[i]
    if parent < 0:
        return float(FIRST_GAIN * plan.scale[i])
    reach_px = tree.radius_m[plan.rows[parent]] * plan.scale[parent]
    area_px = min(math.pi * reach_px * reach_px, lens.width_px * lens.height_px)
    left_px = tree.error_m[row] * plan.scale[i]
    return float(max(error_px - left_px, 0.0) * area_px / max(tree.tile_bytes[row], 1))
