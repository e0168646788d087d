# SPDX-License-Identifier: Apache-2.0
"""REVIEW's retrieval (Shou et al., VLDB 2001, section 3), walked through a city.

A disk cell is so many times as large as the box around the view. When the view leaves
it, a box search reads all of the next one; complement search only what no earlier cell
in memory holds. Near the edge the next cell, around F' = F + k velocity, is read
beforehand. Memory holds all that was read until it is full, then the newest cells only.
"""

from dataclasses import dataclass, field

import numpy as np

from tiles.frames import Floats
from viewer.experiments.city import MEMORY_BYTES
from viewer.experiments.packed_tree import Box, NodeCache, PackedTree, lies_in, overlaps
from viewer.experiments.walks import Walk, frustum_corners, in_frustum

BUFFER_BYTES = 20_000_000
INDEX_BYTES = 1_000_000
NEAR_EDGE = 0.1
"""Share of the disk cell's size from its edge at which the next one is read; ours"""
MOST_CELLS = 20
"""Of the history; theirs was "fewer than twenty in most cases" """
LOOK_EVERY = 10
"""Culling is counted at every tenth step"""


@dataclass(frozen=True, slots=True)
class Retrieval:
    """One configuration of the paper's section 5."""

    scale: float = 1.5
    """SF: disk cell / box around the view"""
    k_s: float = 0.8
    complement: bool = True
    prefetch: bool = True
    index_bytes: int = INDEX_BYTES
    by_distance: bool = True
    """Index nodes go by distance-priority-LRU, not by LRU"""
    buffer_bytes: int = BUFFER_BYTES


@dataclass(slots=True)
class Tally:
    """What a walk came to."""

    queries: int = 0
    node_reads: int = 0
    box_reads: int = 0
    held: list[int] = field(default_factory=list)
    """boxes in memory, at the steps where culling was counted"""
    seen: list[int] = field(default_factory=list)
    """of these, in the view"""
    history: list[int] = field(default_factory=list)
    """earlier cells that a search was held against"""

    @property
    def reads(self) -> int:
        """Index nodes and boxes, one read each."""
        return self.node_reads + self.box_reads


class Walker:
    """One configuration on its way through a city."""

    def __init__(self, tree: PackedTree, how: Retrieval) -> None:
        self.tally = Tally()
        self.held = np.zeros(len(tree.order), np.bool_)
        """which boxes are in memory, in the tree's order"""
        self._tree, self._how = tree, how
        self._cache = NodeCache(tree, how.index_bytes, by_distance=how.by_distance)
        self._disk: Box | None = None
        self._next: Box | None = None
        self._history: list[Box] = []

    def step(self, corners: Floats, velocity: Floats) -> None:
        """Look at a view, (5, 3) corners, and read what it needs."""
        view = corners.min(axis=0), corners.max(axis=0)
        if self._disk is None or not holds(self._disk, view):
            if self._next is not None and holds(self._next, view):
                self._disk = self._next
            else:
                self._disk = around(view, (view[0] + view[1]) / 2, self._how.scale)
                self._query(self._disk)
            self._next = None
        elif self._how.prefetch and self._is_leaving(view):
            ahead = corners[1:].mean(axis=0)
            ahead[:2] += self._how.k_s * velocity
            following = around(view, ahead, self._how.scale)
            if holds(following, view):
                self._next = following
                self._query(following)

    def _is_leaving(self, view: Box) -> bool:
        assert self._disk is not None
        margin = NEAR_EDGE * (self._disk[1] - self._disk[0])
        inner = self._disk[0] + margin, self._disk[1] - margin
        covered = self._next is not None and holds(self._next, view)
        return not holds(inner, view) and not covered

    def _query(self, box: Box) -> None:
        known = [old for old in self._history if meets(old, box)]
        found = self._tree.search(box, known if self._how.complement else ())
        tally = self.tally
        tally.queries += 1
        tally.history.append(len(known))
        tally.node_reads += self._cache.read(found.nodes, box)
        tally.box_reads += len(found.boxes)
        if not self._how.complement:
            self.held[:] = False
        self.held[found.boxes] = True
        self._history = [*self._history[1 - MOST_CELLS :], box]
        if self.held.sum() * MEMORY_BYTES > self._how.buffer_bytes:
            self._trim(box)

    def _trim(self, newest: Box) -> None:
        """Keep only what the cells in use need."""
        keep = [newest] if self._disk is None else [self._disk, newest]
        boxes = self._tree.boxes
        here = np.flatnonzero(self.held)
        low, high = boxes.low[here], boxes.high[here]
        used = np.zeros(len(here), np.bool_)
        for one in keep:
            used |= overlaps(low, high, one)
        self.held[here[~used]] = False
        self._history = keep

    def look(self, place: Floats, heading_rad: float) -> None:
        """Count what is in memory, and what of it is in the view."""
        here = np.flatnonzero(self.held)
        low, high = self._tree.boxes.low[here], self._tree.boxes.high[here]
        self.tally.held.append(len(here))
        self.tally.seen.append(int(in_frustum(low, high, place, heading_rad).sum()))


def walk_through(tree: PackedTree, walk: Walk, how: Retrieval) -> Tally:
    """Walk from end to end and return what it took, the first query left out."""
    walker = Walker(tree, how)
    for i in range(len(walk.place)):
        heading = float(walk.heading_rad[i])
        walker.step(frustum_corners(walk.place[i], heading), walk.velocity(i))
        if i == 0:
            walker.tally.queries = walker.tally.node_reads = walker.tally.box_reads = 0
        if i % LOOK_EVERY == 0:
            walker.look(walk.place[i], heading)
    return walker.tally


def around(view: Box, middle: Floats, scale: float) -> Box:
    """Return a box `scale` times as large as the view's around a point."""
    half = (view[1] - view[0]) * scale / 2
    return middle - half, middle + half


def holds(outer: Box, inner: Box) -> bool:
    """Say whether a box lies inside another."""
    return bool(lies_in(inner[0], inner[1], outer))


def meets(one: Box, other: Box) -> bool:
    """Say whether two boxes overlap."""
    return bool(overlaps(one[0], one[1], other))
