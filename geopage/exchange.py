# SPDX-License-Identifier: Apache-2.0
"""What the renderer is given and what it gives back, without ever waiting.

It takes decoded tiles and says when they can be drawn; it is told which tiles no list
draws any more and says when their slots are free. Thread: render.
"""

import math
from collections.abc import Iterable, Mapping
from itertools import repeat
from typing import NamedTuple

import numpy as np

from geopage.handoff import Signal
from geopage.priority_queue import PriorityQueue
from geopage.residency import Key, Residency
from geopage.tile_state import State
from geopage.tree import Tree
from tiles.lanes import Lane
from tiles.objects import ObjectTile
from tiles.terrain import TerrainTile


class Upload(NamedTuple):
    """A decoded tile for the renderer."""

    lane: Lane
    row: int
    """row of the lane's forest"""
    tile: TerrainTile | ObjectTile


class Exchange:
    """The renderer's side of the residency."""

    def __init__(
        self,
        trees: Mapping[Lane, Tree],
        queue: PriorityQueue,
        residency: Residency,
        scene: Signal,
    ) -> None:
        self._memory_bytes = {lane: tree.memory_bytes for lane, tree in trees.items()}
        self._queue = queue
        self._residency = residency
        self._scene = scene

    def take_uploads(self, max_bytes: int) -> list[Upload]:
        """Return the tiles of best rank, at most `max_bytes` but one at least.

        Tiles that nobody wants any more are dropped instead.
        """
        ready = self._residency.ready
        uploads: list[Upload] = []
        for rank, lane, row in self._ranked(list(ready)):
            if rank == math.inf:
                del ready[lane, row]
                self.say(State.ABSENT, lane, row)
                continue
            max_bytes -= int(self._memory_bytes[lane][row])
            if max_bytes < 0 and uploads:
                break
            uploads.append(Upload(lane, row, ready.pop((lane, row))))
        return uploads

    def _ranked(self, keys: list[Key]) -> list[tuple[float, Lane, int]]:
        """Put tiles in the order of their newest ranks: what was urgent may not be now."""
        found: list[tuple[float, Lane, int]] = []
        for lane in {lane for lane, _ in keys}:
            rows = np.array([row for other, row in keys if other is lane], np.int32)
            ranks = self._queue.ranks(lane, rows).tolist()
            found += zip(ranks, repeat(lane), rows.tolist(), strict=False)
        return sorted(found)

    def put_back(self, items: Iterable[Upload]) -> None:
        """Take back what the renderer had no time or no room for."""
        for item in items:
            self._residency.ready[item.lane, item.row] = item.tile

    def releases(self, list_number: int) -> list[Key]:
        """Return the tiles that no list from `list_number` on draws, each once."""
        # Without zones there is no list to wait for, and no zone comes without room.
        list_number = max(list_number, self._residency.undrawn)
        queue, found = self._residency.released, []
        while queue and queue[0][0] <= list_number:
            try:
                entry = queue.popleft()
            except IndexError:  # the last one was wanted again, just now
                break
            if entry[0] > list_number:  # as was the one before this
                queue.appendleft(entry)
                break
            found.append(entry[1:])
        return found

    def say(self, state: State, lane: Lane, row: int) -> None:
        """Say that a tile is UPLOADED, or ABSENT from where the renderer had it."""
        self._residency.told.append((state, lane, row))
        self._scene.set()
