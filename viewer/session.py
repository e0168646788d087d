# SPDX-License-Identifier: Apache-2.0
"""A store that is open for looking at: pager, renderer and what moves tiles between."""

from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from geopage.draw_list import DrawList
from geopage.pager import Pager
from geopage.selection import warm_up
from geopage.settings import PagerSettings
from geopage.source import decoders
from geopage.style import Style
from geopage.styling import styling_of
from geopage.view import ViewState
from tiles.errors import InputError
from tiles.lanes import Lane
from tiles.store import Store
from tiles.surface import Surface
from viewer.arena import ArenaSize
from viewer.frame_stats import FrameStats
from viewer.renderer import Renderer
from viewer.settle import Feeder, render_settled


@dataclass(frozen=True, slots=True)
class Picture:
    """How large and how fine pictures are."""

    size_px: tuple[int, int] = (1280, 720)
    supersample: int = 1


class Session:
    """One store, paged and drawn without a window. Thread: the one that made it."""

    def __init__(
        self,
        path: Path,
        settings: PagerSettings,
        picture: Picture = Picture(),
        style: Style | None = None,
    ) -> None:
        warm_up()
        self.store = Store(path)
        self.surface = Surface(self.store)
        if not len(self.surface.forest.records):
            raise InputError(path, "holds no terrain", "run `geopage ingest terrain` first")
        self.settings, self.picture = settings, picture
        self.styling = styling_of(self.store, style) if style else None
        self._decode = decoders(self.styling)
        self.pager = Pager(path, settings, self.styling)
        self.renderer = Renderer(
            self.pager.forests,
            picture.size_px,
            ArenaSize.for_budget(settings.budget_bytes),
            picture.supersample,
        )
        if self.styling:
            self.renderer.set_palette(self.styling.palette)
        self.feeder = Feeder(self.pager, self.renderer)

    def settle(self, view: ViewState) -> tuple[DrawList, FrameStats]:
        """Draw a view when everything that it wants is there."""
        return render_settled(self.pager, self.renderer, view)

    def hold(self, wanted: DrawList) -> None:
        """Upload every tile of a list, read here and now, for replays."""
        for lane, rows in ((Lane.TERRAIN, wanted.terrain), (Lane.OBJECTS, wanted.objects)):
            records = self.pager.forests[lane].records
            for row in rows.tolist():
                if not self.renderer.is_uploaded(lane, row):
                    record = records[row]
                    key = int(record["cell"]), int(record["row"]), int(record["check"])
                    tile = self._decode[lane](self.store.checked_body(lane, *key))
                    if not self.renderer.upload(lane, row, tile):
                        self._make_room(wanted)
                        self.renderer.upload(lane, row, tile)

    def _make_room(self, wanted: DrawList) -> None:
        """Free every tile that a list does not name."""
        for lane, rows in ((Lane.TERRAIN, wanted.terrain), (Lane.OBJECTS, wanted.objects)):
            keep = set(rows.tolist())
            for row in range(len(self.pager.forests[lane].records)):
                if row not in keep and self.renderer.is_uploaded(lane, row):
                    self.renderer.free(lane, row)

    def close(self) -> None:
        """Stop the pager and free the GPU's memory."""
        self.pager.close()
        self.renderer.release()
        self.store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
