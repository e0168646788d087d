# SPDX-License-Identifier: Apache-2.0
"""A pager by a virtual clock, and a renderer that only counts.

Every frame takes `FRAME_S`; selecting, reading and decoding take no time, a throttled
line takes what it says. So two runs do the same on any machine. Nothing is drawn and,
unless `dry` is off, nothing is read.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geopage.draw_list import DrawList
from geopage.exchange import Upload
from geopage.pager import Pager
from geopage.residency import Key
from geopage.selection import trees_of
from geopage.settings import PagerSettings
from geopage.tile_state import State
from geopage.view import ViewState
from tiles import cells
from tiles.closing import Closing
from tiles.lanes import Lane
from viewer.flight import FRAME_S, UPLOAD_BYTES
from viewer.stability.site import Site

HIGH_M = 1e7
PLAIN = PagerSettings(fade_s=0.0)
ZONES = 32
PATIENCE = 2000
"""Frames after which something never happens."""


def approach(site: Site, above_m: float, seconds: float = 4.0) -> Iterator[ViewState]:
    """Fly in from far above."""
    count = round(seconds / FRAME_S)
    for i, height_m in enumerate(np.geomspace(HIGH_M, above_m, count).tolist()):
        yield site.view(height_m, t_s=i * FRAME_S)


@dataclass(slots=True)
class Seen:
    """What happened, frame by frame."""

    lists: list[DrawList] = field(default_factory=list)
    uploads: list[list[Key]] = field(default_factory=list)
    upload_bytes: list[int] = field(default_factory=list)
    loads: list[int] = field(default_factory=list)
    """tiles read and decoded in the frame"""
    holes: int = 0
    """frames whose list does not cover the globe, or draws what is not there"""
    over_budget: int = 0
    """frames in which more bytes were taken than the budget has"""


class Trial(Closing):
    """One pager under a test. Thread: the one that made it."""

    def __init__(
        self,
        store: Path,
        settings: PagerSettings = PLAIN,
        *,
        upload_bytes: int = UPLOAD_BYTES,
        dry: bool = True,
        holds: bool = False,
    ) -> None:
        self.pager = Pager(store, settings, dry=dry)
        self.trees = trees_of(self.pager.forests)
        self.seen = Seen()
        self.now_s = 0.0
        self.uploads_per_frame = upload_bytes
        self._cell = self.pager.forests[Lane.TERRAIN].records["cell"]
        self._held: dict[Key, object] | None = {} if holds else None
        """decoded tiles, as long as a renderer has them"""
        self.there = {
            lane: np.zeros(len(tree.parent), np.uint8) for lane, tree in self.trees.items()
        }

    def frame(self, view: ViewState, *, uploads: bool = True) -> DrawList:
        """Do one frame of a render loop, and what the threads do meanwhile.

        Parameters
        ----------
        uploads : False: the renderer is stalled and takes nothing over
        """
        pager = self.pager
        pager.view(view)
        drawn = pager.draw_list()
        for lane, row in pager.releases(drawn.number):
            self.there[lane][row] = 0
            if self._held is not None:
                del self._held[lane, row]
            pager.released(lane, row)
        taken = pager.take_uploads(self.uploads_per_frame) if uploads else []
        for item in taken:
            self.there[item.lane][item.row] = 1
            if self._held is not None:
                self._held[item.lane, item.row] = item.tile
            pager.uploaded(item.lane, item.row)
        before = pager.counters["tiles_loaded"]
        pager.advance(self.now_s, self.now_s + FRAME_S)
        self.now_s += FRAME_S
        self._write_down(drawn, taken, pager.counters["tiles_loaded"] - before)
        return drawn

    def _write_down(self, drawn: DrawList, taken: list[Upload], loads: int) -> None:
        seen, memory = self.seen, self.pager.memory()
        cost = {lane: tree.memory_bytes for lane, tree in self.trees.items()}
        seen.lists.append(drawn)
        seen.uploads.append([(item.lane, item.row) for item in taken])
        seen.upload_bytes.append(sum(int(cost[i.lane][i.row]) for i in taken))
        seen.loads.append(loads)
        seen.holes += not self._is_whole(drawn)
        seen.over_budget += memory["peak_bytes"] > memory["budget_bytes"]

    def _is_whole(self, drawn: DrawList) -> bool:
        """Say whether a list covers the globe once, with tiles that are there."""
        if not drawn.number:
            return True
        shares = 0.25 ** cells.level(self._cell[drawn.terrain])
        there = self.there[Lane.TERRAIN][drawn.terrain].all()
        there &= self.there[Lane.OBJECTS][drawn.objects].all()
        return bool(shares.sum() == ZONES and there)

    def check(self) -> None:
        """Raise what no test may see: a hole, or more memory than the budget.

        Raises
        ------
        AssertionError
        """
        seen = self.seen
        if seen.holes or seen.over_budget:
            raise AssertionError(
                f"{seen.holes} holes, {seen.over_budget} times over budget"
            )

    def fly(self, views: Iterable[ViewState]) -> None:
        """Show a frame of each view."""
        for view in views:
            self.frame(view)

    def settle_globe(self, view: ViewState) -> None:
        """Show a view until its first list is there."""
        for _ in range(PATIENCE):
            if self.frame(view).number:
                return
        raise TimeoutError(f"no list after {PATIENCE} frames")

    def pile_up(self, view: ViewState, count: int) -> None:
        """Show a view, and take nothing over until so many decoded tiles wait.

        Raises
        ------
        TimeoutError
            When the view does not want so many.
        """
        for _ in range(PATIENCE):
            if len(self.at(State.RESIDENT)) >= count:
                return
            self.frame(view, uploads=False)
        raise TimeoutError(f"the view never has {count} tiles that wait for their upload")

    def settle(self, view: ViewState, frames: int = PATIENCE) -> int:
        """Show one view until it has all that it wants; return how many frames it took.

        Raises
        ------
        TimeoutError
        """
        for i in range(frames):
            if self.frame(view).number and self.pager.complete:
                return i + 1
        raise TimeoutError(f"the view is not settled after {frames} frames")

    def decoded(self, lane: Lane) -> list[int]:
        """Return the rows of a lane that wait for their upload."""
        return np.flatnonzero(self.pager.states(lane) == State.RESIDENT).tolist()

    def at(self, *states: State) -> set[Key]:
        """Return the tiles that are in one of some states."""
        return {
            (lane, row)
            for lane in Lane
            for row in np.flatnonzero(np.isin(self.pager.states(lane), states)).tolist()
        }

    def close(self) -> None:
        """Stop the threads."""
        self.pager.close()
