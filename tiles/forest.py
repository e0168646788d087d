# SPDX-License-Identifier: Apache-2.0
"""The resident index of one lane: 32 index trees and their links, as arrays.

Positions in these arrays ("rows" below and in draw lists) are dense int32 numbers, in
order of level and cell; they are not the store's tile rows. The tree is the arithmetic
of cell ids plus these arrays; there are no node objects.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles import cells, links
from tiles.index_tree import INDEX

Rows = NDArray[np.int32]
NONE = -1


@dataclass(frozen=True, slots=True)
class Forest:
    """Index records of one lane with the rows of parents, children and links."""

    records: NDArray[np.void]
    """(n,) INDEX sorted by level, then cell"""
    parent: Rows
    """(n,) row of the parent, -1 for zone roots"""
    children: Rows
    """(n, 4) rows of the children SW, SE, NW, NE, -1 where there is none"""
    links: Rows
    """(n, 4) row of the deepest cell that covers the neighbour to the S, E, N, W"""
    centre: NDArray[np.float64]
    """(n, 3) contiguous copy of the bounding spheres' centres, for kernels"""
    radius_m: NDArray[np.float64]
    """(n,) contiguous copy of the radii"""

    @property
    def nbytes(self) -> int:
        """Bytes held in memory."""
        arrays = (self.records, self.parent, self.children, self.links)
        return sum(a.nbytes for a in (*arrays, self.centre, self.radius_m))

    def row_of(self, cell: NDArray[np.int64] | int) -> Rows:
        """Return the row of each cell, -1 where the index has none."""
        return _rows_of(self.records["cell"], np.asarray(cell, np.int64))


def build_forest(records: NDArray[np.void]) -> Forest:
    """Link index records, (n,) INDEX in any order, to a forest."""
    if records.dtype != INDEX:
        raise ValueError(f"expected INDEX records, got {records.dtype}")
    level = cells.level(records["cell"])
    records = records[np.lexsort((records["cell"], level))]
    cell, level = records["cell"].copy(), cells.level(records["cell"])
    above = _rows_of(cell, cells.ancestor(cell, np.maximum(level - 1, 0)))
    parent = np.where(level > 0, above, NONE).astype(np.int32)
    children = _rows_of(
        cell, np.where(level < cells.MAX_LEVEL, 1, 0)[:, None] * _children(cell)
    )
    return Forest(
        records,
        parent,
        children,
        _links(cell, level),
        np.ascontiguousarray(records["centre"]),
        records["radius_m"].astype(np.float64),
    )


def _children(cell: NDArray[np.int64]) -> NDArray[np.int64]:
    shallow = np.where(cells.level(cell) < cells.MAX_LEVEL, cell, cells.ancestor(cell, 0))
    return cells.children(shallow)


def _rows_of(sorted_cells: NDArray[np.int64], wanted: NDArray[np.int64]) -> Rows:
    if not len(sorted_cells):
        return np.full(wanted.shape, NONE, np.int32)
    by_id = np.argsort(sorted_cells, kind="stable")
    place = np.searchsorted(sorted_cells, wanted, sorter=by_id)
    candidate = by_id[np.minimum(place, len(by_id) - 1)]
    return np.where(sorted_cells[candidate] == wanted, candidate, NONE).astype(np.int32)


def _links(cell: NDArray[np.int64], level: NDArray[np.int64]) -> Rows:
    """Walk each missing neighbour up until an ancestor of it is in the index."""
    wanted = links.edge_neighbours(cell)
    depth = np.broadcast_to(level[:, None], wanted.shape).copy()
    found = _rows_of(cell, wanted)
    while (open_ := (found == NONE) & (depth > 0)).any():
        depth[open_] -= 1
        found[open_] = _rows_of(cell, cells.ancestor(wanted[open_], depth[open_]))
    return found
