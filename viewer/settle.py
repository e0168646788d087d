# SPDX-License-Identifier: Apache-2.0
"""Draw one view until nothing better is to come."""

import time
from typing import Protocol

from geopage.draw_list import DrawList
from geopage.exchange import Upload
from geopage.pager import Pager
from geopage.view import ViewState
from tiles.lanes import Lane
from tiles.objects import ObjectTile
from tiles.terrain import TerrainTile
from viewer.frame_stats import FrameStats
from viewer.renderer import Renderer

UPLOAD_BYTES = 8 << 20
FRAMES = 2  # settled is: nothing wanted and nothing in flight for this many frames


class Uploader(Protocol):
    """What a renderer does with tiles."""

    def upload(self, lane: Lane, row: int, tile: TerrainTile | ObjectTile) -> bool:
        """Copy a tile to the GPU; False where there is no room."""

    def free(self, lane: Lane, row: int) -> None:
        """Give its memory back."""


class Feeder:
    """Moves tiles from a pager to a renderer, the best first.

    A tile that finds no time or no room goes back to be ranked again: what is more
    urgent by then comes before it, and what is stale is dropped.
    """

    def __init__(self, pager: Pager, renderer: Uploader) -> None:
        self._pager, self._renderer = pager, renderer

    def feed(
        self, list_number: int, max_bytes: int = UPLOAD_BYTES, max_s: float = 1.0
    ) -> int:
        """Free what the pager released, upload what it loaded; returns tiles uploaded.

        Parameters
        ----------
        list_number : of the list that was drawn last; its frame is finished
        max_bytes : tiles of no more than this, but one at least
        max_s : after this long no further upload begins
        """
        end = time.perf_counter() + max_s
        for lane, row in self._pager.releases(list_number):
            self._renderer.free(lane, row)
            self._pager.released(lane, row)
        moved, left = 0, list[Upload]()
        # Where the best find no room, others may.
        while not moved and time.perf_counter() <= end:
            if not (ready := self._pager.take_uploads(max_bytes)):
                break
            kept = [item for item in ready if not self._upload(item, end)]
            moved, left = len(ready) - len(kept), left + kept
        self._pager.put_back(left)
        return moved

    def _upload(self, item: Upload, end: float) -> bool:
        if time.perf_counter() > end:
            return False
        if not self._renderer.upload(item.lane, item.row, item.tile):
            return False
        self._pager.uploaded(item.lane, item.row)
        return True


def render_settled(
    pager: Pager,
    renderer: Renderer,
    view: ViewState,
    timeout_s: float = 60.0,
    *,
    threads: bool = False,
) -> tuple[DrawList, FrameStats]:
    """Page and draw one view until it is settled; its picture is then in the renderer.

    Parameters
    ----------
    threads : the pager was started; otherwise it is stepped here

    Raises
    ------
    TimeoutError
        When it is not settled in time.
    """
    feeder = Feeder(pager, renderer)
    pager.view(view)
    end, still = time.monotonic() + timeout_s, 0
    drawn = pager.draw_list()
    while still < FRAMES:
        if time.monotonic() > end:
            raise TimeoutError(f"the view is not settled after {timeout_s:g} s")
        if threads:
            time.sleep(0.001)
        else:
            pager.step(time.monotonic())
        drawn = pager.draw_list()
        moved = feeder.feed(drawn.number)
        still = still + 1 if drawn.settled and pager.complete and not moved else 0
    drawn = drawn.solid()  # nobody has to watch the fades
    return drawn, renderer.draw(drawn, view)
