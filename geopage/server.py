# SPDX-License-Identifier: Apache-2.0
"""A server loads one lane's tiles: take, read, check, decode, deliver.

Whether the tile is still wanted is asked before the read and before the decoding. Reads,
checksums and decompression release the GIL.
"""

from bisect import insort
from collections.abc import Callable, MutableSequence
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.priority_queue import PriorityQueue
from geopage.residency import Residency
from geopage.source import TileSource
from tiles.errors import ReadFault, TileFault
from tiles.lanes import Lane

MOST_ASKED = 8
"""Tiles on a slow line at a time: their latency passes side by side."""
PAUSES_S = (0.05, 0.2, 0.8)
"""After a read that failed, before the next one; the one after the last is final."""


class Asked(NamedTuple):
    """A tile that is on its way."""

    row: int
    asked_s: float
    ready_s: float
    """when it can be read"""
    failed: int
    """reads that have failed"""


class TileServer:
    """Serves the requests of one lane, one at a time. Thread: the lane's server.

    Parameters
    ----------
    lane : Lane
    records : (n,) INDEX of the lane's forest
    source : where bodies come from
    decode : makes a tile of a body; TileFault when it is none
    queue, residency : shared with everybody
    faults : gets one line for each tile that can't be used
    """

    def __init__(
        self,
        lane: Lane,
        records: NDArray[np.void],
        source: TileSource,
        decode: Callable[[bytes], object],
        queue: PriorityQueue,
        residency: Residency,
        faults: MutableSequence[str],
    ) -> None:
        self.lane = lane
        self.source = source
        self._records = records
        self._decode = decode
        self._queue = queue
        self._residency = residency
        self._faults = faults
        self._asked: list[Asked] = []
        """by when they can be read"""
        self._done: tuple[int, float] | None = None
        """bytes of the tile that has just come, and when it was asked for"""

    def step(self, now_s: float) -> float | None:
        """Do the next thing for the best request.

        Returns
        -------
        Seconds until the next step can do something, or None when nothing is pending.
        """
        if self._done is not None:
            self._residency.rate.timed(*self._done, now_s)
            self._done = None
        waiting = len(self._asked)
        self._asked = [one for one in self._asked if not self._is_stale(one.row)]
        if len(self._asked) < waiting:
            return 0.0
        free_s = self.source.free_s(now_s)
        asked = now_s >= free_s and len(self._asked) < MOST_ASKED and self._ask(now_s)
        if self._asked and now_s >= self._asked[0].ready_s:
            self._load(self._asked.pop(0), now_s)
            return 0.0
        waits = [self._asked[0].ready_s] if self._asked else []
        if free_s > now_s and self._queue.pending(self.lane):
            waits.append(free_s)
        return 0.0 if asked else min(waits) - now_s if waits else None

    def _ask(self, now_s: float) -> bool:
        """Take the best request; False when there is none that may be asked for now."""
        row = self._queue.pop(self.lane)
        if row is None:
            return False
        if not self._is_stale(row) and self._residency.reserve(self.lane, row):
            self._expect(row, now_s, now_s, 0)
        return True

    def _expect(self, row: int, now_s: float, earliest_s: float, failed: int) -> None:
        ready_s = max(self.source.ready_s(self._records[row], now_s), earliest_s)
        insort(self._asked, Asked(row, now_s, ready_s, failed), key=attrgetter("ready_s"))

    def _is_stale(self, row: int) -> bool:
        """Drop a tile that nobody wants any more, and say so."""
        if self._queue.is_wanted(self.lane, row):
            return False
        self._residency.drop(self.lane, row)
        return True

    def _load(self, one: Asked, now_s: float) -> None:
        row, failed = one.row, one.failed
        self._done = int(self._records[row]["tile_bytes"]), one.asked_s
        try:
            body = self.source.read(self._records[row])
            self._residency.count_read(self.lane, row, len(body))
            if self._is_stale(row):
                return
            tile = self._decode(body)
        except TileFault as fault:
            if isinstance(fault, ReadFault) and failed < len(PAUSES_S):
                self._expect(row, now_s, now_s + PAUSES_S[failed], failed + 1)
                return
            self._residency.fail(self.lane, row)
            self._faults.append(str(fault))
            return
        self._residency.deliver(self.lane, row, tile)
