# SPDX-License-Identifier: Apache-2.0
"""Where methods are drawn.

One session is for all that draw the store's own tiles, and one for each kind of mesh
that is made anew; all share one GL context.
"""

from collections import OrderedDict
from pathlib import Path

import numpy as np

from geopage.draw_list import DrawList
from geopage.settings import PagerSettings
from geopage.view import ViewState
from tiles.index_tree import RUNG_FIELDS
from tiles.lanes import Lane
from tiles.objects import ObjectTile
from tiles.terrain import TerrainTile
from viewer.bench_meshes import remeshed, stored_bytes
from viewer.bench_methods import Method
from viewer.drawn_surface import DrawnTiles
from viewer.gl import Gl
from viewer.session import Picture, Session

KEPT_TILES = 512


class Remeshed(Session):
    """A store whose terrain tiles are meshed anew when they are first looked at.

    Their errors and sizes then take the place of the index's own. Nothing is paged.

    Parameters
    ----------
    kind : of mesh, of `bench_meshes.SIDES`
    """

    def __init__(
        self, path: Path, settings: PagerSettings, picture: Picture, kind: str, context: Gl
    ) -> None:
        super().__init__(path, settings, picture, context=context)
        self._kind, self._forest = kind, self.pager.forests[Lane.TERRAIN]
        self._is_known = np.zeros(len(self._forest.records), np.bool_)
        for name in RUNG_FIELDS:
            self._forest.records[name] = 0.0
        self._tiles: OrderedDict[int, TerrainTile] = OrderedDict()

    def tile(self, lane: Lane, row: int) -> TerrainTile | ObjectTile:
        """Return an object tile as it is stored, and a terrain tile meshed anew."""
        return self.made(row) if lane is Lane.TERRAIN else super().tile(lane, row)

    def made(self, row: int) -> TerrainTile:
        """Return a terrain tile with its other mesh."""
        if row not in self._tiles:
            own = super().tile(Lane.TERRAIN, row)
            assert isinstance(own, TerrainTile)
            leaf = not self._forest.records["children"][row]
            self._tiles[row] = remeshed(self.surface, own, self._kind, leaf=leaf)
            if len(self._tiles) > KEPT_TILES:
                self._tiles.popitem(last=False)
        self._tiles.move_to_end(row)
        if not self._is_known[row]:
            self._note(row, self._tiles[row])
        return self._tiles[row]

    def _note(self, row: int, tile: TerrainTile) -> None:
        record = self._forest.records[row]
        self._forest.radius_m[row] += tile.error_m + record["error_m"]
        record["error_m"], record["tile_bytes"] = tile.error_m, stored_bytes(tile)
        self._is_known[row] = True

    def draw_list(self, method: Method, view: ViewState, threshold_px: float) -> DrawList:
        """Return what a method draws, when all is meshed whose error it asks for."""
        while True:
            drawn = method.draw_list(self.pager.forests, view, threshold_px)
            rows = drawn.terrain
            asked = [rows]
            while len(rows := np.unique(self._forest.parent[rows])) and rows[-1] >= 0:
                asked.append(rows := rows[rows >= 0])
            unknown = np.unique(np.concatenate(asked))
            unknown = unknown[~self._is_known[unknown]]
            if not len(unknown):
                return drawn
            for row in unknown.tolist():
                self.made(row)


class MadeTiles(DrawnTiles):
    """The triangles of tiles that were meshed anew."""

    def __init__(self, session: Remeshed) -> None:
        super().__init__(session.store, session.pager.forests[Lane.TERRAIN])
        self._session = session

    def read(self, row: int) -> TerrainTile:
        """Return the tile in a row of the forest."""
        return self._session.made(row)


class Stages:
    """All sessions of a bench, by the kind of mesh; the store's own is the first."""

    def __init__(self, own: Session) -> None:
        self.own = own
        self._others: dict[str, tuple[Remeshed, MadeTiles]] = {}

    def session(self, mesh: str) -> Session:
        """Return the session that draws a kind of mesh."""
        return self._other(mesh)[0] if mesh else self.own

    def tiles(self, mesh: str) -> DrawnTiles | None:
        """Return a kind of mesh as it is drawn; None: as it is stored."""
        return self._other(mesh)[1] if mesh else None

    def draw_list(self, method: Method, view: ViewState, threshold_px: float) -> DrawList:
        """Return what a method draws when all is there."""
        if method.mesh:
            return self._other(method.mesh)[0].draw_list(method, view, threshold_px)
        return method.draw_list(self.own.pager.forests, view, threshold_px)

    def _other(self, mesh: str) -> tuple[Remeshed, MadeTiles]:
        if mesh not in self._others:
            own, gl = self.own, self.own.renderer.gl
            made = Remeshed(own.store.path, own.settings, own.picture, mesh, gl)
            self._others[mesh] = made, MadeTiles(made)
        return self._others[mesh]

    def close(self) -> None:
        """Free what the others took; the first is its maker's."""
        for session, _ in self._others.values():
            session.close()
