# SPDX-License-Identifier: Apache-2.0
"""The cells above the objects, and which of them get tiles and proxies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles import cells, geodesy
from tiles.frames import Floats, Ints

MAX_PROXIED_M = 80_000.0
"""Cells hold proxies when they, or their content, are no wider: a city, not a country."""
MIN_TOP_OBJECTS = 5
"""A lone leaf of fewer objects needs no proxy above it."""


@dataclass(frozen=True, slots=True)
class Tree:
    """Cells with content at or below them, up to the zone roots, sorted by id."""

    cell: Ints
    """(c,)"""
    level: Ints
    parent: Ints
    """(c,) position of the parent, -1 for zone roots"""
    first: Ints
    last: Ints
    """(c,) the subtree's objects, last not included; objects are sorted by cell"""
    own_first: Ints
    own_last: Ints
    """(c,) the cell's own objects"""

    @property
    def has_own(self) -> NDArray[np.bool_]:
        """Tell which cells hold objects themselves, (c,)."""
        return self.own_last > self.own_first

    def children_mask(self) -> NDArray[np.uint8]:
        """Return for each cell a bit for each child in the tree, (c,)."""
        mask = np.zeros(len(self.cell), np.uint8)
        below = self.parent >= 0
        bit = np.left_shift(1, cells.child_position(self.cell[below])).astype(np.uint8)
        np.bitwise_or.at(mask, self.parent[below], bit)
        return mask

    def raised(self, how: np.ufunc, value: Floats) -> Floats:
        """Carry values up: each cell gets `how` over its own and its descendants'."""
        value = value.copy()
        for level in range(int(self.level.max(initial=0)), 0, -1):
            here = np.flatnonzero(self.level == level)
            how.at(value, self.parent[here], value[here])
        return value


def build_tree(object_cell: Ints) -> Tree:
    """Return the tree of objects' cells, (n,) sorted."""
    found = np.unique(object_cell)
    known = [found]
    for depth in range(int(cells.level(found).max(initial=0)) - 1, -1, -1):
        deep = cells.level(found) > depth
        above = cells.ancestor(found[deep], depth)
        found = np.unique(np.concatenate((found[~deep], above)))
        known.append(found)
    cell = np.unique(np.concatenate(known))
    level = cells.level(cell)
    parent = np.searchsorted(cell, cells.ancestor(cell, np.maximum(level - 1, 0)))
    return Tree(
        cell,
        level,
        np.where(level > 0, parent, -1),
        np.searchsorted(object_cell, cells.range_min(cell)),
        np.searchsorted(object_cell, cells.range_max(cell), side="right"),
        np.searchsorted(object_cell, cell),
        np.searchsorted(object_cell, cell, side="right"),
    )


def proxied_children(tree: Tree, radius_m: Floats) -> Ints:
    """Return the cells (positions) that get a proxy, sorted by parent, then id.

    `radius_m`, (c,), is that of a sphere around each cell's buildings. A cell holds a
    proxy for each child when it branches, or has objects of its own. A chain of single
    children needs none, but the cell above the topmost tile of a city does: there the
    whole city is one proxy.
    """
    below = tree.parent >= 0
    child_count = np.bincount(tree.parent[below], minlength=len(tree.cell))
    edge_m = geodesy.cell_edge_m(tree.cell)
    narrow = np.minimum(edge_m, 2 * radius_m) <= MAX_PROXIED_M
    holds = narrow & (child_count > 0) & ((child_count > 1) | tree.has_own)
    covered = _has_above(tree, holds)
    worth = tree.last - tree.first >= MIN_TOP_OBJECTS
    top = (holds | tree.has_own) & ~covered & worth & below
    above = tree.parent[top]
    holds[above[narrow[above]]] = True
    child = np.flatnonzero(below & holds[tree.parent])
    return child[np.lexsort((tree.cell[child], tree.parent[child]))]


def _has_above(tree: Tree, holds: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which cells have an ancestor among those that hold proxies."""
    covered = np.zeros(len(tree.cell), bool)
    for level in range(1, int(tree.level.max(initial=0)) + 1):
        here = np.flatnonzero(tree.level == level)
        above = tree.parent[here]
        covered[here] = covered[above] | holds[above]
    return covered
