# SPDX-License-Identifier: Apache-2.0
"""Paging threads at work beside a render loop that has all its tiles already."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from geopage.pager import Pager
from geopage.settings import MIB, PagerSettings, Throttle
from geopage.view import ViewState
from tiles.closing import Closing

SEED = 3
JUMP_FRAMES = 6
"""Every so many frames the view jumps to another place of the flight."""
ROOM_BYTES = 24 * MIB
"""So little memory that what was there before has to be read again."""


class ServerLoad(Closing):
    """A second pager on the same store, whose servers read and decode at a stated rate.

    Its views jump about on the flight, so it never has all that it wants; what it loads
    is not drawn.

    Parameters
    ----------
    views : of the flight
    bytes_per_s : stored bytes that its servers are to read
    wants_gil : see `Pager.make_way_for`
    """

    def __init__(
        self,
        store: Path,
        settings: PagerSettings,
        views: Sequence[ViewState],
        bytes_per_s: float,
        wants_gil: Callable[[], bool],
    ) -> None:
        with Pager(store, settings, dry=True) as pager:
            budget_bytes = pager.memory()["index_bytes"] + ROOM_BYTES
        line = Throttle(bytes_per_s / MIB)
        self._pager = Pager(
            store, replace(settings, throttle=line, budget_bytes=budget_bytes)
        )
        self._pager.make_way_for(wants_gil)
        order = np.random.default_rng(SEED).permutation(len(views))
        self._views = [views[i] for i in order.tolist()]
        self._frame = 0
        self.turn()
        self._pager.start()

    def turn(self) -> None:
        """Do what a render loop does for a pager in one frame, but for the drawing."""
        pager = self._pager
        pager.view(self._views[self._frame // JUMP_FRAMES % len(self._views)])
        self._frame += 1
        for lane, row in pager.releases(pager.draw_list().number):
            pager.released(lane, row)
        for item in pager.take_uploads(ROOM_BYTES):
            pager.uploaded(item.lane, item.row)

    @property
    def bytes_read(self) -> int:
        """Stored bytes read so far."""
        return self._pager.counters["bytes_read"]

    def close(self) -> None:
        """Stop the threads."""
        self._pager.close()
