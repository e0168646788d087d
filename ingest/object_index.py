# SPDX-License-Identifier: Apache-2.0
"""Index records of the objects lane: what a cell and all below it draw, bounded."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ingest.extrude import Prisms
from ingest.object_tree import Tree
from tiles import cells
from tiles.frames import Ecef, Floats, Ints
from tiles.index_tree import INDEX
from tiles.kernels import kernel

# 16-bit steps move a vertex by at most 2.7e-5 of a tile's reach, float32 rounds a radius.
_MARGIN = 1.0 + 1e-4
_MARGIN_M = 0.01


@dataclass(frozen=True, slots=True)
class Drawn:
    """Things that cells draw, buildings or proxies: their cells and how big they are."""

    cell: Ints
    """(n,) the cell whose tile holds it"""
    centre: Ecef
    """(n, 3) ECEF m"""
    radius_m: Floats
    low_m: Floats
    high_m: Floats
    """(n,) heights above the ellipsoid"""

    def __add__(self, other: "Drawn") -> "Drawn":
        return Drawn(
            np.concatenate((self.cell, other.cell)),
            Ecef(np.concatenate((self.centre, other.centre))),
            np.concatenate((self.radius_m, other.radius_m)),
            np.concatenate((self.low_m, other.low_m)),
            np.concatenate((self.high_m, other.high_m)),
        )


def drawn_of(prisms: Prisms, ecef: Ecef, start: Ints, cell: Ints) -> Drawn:
    """Bound groups of vertices.

    Parameters
    ----------
    prisms, ecef : the vertices and their ECEF positions, (v, 3)
    start : (n + 1,) where each thing's vertices begin
    cell : (n,) the cell that draws it
    """
    centre, (radius_m, low_m, high_m) = _bounds(ecef, prisms.height_m, start)
    return Drawn(cell, Ecef(centre), radius_m, low_m, high_m)


@kernel
def _bounds(ecef: Ecef, height_m: Floats, start: Ints) -> tuple[Floats, Floats]:
    """Return the middle of each thing's box, and its radius, lowest and highest point."""
    count = len(start) - 1
    centre, found = np.empty((count, 3)), np.empty((3, count))
    for n in range(count):
        here = slice(start[n], start[n + 1])
        for k in range(3):
            centre[n, k] = (ecef[here, k].min() + ecef[here, k].max()) / 2
        most = 0.0
        for v in range(start[n], start[n + 1]):
            x, y, z = ecef[v, 0], ecef[v, 1], ecef[v, 2]
            x, y, z = x - centre[n, 0], y - centre[n, 1], z - centre[n, 2]
            most = max(most, x * x + y * y + z * z)
        found[0, n] = math.sqrt(most)
        found[1, n], found[2, n] = height_m[here].min(), height_m[here].max()
    return centre, found


def index_records(tree: Tree, drawn: Drawn) -> NDArray[np.void]:
    """Return INDEX records of a tree, (c,), with bounds and children filled in."""
    records = np.zeros(len(tree.cell), INDEX)
    records["cell"] = tree.cell
    records["children"] = tree.children_mask()
    level = cells.level(drawn.cell)
    highest, deepest = int(tree.level.min(initial=99)), int(tree.level.max(initial=0))
    for depth in range(highest, deepest + 1):
        below = np.flatnonzero(level >= depth)
        where = np.searchsorted(tree.cell, cells.ancestor(drawn.cell[below], depth))
        _bound(records, np.flatnonzero(tree.level == depth), where, drawn, below)
    return records


def _bound(
    records: NDArray[np.void], here: Ints, where: Ints, drawn: Drawn, below: Ints
) -> None:
    """Bound the cells `here` (positions); `where` is the cell of each thing `below`."""
    low = np.full((len(records), 4), np.inf)
    high = np.full((len(records), 4), -np.inf)
    reach = drawn.radius_m[below, None]
    boxes = (drawn.centre[below] - reach, drawn.low_m[below, None])
    np.minimum.at(low, where, np.hstack(boxes))
    boxes = (drawn.centre[below] + reach, drawn.high_m[below, None])
    np.maximum.at(high, where, np.hstack(boxes))
    centre = np.zeros((len(records), 3))
    centre[here] = (low[here, :3] + high[here, :3]) / 2
    radius = np.zeros(len(records))
    away = np.linalg.norm(drawn.centre[below] - centre[where], axis=1)
    np.maximum.at(radius, where, away + drawn.radius_m[below])
    records["centre"][here] = centre[here]
    records["radius_m"][here] = radius[here] * _MARGIN + _MARGIN_M
    records["min_height_m"][here] = low[here, 3]
    records["max_height_m"][here] = high[here, 3]
