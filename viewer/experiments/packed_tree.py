# SPDX-License-Identifier: Apache-2.0
"""A packed R-tree that counts what a search reads, as REVIEW's searches read it.

Boxes are sorted into slabs by x and tiles by y (sort-tile-recursive), so nodes are full
and compact: a better tree than one that grew by inserting, for all searches alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats, Ints
from viewer.experiments.city import City

FANOUT = 50
"""Entries of a node: 4 KiB hold 73 of a box in doubles and a pointer; 70 % are full"""
NODE_BYTES = 4096
Box = tuple[Floats, Floats]
"""Least and greatest corner, (3,) each"""
Bools = NDArray[np.bool_]


def overlaps(low: Floats, high: Floats, box: Box) -> Bools:
    """Say which boxes meet another, (n,)."""
    return np.asarray(((low <= box[1]) & (high >= box[0])).all(axis=-1))


def lies_in(low: Floats, high: Floats, box: Box) -> Bools:
    """Say which boxes lie inside another, (n,)."""
    return np.asarray(((low >= box[0]) & (high <= box[1])).all(axis=-1))


@dataclass(frozen=True, slots=True)
class Level:
    """The nodes of one level, FANOUT of the level below in each."""

    low: Floats
    high: Floats
    first: int
    """number of its first node among all nodes"""


@dataclass(frozen=True, slots=True)
class Reads:
    """What one search reads."""

    nodes: Ints
    boxes: Ints


class PackedTree:
    """An R-tree over the boxes of a city."""

    def __init__(self, city: City) -> None:
        middle = city.low[:, :2] + city.high[:, :2]
        leaves = -(-len(middle) // FANOUT)
        slab = int(np.ceil(np.sqrt(leaves))) * FANOUT
        by_x = np.argsort(middle[:, 0], kind="stable")
        slabs = np.arange(len(by_x)) // slab
        self.order: Ints = by_x[np.lexsort((middle[by_x, 1], slabs))]
        low, high = city.low[self.order], city.high[self.order]
        self.boxes = Level(low, high, 0)
        self.levels: list[Level] = []
        """leaves first"""
        first = 0
        while len(low) > 1 or not self.levels:
            starts = np.arange(0, len(low), FANOUT)
            low = np.minimum.reduceat(low, starts)
            high = np.maximum.reduceat(high, starts)
            self.levels.append(Level(low, high, first))
            first += len(low)
        self.node_low = np.concatenate([level.low for level in self.levels])
        self.node_high = np.concatenate([level.high for level in self.levels])
        sizes = [len(level.low) for level in self.levels]
        self.node_level = np.repeat(np.arange(len(sizes)), sizes)
        """0 for leaves"""

    def search(self, box: Box, history: Sequence[Box] = ()) -> Reads:
        """Find boxes that meet a box and none of the history's (their figure 4).

        A node is not read when it does not meet the box, or lies in one of the history.
        """
        nodes = [np.zeros(0, np.int64)]
        entries = np.zeros(1, np.int64)
        counts = [len(self.boxes.low), *(len(level.low) for level in self.levels)]
        for level, count in zip(self.levels[::-1], counts[-2::-1], strict=True):
            low, high = level.low[entries], level.high[entries]
            read = overlaps(low, high, box)
            for old in history:
                read &= ~lies_in(low, high, old)
            nodes.append(entries[read] + level.first)
            below = entries[read][:, None] * FANOUT + np.arange(FANOUT)
            entries = below[below < count]
        low, high = self.boxes.low[entries], self.boxes.high[entries]
        found = overlaps(low, high, box)
        for old in history:
            found &= ~overlaps(low, high, old)
        return Reads(np.concatenate(nodes), entries[found])


class NodeCache:
    """Index nodes in memory. Least recently used goes first, or by distance as well.

    Parameters
    ----------
    tree : whose nodes
    size_bytes : room
    by_distance : distance-priority-LRU (section 3.2), all weights alike: level, block
        distance to the search's box, and searches since the last use, each over its most
    """

    def __init__(
        self, tree: PackedTree, size_bytes: int, *, by_distance: bool = False
    ) -> None:
        self._tree, self._room = tree, size_bytes // NODE_BYTES
        self._by_distance = by_distance
        self._used: dict[int, int] = {}
        """node: number of the search that last used it, least recently used first"""
        self._search = 0

    def read(self, nodes: Ints, box: Box) -> int:
        """Use the nodes of one search; return how many had to be read."""
        self._search += 1
        missed = 0
        for node in nodes.tolist():
            missed += node not in self._used
            self._used.pop(node, None)
            self._used[node] = self._search
        while len(self._used) > self._room:
            more = len(self._used) - self._room
            leaving = self._farthest(box, more) if self._by_distance else [*self._used]
            for node in leaving[:more]:
                del self._used[node]
        return missed

    def _farthest(self, box: Box, count: int) -> list[int]:
        nodes = np.array([*self._used])
        low, high = self._tree.node_low[nodes], self._tree.node_high[nodes]
        away_m = np.maximum(np.maximum(box[0] - high, low - box[1]), 0).max(axis=1)
        depth = len(self._tree.levels) - self._tree.node_level[nodes]
        age = self._search - np.array([*self._used.values()])
        parts = [part / max(float(part.max()), 1.0) for part in (depth, away_m, age)]
        return [int(node) for node in nodes[np.argsort(-sum(parts), kind="stable")[:count]]]
