# SPDX-License-Identifier: Apache-2.0
"""What became of each tile that was asked for: times and ranks, in bounded memory."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from geopage.tree import F8
from tiles.forest import Rows
from tiles.lanes import Lane

TRACE = np.dtype(
    [
        ("lane", "u1"),
        ("row", "i4"),
        ("asked_s", "f8"),
        ("first_rank", "f8"),
        ("best_rank", "f8"),
        ("last_rank", "f8"),
        ("taken_s", "f8"),
        ("read_s", "f8"),
        ("decoded_s", "f8"),
        ("uploaded_s", "f8"),
        ("drawn_s", "f8"),
        ("awaited_s", "f8"),
        ("cancelled", "i4"),
    ]
)
"""Times are the first of each kind, NaN where it never came to that. awaited_s: from when
on something coarser was drawn in its place."""
MOST = 2**16
LATE_MS = 1.0


class TileTrace:
    """One line for each tile, from when it is asked for until its memory is free.

    The residency's lock protects it.

    Parameters
    ----------
    counts : rows of each lane; empty: nothing is written down
    clock : returns the flight's time, s
    most : lines to keep; what is asked for after that is only counted
    """

    def __init__(
        self, counts: Mapping[Lane, int], clock: Callable[[], float], most: int = MOST
    ) -> None:
        self.left_out = 0
        self._clock = clock
        self._lines = np.zeros(most if counts else 0, TRACE)
        self._count = 0
        # Zero: no line. A row's line is one less than what stands here.
        self._place = {lane: np.zeros(count, np.int32) for lane, count in counts.items()}

    def asked(self, lane: Lane, rows: Rows, ranks: F8) -> None:
        """Note the newest ranks of all that a lane asks for."""
        if not self._place:
            return
        place = self._place[lane]
        fresh = np.flatnonzero(place[rows] == 0)
        room = min(len(fresh), len(self._lines) - self._count)
        self.left_out += len(fresh) - room
        new = slice(self._count, self._count + room)
        self._count += room
        for name in TRACE.names[2:-1] if TRACE.names else ():
            self._lines[name][new] = math.nan
        self._lines["lane"][new], self._lines["row"][new] = lane, rows[fresh[:room]]
        self._lines["asked_s"][new] = self._clock()
        for name in ("first_rank", "best_rank"):
            self._lines[name][new] = ranks[fresh[:room]]
        place[rows[fresh[:room]]] = np.arange(new.start, new.stop) + 1
        there = place[rows] > 0
        at = place[rows[there]] - 1
        self._lines["last_rank"][at] = ranks[there]
        best = np.minimum(self._lines["best_rank"][at], ranks[there])
        self._lines["best_rank"][at] = best

    def note(self, what: str, lane: Lane, row: int) -> None:
        """Note when something first happened to a tile: a field of TRACE."""
        if not self._place:
            return
        line = int(self._place[lane][row]) - 1
        if line >= 0 and math.isnan(self._lines[what][line]):
            self._lines[what][line] = self._clock()

    def cancelled(self, lane: Lane, rows: Rows) -> None:
        """Count requests that were taken back."""
        if not self._place:
            return
        line = self._place[lane][rows] - 1
        self._lines["cancelled"][line[line >= 0]] += 1

    def drew(self, lane: Lane, drawn: Rows, awaited: Rows) -> None:
        """Note what a list draws, and what it has stand-ins for."""
        if not self._place:
            return
        now_s = self._clock()
        for name, rows in (("drawn_s", drawn), ("awaited_s", awaited)):
            line = self._place[lane][rows] - 1
            line = line[line >= 0]
            self._lines[name][line[np.isnan(self._lines[name][line])]] = now_s

    def left(self, lane: Lane, row: int) -> None:
        """Begin a new line when the tile is asked for again."""
        if not self._place:
            return
        if not math.isnan(self._lines["uploaded_s"][self._place[lane][row] - 1]):
            self._place[lane][row] = 0

    def table(self) -> NDArray[np.void]:
        """Return (n,) TRACE, in the order of asking."""
        return self._lines[: self._count].copy()


def late_ms(table: NDArray[np.void]) -> F8:
    """Return for how long something coarser was drawn in place of each tile, (n,).

    0 where the tile was there in time, NaN where it never came.
    """
    late_s = np.maximum(table["uploaded_s"] - table["awaited_s"], 0.0)
    late_s = np.where(np.isnan(table["awaited_s"]), 0.0, late_s)
    return np.asarray(np.where(np.isnan(table["uploaded_s"]), math.nan, late_s) * 1e3)


def summary(table: NDArray[np.void]) -> dict[str, float]:
    """Return lateness and how good predictions were.

    A tile is predicted when it was asked for before any view missed it. Shares are absent
    where there is nothing to share.
    """
    came = ~np.isnan(table["uploaded_s"])
    drawn = ~np.isnan(table["drawn_s"])
    late = late_ms(table[came])
    late = late[late > LATE_MS]
    early = ~(table["awaited_s"] <= table["asked_s"])
    found: dict[str, float] = {"tiles_late": len(late), "tiles_predicted": int(early.sum())}
    if len(late):
        for percent in (50, 95):
            found[f"late_p{percent}_ms"] = float(np.percentile(late, percent))
        found["late_max_ms"] = float(late.max())
    if (came & early).any():
        found["prediction_hit_share"] = float(drawn[came & early].mean())
        in_time = np.isnan(table["awaited_s"][came & early])
        found["prediction_in_time_share"] = float(in_time.mean())
    if came.any():
        found["never_drawn_share"] = float(1 - drawn[came].mean())
    return found
