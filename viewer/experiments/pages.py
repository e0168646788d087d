# SPDX-License-Identifier: Apache-2.0
"""Any flight through any store, paged dry by a virtual clock."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from geopage.draw_list import DrawList
from geopage.view import ViewState
from tiles.frames import Ints
from tiles.lanes import Lane
from viewer.paging import Paging

MOST_STEPS, FIRST_STEP_S = 300, 0.1
"""A first view that is not there after half a minute is not waited for"""
Look = Callable[[int, DrawList, ViewState], None]


@dataclass(slots=True)
class Flown:
    """What a flight came to."""

    first_bytes: int = 0
    """read for the first view, before the clock began"""
    bytes_read: int = 0
    """after that"""
    tiles_read: int = 0
    missing: list[int] = field(default_factory=list)
    """tiles that each view lacks"""
    raised: list[float] = field(default_factory=list)
    """what the thresholds were multiplied by, for want of memory"""
    peak_bytes: int = 0
    index_bytes: int = 0

    @property
    def whole_bytes(self) -> int:
        """All that was read, from a cold start."""
        return self.first_bytes + self.bytes_read


class Flyer(Paging):
    """A dry pager that flies views a step apart."""

    def fly(
        self, views: Iterable[ViewState], step_s: float, look: Look | None = None
    ) -> Flown:
        """Page views one after the other; the first is there before the clock begins."""
        found = Flown()
        start_s, before = 0.0, self.pager.counters
        most_px = self.pager.settings.objects_px
        with self.pager as pager:
            for i, view in enumerate(views):
                if i == 0:
                    start_s = self.begin(view)
                    before = pager.counters
                drawn = self.frame(view)
                found.missing.append(self.lacking(drawn, view))
                found.raised.append(drawn.object_threshold_px / most_px)
                if look:
                    look(i, drawn, view)
                now_s = start_s + i * step_s
                pager.advance(now_s, now_s + step_s)
            after, memory = pager.counters, pager.memory()
        found.first_bytes = before["bytes_read"]
        found.bytes_read = after["bytes_read"] - before["bytes_read"]
        found.tiles_read = after["tiles_loaded"] - before["tiles_loaded"]
        found.peak_bytes, found.index_bytes = memory["peak_bytes"], memory["index_bytes"]
        return found

    def begin(self, view: ViewState) -> float:
        """Load the first view, as far as it fits; return when that is done."""
        for i in range(MOST_STEPS):
            now_s = i * FIRST_STEP_S
            if self.frame(view).number and self.missing(view) == (0, 0):
                break
            self.pager.advance(now_s, now_s + FIRST_STEP_S)
        return now_s

    def lacking(self, drawn: DrawList, view: ViewState) -> int:
        """Count ground tiles that are stood in for, and object tiles that are missing.

        A list that draws finer ground than the view needs lacks nothing.
        """
        return int(drawn.stand_in.sum()) + self.missing(view)[1]

    def held(self, lane: Lane) -> Ints:
        """Return the rows of the tiles that can be drawn now."""
        return np.flatnonzero(self._there[lane])
