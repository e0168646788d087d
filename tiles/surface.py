# SPDX-License-Identifier: Apache-2.0
"""Heights as they are drawn when everything is resident: the finest stored meshes."""

from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from tiles import cells, terrain
from tiles.forest import Forest, build_forest
from tiles.frames import Ecef, Floats
from tiles.geodesy import to_geodetic
from tiles.kernels import kernel
from tiles.lanes import Lane
from tiles.mesh import UV_ONE
from tiles.store import Store
from tiles.terrain import TerrainTile

CACHE_TILES = 256


class Surface:
    """The terrain of a store as a function of place. Thread: the one that made it."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self.forest: Forest = build_forest(store.index(Lane.TERRAIN))
        self._leaves = np.flatnonzero(self.forest.records["children"] == 0)
        cell = self.forest.records["cell"][self._leaves]
        order = np.argsort(cells.range_min(cell)) if len(cell) else np.zeros(0, np.int64)
        self._leaves = self._leaves[order]
        self._first = cells.range_min(cell[order]) if len(cell) else cell
        self._cache: OrderedDict[int, TerrainTile] = OrderedDict()

    def rows(self, lon_rad: Floats, lat_rad: Floats) -> NDArray[np.int64]:
        """Return the forest row of the leaf at each place, -1 where there is no terrain."""
        if not len(self._leaves):
            return np.full(np.shape(lon_rad), -1)
        point = cells.cell_at(lon_rad, lat_rad, cells.MAX_LEVEL)
        leaf = self._leaves[np.searchsorted(self._first, point, side="right") - 1]
        there = cells.contains(self.forest.records["cell"][leaf], point)
        return np.where(there, leaf, -1)

    def heights(self, lon_rad: Floats, lat_rad: Floats) -> tuple[Floats, Floats]:
        """Return heights above the ellipsoid and the tiles' measured errors, m.

        Parameters
        ----------
        lon_rad, lat_rad : (n,) float64

        Returns
        -------
        height_m, error_m : (n,) float64; 0 and inf in a store without terrain

        Raises
        ------
        TileFault
            When a tile's bytes are not what was written.
        """
        height, error = np.zeros(len(lon_rad)), np.full(len(lon_rad), np.inf)
        rows = self.rows(lon_rad, lat_rad)
        for row in np.unique(rows[rows >= 0]):
            at = np.flatnonzero(rows == row)
            tile = self._tile(int(row))
            u, v = cells.uv_in_cell(tile.cell, lon_rad[at], lat_rad[at])
            height[at] = heights_on(tile, u, v)
            error[at] = tile.error_m
        return height, error

    def height_at(self, lon_rad: float, lat_rad: float) -> float:
        """Return the height of one place above the ellipsoid, m."""
        return float(self.heights(np.array([lon_rad]), np.array([lat_rad]))[0][0])

    def _tile(self, row: int) -> TerrainTile:
        if row in self._cache:
            self._cache.move_to_end(row)
            return self._cache[row]
        record = self.forest.records[row]
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        tile = terrain.decode(self._store.checked_body(Lane.TERRAIN, *key))
        self._cache[row] = tile
        if len(self._cache) > CACHE_TILES:
            self._cache.popitem(last=False)
        return tile


def heights_on(tile: TerrainTile, u: Floats, v: Floats) -> Floats:
    """Interpolate a tile at fractions of its cell; (n,) m above the ellipsoid."""
    triangles = tile.mesh.indices[: tile.surface_index_count].reshape(-1, 3)
    detail = tile.mesh.vertices["detail"].astype(np.float64) / UV_ONE
    points = _interpolate(triangles, detail, tile.mesh.local, np.stack([u, v], axis=-1))
    return to_geodetic(Ecef(points + tile.mesh.centre))[2]


@kernel
def _interpolate(
    triangles: NDArray[np.uint16], detail: Floats, local: Floats, places: Floats
) -> Floats:
    """Return the point of the triangle that holds each place, (n, 3) m."""
    points = np.zeros((len(places), 3))
    for i in range(len(places)):
        x, y = places[i, 0], places[i, 1]
        best = -np.inf
        for t in range(len(triangles)):
            a, b, c = triangles[t]
            ax, ay = detail[a, 0] - x, detail[a, 1] - y
            bx, by = detail[b, 0] - x, detail[b, 1] - y
            cx, cy = detail[c, 0] - x, detail[c, 1] - y
            w0, w1, w2 = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
            area = w0 + w1 + w2
            inside = min(w0, w1, w2) / area
            if inside > best:
                best = inside
                for k in range(3):
                    points[i, k] = (
                        w0 * local[a, k] + w1 * local[b, k] + w2 * local[c, k]
                    ) / area
                if inside >= 0.0:
                    break
    return points
