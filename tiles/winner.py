# SPDX-License-Identifier: Apache-2.0
"""Which source the ground of a place comes from, decided by the sources' own posts."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles.frames import WGS84_A_M, Floats
from tiles.geodesy import to_ecef
from tiles.kernels import kernel
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

    def at(self, lon_rad: Floats, lat_rad: Floats) -> list[Winner]:
        """Return the finest source that has data at each place, (n,)."""
        source = np.full(len(lon_rad), None, object)
        feathered = np.zeros(len(lon_rad), bool)
        spacing_m, outside = np.full(len(lon_rad), np.inf), []
        left = np.arange(len(lon_rad))
        for raster in self._rasters:
            covered = raster.covers(lon_rad[left], lat_rad[left])
            source[left[covered]], spacing_m[left[covered]] = raster.name, raster.spacing_m
            left = left[~covered]
            outside.append(left)
        for raster, left in zip(self._rasters, outside, strict=True):
            for own_m in np.unique(spacing_m[left]):
                some = left[(spacing_m[left] == own_m) & ~feathered[left]]
                # Real posts are bent over one of them, however wide the feather.
                reach_m = min(raster.reach_m, float(own_m) + raster.spacing_m)
                near = some[raster.is_near(lon_rad[some], lat_rad[some], reach_m)]
                feathered[near] = raster.reaches(lon_rad[near], lat_rad[near], reach_m)
        pairs = zip(source.tolist(), feathered.tolist(), strict=True)
        return [Winner(*pair) for pair in pairs]


class _Raster:
    """The posts of one source."""

    def __init__(self, store: Store, source: dict[str, Any], cache: BlockCache) -> None:
        self.name = str(source["name"])
        self.reach_m = float(source.get("reach_m", 0.0))
        self.spacing_m = float(source["spacing_m"])
        self._place = Placement(source)
        self._shape = int(source["height"]), int(source["width"])
        key = str(source["blocks"])
        self._blocks = Blocks(
            store.connection, key, self._shape, wraps=self._place.wraps, cache=cache
        )
        self._closes = self._place.closes

    def covers(self, lon_rad: Floats, lat_rad: Floats) -> NDArray[np.bool_]:
        """Say which places, (n,), lie in one of the source's triangles."""
        covered = self._place.near(lon_rad, lat_rad)
        there = np.flatnonzero(covered)
        height, width = self._shape
        col, row = self._place.pixels(lon_rad[there], lat_rad[there])
        row = np.maximum(row, 0.0) if self._closes[0] else row
        row = np.minimum(row, height - 1.0) if self._closes[1] else row
        inner_row = np.clip(row, 0.0, height - 1.0)
        inner_col = col if self._place.wraps else np.clip(col, 0.0, width - 1.0)
        off = np.maximum(np.abs(row - inner_row), np.abs(col - inner_col))
        c, r = np.floor(inner_col).astype(np.int64), inner_row.astype(np.int64)
        x, y = inner_col - c, inner_row - r
        known = off <= ROUNDING
        weights = 1.0 - np.maximum(x, y), x - y, y - x, np.minimum(x, y)
        for k, weight in enumerate(weights):
            post = self._blocks.posts_at(r + k // 2, c + k % 2)
            known &= np.isfinite(post) | (weight <= 0.0)
        covered[there] = known
        return covered

    def is_near(
        self, lon_rad: Floats, lat_rad: Floats, reach_m: float
    ) -> NDArray[np.bool_]:
        """Say which places, (n,), are in the source's box or within a distance of it."""
        return self._place.near(lon_rad, lat_rad, reach_m)

    def reaches(
        self, lon_rad: Floats, lat_rad: Floats, reach_m: float
    ) -> NDArray[np.bool_]:
        """Say of which places, (n,), a post with data is within a distance."""
        pixel = np.stack(self._place.pixels(lon_rad, lat_rad))
        # Places side by side look at the same posts.
        reach_posts = max(reach_m / self.spacing_m, 1.0)
        _, group = np.unique(pixel // reach_posts, axis=1, return_inverse=True)
        reached = np.zeros(len(lon_rad), bool)
        for k in range(int(group.max(initial=-1)) + 1):
            some = np.flatnonzero(group == k)
            col, row, posts = self._around(lon_rad[some], lat_rad[some], reach_m)
            at = np.nonzero(np.isfinite(posts))
            there = to_ecef(*self._place.places(col[at], row[at]), 0.0)
            here = to_ecef(lon_rad[some], lat_rad[some], 0.0)
            reached[some] = _any_within(here, there, reach_m)
        return reached

    def _around(
        self, lon_rad: Floats, lat_rad: Floats, reach_m: float
    ) -> tuple[Floats, Floats, NDArray[np.generic]]:
        """Return columns, rows and heights of halved posts within a distance."""
        north = reach_m / WGS84_A_M
        east = north / max(float(np.cos(lat_rad).min()), 0.01)
        off = np.array([[0.0], [1.0], [-1.0]])
        side = (lon_rad + east * off).ravel(), np.tile(lat_rad, 3)
        up = np.tile(lon_rad, 3), (lat_rad + north * off).ravel()
        pixels = [self._place.pixels(*one) for one in (side, up)]
        cols, rows = (np.concatenate(both) for both in zip(*pixels, strict=True))
        height, width = self._shape
        level, last = 0, level_count(width, height) - 1
        spread = max(float(np.ptp(x.reshape(6, -1), axis=0).max()) for x in (cols, rows))
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


@kernel
def _any_within(here: Floats, there: Floats, reach_m: float) -> NDArray[np.bool_]:
    """Say of which points, (n, 3), one of the others, (m, 3), is within a distance."""
    found = np.zeros(len(here), np.bool_)
    for i in range(len(here)):
        for j in range(len(there)):
            x = here[i, 0] - there[j, 0]
            y = here[i, 1] - there[j, 1]
            z = here[i, 2] - there[j, 2]
            if x * x + y * y + z * z <= reach_m * reach_m:
                found[i] = True
                break
    return found
