# SPDX-License-Identifier: Apache-2.0
"""The cells above the objects, and which of them get tiles and proxies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles import cells, geodesy
from tiles.frames import Ecef, Floats, Ints

MAX_PROXIED_M = 80_000.0
"""Cells hold proxies when they, or their content, are no wider: a city, not a country."""
MIN_TOP_OBJECTS = 5
"""A lone leaf of fewer objects needs no proxy above it."""


@dataclass(frozen=True, slots=True)
class Tree:
    """Cells with content at or below them, sorted by id, up to one root or many."""

    cell: Ints
    """(c,)"""
    level: Ints
    parent: Ints
    """(c,) position of the parent, -1 for roots"""
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

    @property
    def object_cell(self) -> Ints:
        """Return the cell of each object, (n,)."""
        return np.repeat(self.cell, self.own_last - self.own_first)

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
            here = np.flatnonzero((self.level == level) & (self.parent >= 0))
            how.at(value, self.parent[here], value[here])
        return value


def build_tree(object_cell: Ints) -> Tree:
    """Return the tree of objects' cells, (n,) sorted, up to the zone roots."""
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


def contents_m(tree: Tree, place: Ecef, dimension_m: Floats) -> Floats:
    """Return how wide cells or their content are, whichever is less, (c,) m.

    Parameters
    ----------
    place : (n, 3) centres of the objects, in the tree's order
    dimension_m : (n,)
    """
    width_m = geodesy.cell_edge_m(tree.cell)
    for k in np.flatnonzero(width_m > MAX_PROXIED_M).tolist():
        mine = place[tree.first[k] : tree.last[k]]
        middle = (mine.min(axis=0) + mine.max(axis=0)) / 2
        away = np.linalg.norm(mine - middle, axis=1)
        reach_m = float((away + dimension_m[tree.first[k] : tree.last[k]]).max())
        width_m[k] = min(width_m[k], 2 * reach_m)
    return np.asarray(width_m)


def proxied_children(tree: Tree, width_m: Floats) -> Ints:
    """Return the cells (positions) that get a proxy, sorted by parent, then id.

    `width_m`, (c,), is that of each cell or of its content. A cell holds a proxy for each
    child when it branches, or has objects of its own. A chain of single children needs
    none, but the cell above the topmost tile of a city does: there the whole city is one
    proxy.
    """
    below = tree.parent >= 0
    child_count = np.bincount(tree.parent[below], minlength=len(tree.cell))
    narrow = width_m <= MAX_PROXIED_M
    holds = narrow & (child_count > 0) & ((child_count > 1) | tree.has_own)
    covered = descends(tree, holds)
    worth = tree.last - tree.first >= MIN_TOP_OBJECTS
    top = (holds | tree.has_own) & ~covered & worth & below
    above = tree.parent[top]
    holds[above[narrow[above]]] = True
    child = np.flatnonzero(below & holds[tree.parent])
    return child[np.lexsort((tree.cell[child], tree.parent[child]))]


def below_proxies(tree: Tree, held: Ints) -> NDArray[np.bool_]:
    """Tell which cells have a proxy, or an ancestor that has one, (c,)."""
    wanted = np.zeros(len(tree.cell), bool)
    wanted[held] = True
    return np.asarray(wanted | descends(tree, wanted))


def descends(tree: Tree, among: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which cells have an ancestor among some, (c,)."""
    covered = np.zeros(len(tree.cell), bool)
    for level in range(1, int(tree.level.max(initial=0)) + 1):
        here = np.flatnonzero((tree.level == level) & (tree.parent >= 0))
        above = tree.parent[here]
        covered[here] = covered[above] | among[above]
    return covered
