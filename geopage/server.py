# SPDX-License-Identifier: Apache-2.0
"""A server loads one lane's tiles: take, read, check, decode, deliver.

Whether the tile is still wanted is asked before the read and before the decoding. Reads,
checksums and decompression release the GIL.
"""

from collections.abc import Callable, MutableSequence

import numpy as np
from numpy.typing import NDArray

from geopage.priority_queue import PriorityQueue
from geopage.residency import Residency
from geopage.source import TileSource
from tiles.errors import TileFault
from tiles.lanes import Lane


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
        self._asked: tuple[int, float] | None = None

    def step(self, now_s: float) -> float | None:
        """Do the next thing for the best request.

        Returns
        -------
        Seconds until the next step can do something, or None when nothing is pending.
        """
        if self._asked is None and not self._ask(now_s):
            return None
        if self._asked is None:
            return 0.0
        row, ready_s = self._asked
        if self._is_stale(row):
            return 0.0
        if now_s < ready_s:
            return ready_s - now_s
        self._load(row)
        self._asked = None
        return 0.0

    def _ask(self, now_s: float) -> bool:
        """Take the best request; False when there is none."""
        row = self._queue.pop(self.lane)
        if row is None:
            return False
        if not self._is_stale(row) and self._residency.reserve(self.lane, row):
            self._asked = row, self.source.ready_s(self._records[row], now_s)
        return True

    def _is_stale(self, row: int) -> bool:
        """Drop a tile that nobody wants any more, and say so."""
        if self._queue.is_wanted(self.lane, row):
            return False
        self._residency.drop(self.lane, row)
        self._asked = None
        return True

    def _load(self, row: int) -> None:
        try:
            body = self.source.read(self._records[row])
            self._residency.count_read(len(body))
            if self._is_stale(row):
                return
            tile = self._decode(body)
        except TileFault as fault:
            self._residency.fail(self.lane, row)
            self._faults.append(str(fault))
            return
        self._residency.deliver(self.lane, row, tile)
