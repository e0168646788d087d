# SPDX-License-Identifier: Apache-2.0
"""Pictures with everything that their view wants, each made as if it were the first.

A pager answers a moving eye: what it draws depends on what it drew before, because
detail changes with hysteresis. A film that is interrupted and goes on, and a picture
that a script asks for twice, must not depend on that; so here nothing is paged. The
selection is asked once, what is missing is read there and then, and drawn.
"""

from geopage.draw_list import DrawList
from geopage.pressure import FULL, STEP
from geopage.screen_error import lens_of
from geopage.selection import Thresholds, everything, select, trees_of
from geopage.view import ViewState
from tiles.errors import TileFault
from tiles.lanes import Lane
from viewer.frame_stats import FrameStats
from viewer.session import Session


class CompleteFrames:
    """Draws complete pictures with a session whose pager does nothing meanwhile."""

    def __init__(self, session: Session) -> None:
        self.faults: list[str] = []
        """a line for each tile that can't be used; what stands in for it is drawn"""
        self._session = session
        self._trees = trees_of(session.pager.forests)
        self._there = everything(self._trees)
        memory = session.pager.memory()
        self._room_bytes = FULL * (memory["budget_bytes"] - memory["index_bytes"])

    def draw(self, view: ViewState, limits: Thresholds) -> tuple[DrawList, FrameStats]:
        """Draw a view; where its tiles do not fit the budget, at coarser limits.

        Returns
        -------
        What was drawn, with the thresholds that it keeps, and the frame's figures.
        """
        faults = len(self.faults)
        while not self._is_held(drawn := self._select(view, limits)):
            if len(self.faults) == faults:  # it was room that was missing
                limits = Thresholds(drawn.threshold_px, drawn.object_threshold_px)
                limits = limits.times(STEP)
            faults = len(self.faults)
        return drawn, self._session.renderer.draw(drawn, view)

    def _select(self, view: ViewState, limits: Thresholds) -> DrawList:
        while True:
            chosen = select(self._trees, lens_of(view), self._there, limits)
            if chosen.needed_bytes <= self._room_bytes:
                return chosen.draw_list(1, view, limits, settled=True)
            limits = limits.times(STEP)

    def _is_held(self, drawn: DrawList) -> bool:
        """Upload a list's tiles; False where one has no room, or can't be had."""
        renderer = self._session.renderer
        for lane, rows in ((Lane.TERRAIN, drawn.terrain), (Lane.OBJECTS, drawn.objects)):
            for row in rows.tolist():
                if not renderer.is_uploaded(lane, row) and not self._fetch(
                    lane, row, drawn
                ):
                    return False
        return True

    def _fetch(self, lane: Lane, row: int, drawn: DrawList) -> bool:
        try:
            return self._session.fetch(lane, row, drawn)
        except TileFault as fault:
            self.faults.append(str(fault))
            self._there[lane][row] = 0
            return False
