# SPDX-License-Identifier: Apache-2.0
"""Which source the ground of a place comes from, decided by the sources' own posts."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles.frames import WGS84_A_M, Floats
from tiles.geodesy import to_ecef
from tiles.placement import Placement
from tiles.raster_blocks import BlockCache, Blocks, level_count, level_shape
from tiles.store import Store

ROUNDING = 1e-6
"""Places this little outside, in posts, count as on the edge."""
SEARCHED_POSTS = 24
"""Posts of a halved copy that are looked at each way, for data within the feather."""


class Winner(NamedTuple):
    """Where the ground of a place comes from."""

    source: str | None
    """the finest source with data there; None where there is none"""
    feathered: bool
    """a finer source's posts are so near that they bend the ground"""


class Winners:
    """Says which source wins at a place. Thread: the one that made the store."""

    def __init__(self, store: Store) -> None:
        # Of two alike, the later one lies above.
        latest_first = store.sources("terrain")[::-1]
        finest_first = sorted(latest_first, key=lambda s: float(s["spacing_m"]))
        cache = BlockCache()
        self._rasters = [_Raster(store, source, cache) for source in finest_first]

    def at(self, lon_rad: float, lat_rad: float) -> Winner:
        """Return the finest source that has data at a place."""
        place = np.array([lon_rad]), np.array([lat_rad])
        feathered = False
        for raster in self._rasters:
            if raster.covers(*place):
                return Winner(raster.name, feathered)
            feathered = feathered or raster.reaches(*place)
        return Winner(None, feathered)


class _Raster:
    """The posts of one source."""

    def __init__(self, store: Store, source: dict[str, Any], cache: BlockCache) -> None:
        self.name = str(source["name"])
        self._reach_m = float(source.get("reach_m", 0.0))
        self._place = Placement(source)
        self._shape = int(source["height"]), int(source["width"])
        key = str(source["blocks"])
        self._blocks = Blocks(
            store.connection, key, self._shape, wraps=self._place.wraps, cache=cache
        )
        self._closes = self._place.closes

    def covers(self, lon_rad: Floats, lat_rad: Floats) -> bool:
        """Say whether a place lies in one of the source's triangles."""
        if not self._place.near(lon_rad, lat_rad)[0]:
            return False
        height, width = self._shape
        col, row = (float(one[0]) for one in self._place.pixels(lon_rad, lat_rad))
        row = max(row, 0.0) if self._closes[0] else row
        row = min(row, height - 1.0) if self._closes[1] else row
        inner_row = min(max(row, 0.0), height - 1.0)
        inner_col = col if self._place.wraps else min(max(col, 0.0), width - 1.0)
        if max(abs(row - inner_row), abs(col - inner_col)) > ROUNDING:
            return False
        c, r = int(np.floor(inner_col)), int(inner_row)
        x, y = inner_col - c, inner_row - r
        weights = np.array([[1.0 - max(x, y), x - y], [y - x, min(x, y)]])
        posts = self._blocks.window(0, r, r + 2, c, c + 2)
        return bool(np.isfinite(posts[weights > 0.0]).all())

    def reaches(self, lon_rad: Floats, lat_rad: Floats) -> bool:
        """Say whether a post with data is within the source's feather, roughly."""
        if not self._place.near(lon_rad, lat_rad, self._reach_m)[0]:
            return False
        col, row, posts = self._around(lon_rad, lat_rad)
        at = np.nonzero(np.isfinite(posts))
        lon, lat = self._place.places(col[at], row[at])
        away = to_ecef(lon, lat, 0.0) - to_ecef(lon_rad, lat_rad, 0.0)
        return bool((np.linalg.norm(away, axis=1) <= self._reach_m).any())

    def _around(
        self, lon_rad: Floats, lat_rad: Floats
    ) -> tuple[Floats, Floats, NDArray[np.generic]]:
        """Return columns, rows and heights of halved posts as far as the feather."""
        north = self._reach_m / WGS84_A_M
        east = north / max(float(np.cos(lat_rad[0])), 0.01)
        lon, lat = lon_rad + np.array([0, east, -east]), lat_rad + np.zeros(3)
        side = self._place.pixels(lon, lat)
        up = self._place.pixels(
            lon_rad + np.zeros(3), lat_rad + np.array([0, north, -north])
        )
        cols, rows = (np.concatenate([a, b]) for a, b in zip(side, up, strict=True))
        height, width = self._shape
        level, last = 0, level_count(width, height) - 1
        spread = max(float(np.ptp(cols)), float(np.ptp(rows)))
        while spread / 2 ** (level + 1) > SEARCHED_POSTS and level < last:
            level += 1
        h, w = level_shape(width, height, level)
        x, y = (cols + 0.5) / 2**level - 0.5, (rows + 0.5) / 2**level - 0.5
        left, right = int(np.floor(x.min())) - 1, int(np.ceil(x.max())) + 2
        top, bottom = max(int(np.floor(y.min())) - 1, 0), min(int(np.ceil(y.max())) + 2, h)
        if not self._place.wraps:
            left, right = max(left, 0), min(right, w)
        at = np.meshgrid(
            np.arange(left, max(right, left)), np.arange(top, max(bottom, top))
        )
        posts = self._blocks.window(level, top, max(bottom, top), left, max(right, left))
        fine = [(one + 0.5) * 2**level - 0.5 for one in at]
        return fine[0], fine[1], posts
