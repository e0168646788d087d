# SPDX-License-Identifier: Apache-2.0
"""Who is where: the state of every tile, and the one byte budget of both lanes.

Promise: index + in flight + resident + uploaded bytes never exceed the budget. A tile is
paid for before it is read, with its stored bytes on top until it is decoded, and until
the renderer says that its slot is free.

The renderer never takes the lock: what it says goes into a deque and is booked by the
next `snapshot`; what it is told comes out of a dict and a deque. Their operations are
indivisible. The scene manager and the managers take turns (`Threads._turn`), so what they
alone touch needs no lock; what servers touch, too, runs under it, for microseconds.
"""

import threading
from collections import deque
from collections.abc import Mapping
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geopage.eviction import PINNED, Leaving, first_to_go, least_recently_used, pinned
from geopage.line_rate import LineRate
from geopage.metrics import Counters
from geopage.priority_queue import PriorityQueue
from geopage.tile_state import State, advance
from geopage.tile_table import LaneTable
from geopage.trace import TileTrace
from geopage.tree import F8, U1, Tree
from tiles.forest import Rows
from tiles.lanes import Lane

Key = tuple[Lane, int]
SLACK_SHARE = 64
"""One eviction frees this share of the budget more than is asked for."""


class Residency:
    """States, bytes and evictions of both lanes. Thread: any, as said for each method."""

    def __init__(
        self,
        trees: Mapping[Lane, Tree],
        queue: PriorityQueue,
        budget_bytes: int,
        leaving: Leaving = least_recently_used,
    ) -> None:
        self.counters = Counters()
        self.rate = LineRate()
        self.trace = TileTrace({}, float)
        self.budget_bytes = budget_bytes
        self.index_bytes = 0
        self.number = 0
        """number of the newest snapshot, and of the list made from it"""
        self.undrawn = 0
        """number of the newest list that was not published: not all zones are there"""
        self.stuck: dict[Lane, bool] = {}
        """the lane's best request finds no room, and nothing may go"""
        self.has_failures = False
        self.ready: dict[Key, Any] = {}
        """decoded tiles that the renderer may take"""
        self.released: deque[tuple[int, Lane, int]] = deque()
        """(list number, lane, row): free when that list or a later one is on the screen"""
        self.told: deque[tuple[State, Lane, int]] = deque()
        """what the renderer has done: tile is uploaded, or absent (dropped, freed)"""
        self._lock = threading.Lock()
        self._queue = queue
        self.leaving = leaving
        """the policy's order among tiles that may go"""
        self._tables = {lane: LaneTable(tree) for lane, tree in trees.items()}
        self._bytes = dict.fromkeys(State, 0)
        self._peak_bytes = 0
        land = self._tables[Lane.TERRAIN]
        stays = pinned(trees[Lane.TERRAIN].level, land.cost, budget_bytes)
        land.last_used[stays] = PINNED
        self.pinned_bytes = int(land.cost[stays].sum())

    def charge_index(self, index_bytes: int) -> None:
        """Take the index out of the budget, once.

        Raises
        ------
        ValueError
            When index and pinned tiles alone are too much.
        """
        self.index_bytes = index_bytes + sum(t.nbytes for t in self._tables.values())
        least = self.index_bytes + 2 * self.pinned_bytes
        if least > self.budget_bytes:
            raise ValueError(
                f"budget_bytes: expected at least {least} for the index and the coarsest"
                f" terrain of this store, got {self.budget_bytes}"
            )
        self._peak_bytes = self.index_bytes

    def snapshot(self) -> tuple[int, dict[Lane, U1]]:
        """Book what the renderer said; start a new list. Thread: scene manager.

        Returns
        -------
        number : the new list's
        uploaded : for each lane, (n,) 1 where the tile may be drawn in that list
        """
        with self._lock:
            while self.told:
                state, lane, row = self.told.popleft()
                self._book(lane, row, state)
            self.number += 1
            there = {lane: t.state == State.UPLOADED for lane, t in self._tables.items()}
            return self.number, {
                lane: flags.view(np.uint8) for lane, flags in there.items()
            }

    def _book(self, lane: Lane, row: int, state: State) -> None:
        table = self._tables[lane]
        if state is State.ABSENT and table.state[row] == State.RESIDENT:
            self.counters.tiles_cancelled += 1
        self._move(lane, row, state)
        if state is State.UPLOADED:
            table.last_used[row] = max(int(table.last_used[row]), self.number)
            self.counters.tiles_late += int(table.awaited[row])
            table.awaited[row] = 0
            self.trace.note("uploaded_s", lane, row)

    def _move(self, lane: Lane, row: int, to: State) -> None:
        """Change a state, and the bytes with it. The lock is held."""
        table = self._tables[lane]
        was = State(int(table.state[row]))
        table.state[row] = advance(was, to)
        self._bytes[was] -= table.price(row, was)
        self._bytes[to] += table.price(row, to)
        self._peak_bytes = max(self._peak_bytes, self.used_bytes)
        if to is State.ABSENT:
            self.counters.tiles_unused += was is not State.LOADING and not table.drawn[row]
            table.drawn[row] = table.awaited[row] = 0
            self._queue.done(lane, row)
            self.trace.left(lane, row)

    @property
    def used_bytes(self) -> int:
        """Bytes that count against the budget now."""
        return self.index_bytes + sum(self._bytes.values())

    @property
    def free_bytes(self) -> int:
        """Bytes that may still be taken."""
        return self.budget_bytes - self.used_bytes

    @property
    def in_flight(self) -> bool:
        """Whether a tile is between the queue and the renderer's word that it is there."""
        return bool(self._bytes[State.LOADING] or self._bytes[State.RESIDENT] or self.told)

    def price(self, lane: Lane, rows: Rows) -> NDArray[np.int64]:
        """Return what it takes to load each tile, (w,) bytes."""
        table = self._tables[lane]
        return np.asarray(table.cost[rows] + table.stored[rows])

    def state(self, lane: Lane, row: int) -> State:
        """Return the state of a tile."""
        return State(int(self._tables[lane].state[row]))

    def states(self, lane: Lane) -> U1:
        """Return the states of a lane's tiles, (n,)."""
        return self._tables[lane].state.copy()

    def failed(self, lane: Lane, rows: Rows) -> NDArray[np.bool_]:
        """Say which tiles can't be had, (w,)."""
        return np.asarray(self._tables[lane].state[rows] == State.FAILED)

    def queued(self, lane: Lane, rows: Rows, ranks: F8, cancelled: Rows) -> None:
        """Book what a manager put into the queue and took out. Thread: its manager."""
        with self._lock:
            state = self._tables[lane].state
            state[cancelled[state[cancelled] == State.QUEUED]] = State.ABSENT
            state[rows[state[rows] == State.ABSENT]] = State.QUEUED
            self.counters.tiles_cancelled += len(cancelled)
            self.trace.asked(lane, rows, ranks)
            self.trace.cancelled(lane, cancelled)

    def reserve(self, lane: Lane, row: int) -> bool:
        """Pay for a tile that is about to be read, if there is room. Thread: its server."""
        with self._lock:
            table = self._tables[lane]
            if table.price(row, State.LOADING) > self.free_bytes:
                table.state[row] = State.ABSENT
                self._queue.done(lane, row)
                return False
            self._move(lane, row, State.LOADING)
            self.trace.note("taken_s", lane, row)
            return True

    def deliver(self, lane: Lane, row: int, tile: object) -> None:
        """Hand a decoded tile towards the renderer. Thread: its server."""
        with self._lock:
            self._move(lane, row, State.RESIDENT)
            self.trace.note("decoded_s", lane, row)
            self.counters.tiles_loaded += 1
            self.ready[lane, row] = tile

    def drop(self, lane: Lane, row: int) -> None:
        """Give up a tile that is no longer wanted. Thread: its server."""
        with self._lock:
            self.counters.tiles_cancelled += 1
            if self._tables[lane].state[row] == State.LOADING:
                self._move(lane, row, State.ABSENT)
            else:
                self._tables[lane].state[row] = State.ABSENT
                self._queue.done(lane, row)

    def fail(self, lane: Lane, row: int) -> None:
        """Never ask for a tile again. Thread: its server."""
        with self._lock:
            self._move(lane, row, State.FAILED)
            self.has_failures = True

    def count_read(self, lane: Lane, row: int, stored_bytes: int) -> None:
        """Count bytes that came from the store. Thread: servers."""
        with self._lock:
            self.counters.bytes_read += stored_bytes
            self.trace.note("read_s", lane, row)

    def used(self, lane: Lane, rows: Rows, number: int) -> None:
        """Say that list `number` needs these tiles. Thread: scene manager."""
        last = self._tables[lane].last_used
        last[rows] = np.maximum(last[rows], number)

    def drew(self, lane: Lane, drawn: Rows, awaited: Rows) -> None:
        """Say what a published list draws and what it has stand-ins for."""
        self._tables[lane].drawn[drawn] = 1
        self._tables[lane].awaited[awaited] = 1
        with self._lock:
            self.trace.drew(lane, drawn, awaited)

    def unused_now(self) -> int:
        """Count tiles that are in memory and have not been drawn."""
        return sum(table.unused() for table in self._tables.values())

    def keep_again(self, lane: Lane, rows: Rows) -> bool:
        """Take back evictions that the renderer has not been told of; say if there were."""
        kept = False
        with self._lock:
            state = self._tables[lane].state
            back = {(lane, row) for row in rows[state[rows] == State.RELEASING].tolist()}
            entries = list(self.released) if back else []
            for entry in [one for one in entries if one[1:] in back]:
                try:
                    self.released.remove(entry)
                except (ValueError, IndexError):
                    continue  # the renderer was faster
                self._move(lane, entry[2], State.UPLOADED)
                kept = True
        return kept

    @property
    def coming_bytes(self) -> int:
        """Free bytes, counting those that the renderer is about to release."""
        return self.free_bytes + self._bytes[State.RELEASING]

    def make_room(self, target_bytes: int, older_than: int) -> bool:
        """Evict until `target_bytes` will be free; say whether anything was evicted.

        Parameters
        ----------
        target_bytes : room that the requests would fill
        older_than : only tiles that no list from this number on needs may go
        """
        with self._lock:
            missing = target_bytes - self.coming_bytes
            if missing <= 0:
                return False
            missing += self.budget_bytes // SLACK_SHARE
            oldest = first_to_go(self._tables, self.leaving, older_than, missing)
            for lane, rows in oldest.items():
                self._evict(lane, rows)
            return any(len(rows) for rows in oldest.values())

    def _evict(self, lane: Lane, rows: Rows) -> None:
        """Let uploaded tiles go as soon as no list draws them. The lock is held."""
        table = self._tables[lane]
        table.state[rows] = State.RELEASING
        freed = int(table.cost[rows].sum())
        self._bytes[State.UPLOADED] -= freed
        self._bytes[State.RELEASING] += freed
        self.released.extend(zip(repeat(self.number + 1), repeat(lane), rows.tolist()))

    def memory(self) -> dict[str, int]:
        """Return the bytes of each kind, and the most that were ever taken together."""
        with self._lock:
            return {
                "budget_bytes": self.budget_bytes,
                "index_bytes": self.index_bytes,
                "resident_bytes": self._bytes[State.RESIDENT],
                "uploaded_bytes": self._bytes[State.UPLOADED]
                + self._bytes[State.RELEASING],
                "in_flight_bytes": self._bytes[State.LOADING],
                "peak_bytes": self._peak_bytes,
            }
