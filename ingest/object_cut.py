# SPDX-License-Identifier: Apache-2.0
"""A tree cut in branches of some thousand objects, and the crown above them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ingest.object_tree import Tree
from tiles import cells
from tiles.frames import Ints


@dataclass(frozen=True, slots=True)
class Cut:
    """A part of a tree, as a tree of its own."""

    tree: Tree
    held: Ints
    """(p,) cells (positions) whose proxies are in this part's tiles, by parent, then id"""
    is_wanted: bool = False
    """a proxy above is made of what stands for this part"""


def branch_roots(tree: Tree, at_most: int) -> Ints:
    """Return where to cut: the highest cells with at most so many objects, or no children.

    They are positions, ascending; none contains another, and together with the cells
    above them they are the whole tree.
    """
    has_child = np.zeros(len(tree.cell), bool)
    has_child[tree.parent[tree.parent >= 0]] = True
    small = (tree.last - tree.first <= at_most) | ~has_child
    high = (tree.parent < 0) | ~small[tree.parent]
    return np.flatnonzero(small & high)


def branch(tree: Tree, held: Ints, root: int, *, is_wanted: bool = True) -> Cut:
    """Cut out a cell and all below it; its objects count from 0.

    Parameters
    ----------
    held : cells with a proxy in their parent's tile, positions in the whole tree
    """
    low, high = cells.range_min(tree.cell[root]), cells.range_max(tree.cell[root])
    start, stop = np.searchsorted(tree.cell, [low, high + 1]).tolist()
    here, first = slice(start, stop), tree.first[root]
    parent = tree.parent[here] - start
    parent[root - start] = -1
    own = (tree.first, tree.last, tree.own_first, tree.own_last)
    cut = Tree(tree.cell[here], tree.level[here], parent, *(o[here] - first for o in own))
    inside = (held >= start) & (held < stop) & (held != root)
    return Cut(cut, held[inside] - start, is_wanted)


def crown(tree: Tree, held: Ints, roots: Ints) -> tuple[Cut, Ints, NDArray[np.bool_]]:
    """Return what is above the branches, with their roots as leaves without own objects.

    Returns
    -------
    cut : its objects are those that cells above the branches hold, counted from 0;
        `first` and `last` still count all objects
    own : (n,) which of all objects these are
    is_root : (c,) which cells of the crown are roots of branches
    """
    inside = np.zeros(len(tree.cell), bool)
    here = roots
    while len(here):
        inside[here] = True
        above = np.unique(tree.parent[here])
        here = above[(above >= 0) & ~inside[above]]
    place = np.flatnonzero(inside)
    is_root = np.isin(place, roots)
    where = np.cumsum(inside) - 1
    parent = tree.parent[place]
    count = np.where(is_root, 0, tree.own_last[place] - tree.own_first[place])
    end = np.cumsum(count)
    start = np.repeat(tree.own_first[place] - (end - count), count)
    cut = Tree(
        tree.cell[place],
        tree.level[place],
        np.where(parent >= 0, where[parent], -1),
        tree.first[place],
        tree.last[place],
        end - count,
        end,
    )
    mine = held[inside[held]]
    return Cut(cut, where[mine]), start + np.arange(int(end[-1])), is_root
