# SPDX-License-Identifier: Apache-2.0
"""A renderer without pictures: it uploads, draws, and frees, and checks what it is told."""

import time
from collections.abc import Callable

from geopage.draw_list import DrawList
from geopage.pager import Pager, Upload
from geopage.view import ViewState
from tiles.lanes import Lane


def prime(pager: Pager, upload: Callable[[Upload], None] = lambda _: None) -> DrawList:
    """Load and upload until the first draw list is there; a view must have been given."""
    while not (first := pager.draw_list()).number:
        if pager.wake_ups:
            time.sleep(1e-3)
        else:
            pager.step(time.monotonic())
        for item in pager.take_uploads(2**26):
            upload(item)
            pager.uploaded(item.lane, item.row)
    return first


class StubRenderer:
    """Keeps the set of tiles that it has, as a real one keeps its slots."""

    def __init__(self, pager: Pager, upload_bytes: int = 2**20) -> None:
        self.pager = pager
        self.there: set[tuple[Lane, int]] = set()
        self.upload_bytes = upload_bytes
        self.uploads: list[tuple[Lane, int]] = []

    def upload(self, item: Upload) -> None:
        key = item.lane, item.row
        assert key not in self.there
        assert item.tile.cell == self.pager.forests[item.lane].records["cell"][item.row]
        self.there.add(key)
        self.uploads.append(key)

    def frame(self, view: ViewState) -> DrawList:
        """Do what a render loop does for one frame."""
        self.pager.view(view)
        drawn = self.pager.draw_list()
        assert {(Lane.TERRAIN, int(row)) for row in drawn.terrain} <= self.there
        assert {(Lane.OBJECTS, int(row)) for row in drawn.objects} <= self.there
        for lane, row in self.pager.releases(drawn.number):
            self.there.remove((lane, row))
            self.pager.released(lane, row)
        for item in self.pager.take_uploads(self.upload_bytes):
            self.upload(item)
            self.pager.uploaded(item.lane, item.row)
        memory = self.pager.memory()
        assert memory["peak_bytes"] <= memory["budget_bytes"]
        return drawn

    def settle(self, view: ViewState, frames: int = 3000) -> DrawList:
        """Step frame by frame until nothing is missing."""
        for i in range(frames):
            drawn = self.frame(view)
            if self.pager.settled:
                return drawn
            self.pager.step(view.t_s + i / 60)
        raise AssertionError(f"not settled after {frames} frames: {self.pager.counters}")
