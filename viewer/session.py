# SPDX-License-Identifier: Apache-2.0
"""A store that is open for looking at: pager, renderer and what moves tiles between."""

from dataclasses import dataclass
from pathlib import Path

from geopage.draw_list import DrawList
from geopage.pager import Pager
from geopage.settings import PagerSettings
from geopage.source import DECODERS
from geopage.style import Style
from geopage.styling import Styling, styling_of
from geopage.view import ViewState
from tiles.closing import Closing
from tiles.errors import InputError
from tiles.lanes import Lane
from tiles.objects import ObjectTile
from tiles.store import Store
from tiles.surface import Surface
from tiles.terrain import TerrainTile
from viewer.arena import ArenaSize
from viewer.detail import detail_m
from viewer.frame_stats import FrameStats
from viewer.gl import Gl
from viewer.renderer import Renderer
from viewer.settle import Feeder, render_settled


@dataclass(frozen=True, slots=True)
class Picture:
    """How large and how fine pictures are."""

    size_px: tuple[int, int] = (1280, 720)
    supersample: int = 1


class Session(Closing):
    """One store, paged and drawn without a window. Thread: the one that made it."""

    def __init__(
        self,
        path: Path,
        settings: PagerSettings,
        picture: Picture = Picture(),
        style: Style | None = None,
        context: Gl | None = None,
    ) -> None:
        self.store = Store(path)
        self.surface = Surface(self.store)
        if not len(self.surface.forest.records):
            raise InputError(path, "holds no terrain", "run `geopage ingest terrain` first")
        self.settings, self.picture = settings, picture
        styling = styling_of(self.store, style) if style else None
        self.pager = Pager(path, settings)
        self.renderer = Renderer(
            self.pager.forests,
            picture.size_px,
            ArenaSize.for_budget(settings.budget_bytes),
            picture.supersample,
            context,
        )
        self.pager.make_way_for(self.renderer.wants_gil)
        forest = self.pager.forests[Lane.TERRAIN]
        self.renderer.detail_m = detail_m(forest, self.store.sources())
        self._put_on(styling)
        self.feeder = Feeder(self.pager, self.renderer)

    def set_style(self, style: Style | None) -> None:
        """Draw objects in other colours from the next frame on; None: in their own.

        All objects are looked at here and now; no tile is loaded again.

        Raises
        ------
        InputError
            When the style does not suit the store; then the colours stay.
        """
        self._put_on(styling_of(self.store, style) if style else None)

    def _put_on(self, styling: Styling | None) -> None:
        self.styling = styling
        self.renderer.set_styling(styling)

    def settle(self, view: ViewState) -> tuple[DrawList, FrameStats]:
        """Draw a view when everything that it wants is there."""
        return render_settled(self.pager, self.renderer, view)

    def hold(self, wanted: DrawList) -> None:
        """Upload every tile of a list, read here and now, for replays."""
        for lane, rows in ((Lane.TERRAIN, wanted.terrain), (Lane.OBJECTS, wanted.objects)):
            for row in rows.tolist():
                if not self.renderer.is_uploaded(lane, row):
                    self.fetch(lane, row, wanted)

    def fetch(self, lane: Lane, row: int, wanted: DrawList) -> bool:
        """Read and upload a tile of a list; False where the list leaves it no room.

        Raises
        ------
        TileFault
        """
        tile = self.tile(lane, row)
        if self.renderer.upload(lane, row, tile):
            return True
        self._make_room(wanted)
        return self.renderer.upload(lane, row, tile)

    def tile(self, lane: Lane, row: int) -> TerrainTile | ObjectTile:
        """Read a tile, here and now.

        Raises
        ------
        TileFault
        """
        record = self.pager.forests[lane].records[row]
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        return DECODERS[lane](self.store.checked_body(lane, *key))

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
