# SPDX-License-Identifier: Apache-2.0
"""A manager ranks one lane's wants, cancels what is stale, and proposes evictions."""

import numpy as np
from numpy.typing import NDArray

from geopage.handoff import Signal, TripleBuffer
from geopage.policies.protocol import NOTHING, PageRequests
from geopage.priority_queue import PriorityQueue
from geopage.residency import Residency
from tiles.lanes import Lane

KEPT_LISTS = 60
"""What a list of the last second or so used does not go for a mere prediction."""


class TileManager:
    """Turns wants into pending requests that fit the memory. Thread: the lane's manager."""

    def __init__(
        self, lane: Lane, queue: PriorityQueue, residency: Residency, scene: Signal
    ) -> None:
        self.lane = lane
        self.inbox = TripleBuffer(NOTHING)
        self.signal = Signal()
        self._queue = queue
        self._residency = residency
        self._scene = scene

    def step(self) -> None:
        """Replace the lane's requests by the newest wants, as far as there is room."""
        if not self.signal.clear():
            return
        wants = self.inbox.take()
        taken = self._queue.taken(self.lane, wants.rows)
        changed = self._residency.keep_again(self.lane, wants.rows[taken])
        price = np.where(taken, 0, self._residency.price(self.lane, wants.rows))
        filled = np.cumsum(price)
        if len(filled) and filled[-1]:
            changed |= self._make_room(wants, price, filled)
        fits = taken | (filled <= self._residency.free_bytes)
        rows, ranks = wants.rows[fits], wants.ranks[fits]
        cancelled = self._queue.replace_lane(self.lane, rows, ranks)
        new = ~taken[fits]
        self._residency.queued(self.lane, rows[new], ranks[new], cancelled)
        if changed:
            self._scene.set()

    def _make_room(
        self, wants: PageRequests, price: NDArray[np.int64], filled: NDArray[np.int64]
    ) -> bool:
        """Evict for what is wanted now, and with less right for what may be wanted."""
        room, newest = self._residency, self._residency.number
        now = wants.now
        evicted = bool(now) and room.make_room(int(filled[now - 1]), newest)
        evicted |= room.make_room(int(filled[-1]), newest - KEPT_LISTS)
        first = price[:now][price[:now] > 0][:1]
        stuck = bool(len(first)) and room.coming_bytes < int(first[0])
        changed = stuck != room.stuck.get(self.lane, False)
        room.stuck[self.lane] = stuck
        return evicted or (stuck and changed)
