# SPDX-License-Identifier: Apache-2.0
"""The one queue of page requests that both lanes share.

Invariant: a row is pending at most once, and never between `pop` and `done`.

It knows lanes and rows, not tiles. A manager replaces its lane's requests as a whole,
because every rank changes with every view; servers pop. Waiting ends when a request of
the lane becomes pending or the queue is closed, so a static view wakes nobody.
"""

import threading
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from geopage.tree import F8, U1
from tiles.forest import Rows
from tiles.lanes import Lane

MOST_PASSED = 16
"""So many requests of others may overtake a lane's best one, however they rank."""


class _Requests:
    """One lane's requests; the queue's lock protects them."""

    def __init__(self, count: int) -> None:
        self.generation = 1
        self.wanted = np.zeros(count, np.int64)
        """(n,) generation that last wanted the row"""
        self.rank = np.full(count, np.inf)
        self.taken: U1 = np.zeros(count, np.uint8)
        self.pending: Rows = np.zeros(0, np.int32)
        self.next = 0
        self.passed = 0
        """requests of other lanes popped while one of this lane was pending"""

    @property
    def length(self) -> int:
        return len(self.pending) - self.next

    @property
    def best(self) -> float:
        """Rank of what is popped next, infinity when nothing is pending."""
        return float(self.rank[self.pending[self.next]]) if self.length else np.inf


class PriorityQueue:
    """Pending requests of both lanes, best rank first. Thread: any.

    Parameters
    ----------
    counts : rows of each lane
    one_line : all lanes read through one slow line: a lane has its turn when its best
        request is the best of all, or has been overtaken `MOST_PASSED` times
    """

    def __init__(self, counts: Mapping[Lane, int], *, one_line: bool = False) -> None:
        self._one_line = one_line
        self._lanes = {lane: _Requests(count) for lane, count in counts.items()}
        self._changed = threading.Condition()
        self._closed = False

    def replace_lane(self, lane: Lane, rows: Rows, ranks: F8) -> Rows:
        """Make these the lane's requests and return the rows that are cancelled.

        Parameters
        ----------
        lane : Lane
        rows : (w,) each row once; rows that are taken stay wanted but not pending
        ranks : (w,) smaller is sooner
        """
        order = np.argsort(ranks, kind="stable")
        rows, ranks = rows[order], ranks[order]
        with self._changed:
            state = self._lanes[lane]
            state.generation += 1
            state.wanted[rows] = state.generation
            state.rank[rows] = ranks
            old = state.pending[state.next :]
            state.pending, state.next = rows[state.taken[rows] == 0], 0
            if state.length or self._one_line:
                self._changed.notify_all()
            return np.asarray(old[state.wanted[old] != state.generation])

    def pop(self, lane: Lane) -> int | None:
        """Take the lane's best request, or None; the row is taken until `done`."""
        with self._changed:
            state = self._lanes[lane]
            if self._closed or not self._has_turn(lane):
                return None
            row = int(state.pending[state.next])
            state.next += 1
            state.taken[row] = 1
            if self._one_line:
                for other in self._lanes.values():
                    other.passed = other.passed + 1 if other.length else 0
                state.passed = 0
                self._changed.notify_all()
            return row

    def _has_turn(self, lane: Lane) -> bool:
        """Say whether the lane's best request may be popped. The lock is held."""
        state = self._lanes[lane]
        if not (self._one_line and state.length):
            return state.length > 0
        waiting = [other for other in self._lanes.values() if other.length]
        first = [other for other in waiting if other.passed >= MOST_PASSED] or waiting
        return state in first and state.best <= min(other.best for other in first)

    def done(self, lane: Lane, row: int) -> None:
        """Let a taken row be asked for again: it was dropped, or its tile is gone."""
        with self._changed:
            self._lanes[lane].taken[row] = 0

    def is_wanted(self, lane: Lane, row: int) -> bool:
        """Say whether the lane's newest requests hold the row, pending or taken."""
        state = self._lanes[lane]
        return bool(state.wanted[row] == state.generation)

    def ranks(self, lane: Lane, rows: Rows) -> F8:
        """Return the newest ranks of rows, (w,), infinity where one is not wanted."""
        state = self._lanes[lane]
        wanted = state.wanted[rows] == state.generation
        return np.where(wanted, state.rank[rows], np.inf)

    def taken(self, lane: Lane, rows: Rows) -> NDArray[np.bool_]:
        """Say which rows are taken, (w,)."""
        return np.asarray(self._lanes[lane].taken[rows] > 0)

    def pending(self, lane: Lane) -> int:
        """Return the number of pending requests of a lane."""
        return self._lanes[lane].length

    def wait(self, lane: Lane, timeout_s: float | None = None) -> bool:
        """Wait until a request of the lane is pending; False when closed or too late."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._has_turn(lane), timeout_s)
            return not self._closed and self._has_turn(lane)

    @property
    def nbytes(self) -> int:
        """Bytes of the tables over all rows."""
        tables = self._lanes.values()
        return sum(t.wanted.nbytes + t.rank.nbytes + t.taken.nbytes for t in tables)

    def close(self) -> None:
        """Wake everybody; nothing is handed out any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
