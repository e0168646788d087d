# SPDX-License-Identifier: Apache-2.0
"""Our own: screen error removed for each byte read, now and a little ahead.

What the newest view misses comes first, by `geopage.benefit.ranks`; then what the views
of half a second and of a second ahead will miss, by the same measure. Least recently
used goes first.
"""

from geopage.benefit import merged_ranks
from geopage.policies.protocol import (
    LeastRecentlyUsed,
    PageRequests,
    Plan,
    Requests,
    Situation,
)
from geopage.prediction import AHEAD, predict
from geopage.selection import Selection
from tiles.lanes import Lane


class Benefit(LeastRecentlyUsed):
    """Benefit for each byte, with prediction in spare bandwidth."""

    def __init__(self) -> None:
        self._turn = 0
        self._later: dict[float, Selection] = {}

    def plan(self, seen: Situation) -> Plan:
        """Rank what is missing now and at predicted views."""
        later = self._look_ahead(seen)
        requests: Requests = {}
        for lane in Lane:
            now = seen.chosen.wants[lane]
            ahead = [(weight, one.wants[lane]) for weight, one in later]
            requests[lane] = PageRequests(*merged_ranks(now, ahead), len(now.rows))
        return Plan(requests, [one.keep for _, one in later])

    def _look_ahead(self, seen: Situation) -> list[tuple[float, Selection]]:
        """Look at one of the predicted views each time, in turn: that is often enough."""
        if seen.motion is None:
            self._later = {}
            return []
        self._turn = (self._turn + 1) % len(AHEAD)
        ahead_s, weight = AHEAD[self._turn]
        soon = predict(seen.view, seen.motion, ahead_s)
        self._later[weight] = seen.look(seen.lens(soon))
        return list(self._later.items())
