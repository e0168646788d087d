# SPDX-License-Identifier: Apache-2.0
"""One source raster as a function of longitude and latitude."""

import sqlite3
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.sampling import bilinear_rgb, triangulated
from tiles import cells
from tiles.frames import Floats
from tiles.placement import Placement
from tiles.raster_blocks import BLOCK, Blocks, level_count, level_shape

POLAR_DEG = 89.9999


class Layer:
    """Posts of one source, read from the store at the resolution that is asked for."""

    def __init__(self, connection: sqlite3.Connection, source: dict[str, Any]) -> None:
        self.name = str(source["name"])
        self.spacing_m = float(source["spacing_m"])
        self.vertical_step_m = float(source.get("vertical_step_m", 0.0))
        self._place = Placement(source)
        self.bounds_deg, self.wraps = self._place.bounds_deg, self._place.wraps
        self.is_projected = self._place.is_projected
        self.pixels, self.near = self._place.pixels, self._place.near
        self._shape = (int(source["height"]), int(source["width"]))
        self._blocks = Blocks(
            connection, str(source["blocks"]), self._shape, wraps=self.wraps
        )
        self.is_picture = self._blocks.bands == 3
        self._levels = level_count(self._shape[1], self._shape[0])
        south, north = self.bounds_deg[1], self.bounds_deg[3]
        polar = self.wraps and north > POLAR_DEG, self.wraps and south < -POLAR_DEG
        self._polar = polar if source["transform"][4] < 0 else polar[::-1]
        self._pole_means: dict[tuple[int, int], float] = {}

    def heights(self, lon_rad: Floats, lat_rad: Floats, step_m: float) -> Floats:
        """Return heights above the ellipsoid, NaN where the source has none.

        Parameters
        ----------
        lon_rad, lat_rad : (n,) float64
        step_m : distance of the wanted points; posts closer than that are averaged
        """
        out = np.full(lon_rad.shape, np.nan)
        at = np.flatnonzero(self.near(lon_rad, lat_rad))
        if len(at):
            out[at] = self._heights(*self.pixels(lon_rad[at], lat_rad[at]), step_m)
        return out

    def _heights(self, col: Floats, row: Floats, step_m: float) -> Floats:
        level = self._level(step_m)
        last = self._shape[0] - 1
        inner = np.clip(
            row,
            0.0 if self._polar[0] else -np.inf,
            last if self._polar[1] else np.inf,
        )
        found = triangulated(*self._window(level, col, inner))
        # Beyond the last row the surface closes over the pole, at that row's mean.
        for edge, beyond in ((0, -row), (-1, row - last)):
            if self._polar[edge]:
                at = np.flatnonzero(beyond > 0.0)
                if len(at):
                    part = np.minimum(beyond[at] / 0.5, 1.0)
                    found[at] += part * (self._pole_mean(level, edge) - found[at])
        return found

    def _pole_mean(self, level: int, edge: int) -> float:
        """Return the mean of a level's first or last row, NaN when it has no data."""
        if (level, edge) not in self._pole_means:
            height, width = level_shape(self._shape[1], self._shape[0], level)
            row = 0 if edge == 0 else height - 1
            posts = self._blocks.window(level, row, row + 1, 0, width)
            known = posts[np.isfinite(posts)].astype(np.float64)
            self._pole_means[level, edge] = float(known.mean()) if len(known) else np.nan
        return self._pole_means[level, edge]

    def colours(
        self, lon_rad: Floats, lat_rad: Floats, step_m: float
    ) -> NDArray[np.float32]:
        """Return the picture's sRGB colours, (n, 3) float32 0..255, NaN outside."""
        out = np.full((*lon_rad.shape, 3), np.nan, np.float32)
        col, row = self.pixels(lon_rad, lat_rad)
        height, width = self._shape
        inside = self.near(lon_rad, lat_rad) & (row > -0.6) & (row < height - 0.4)
        at = np.flatnonzero(inside & (self.wraps | ((col > -0.6) & (col < width - 0.4))))
        if len(at):
            out[at] = bilinear_rgb(*self._window(self._level(step_m), col[at], row[at]))
        return out

    def _level(self, step_m: float) -> int:
        ratio = max(step_m / self.spacing_m, 1.0)
        return int(np.clip(np.floor(np.log2(ratio) + 1e-6), 0, self._levels - 1))

    def _window(
        self, level: int, col: Floats, row: Floats
    ) -> tuple[NDArray[Any], Floats, Floats]:
        """Read the posts around places, and give the places' columns and rows in them."""
        height, width = level_shape(self._shape[1], self._shape[0], level)
        x, y = (col + 0.5) / 2**level - 0.5, (row + 0.5) / 2**level - 0.5
        if level:
            x, y = (x if self.wraps else np.maximum(x, 0.0)), np.maximum(y, 0.0)
        left, top = int(np.floor(x.min())), int(np.floor(y.min()))
        right, bottom = int(np.floor(x.max())) + 2, int(np.floor(y.max())) + 2
        if not self.wraps:
            left = max(left, 0)
            right = right if level else min(right, width)
        top = max(top, 0)
        bottom = bottom if level else min(bottom, height)
        return self._blocks.window(level, top, bottom, left, right), x - left, y - top

    def rim(self, most: int) -> tuple[Floats, Floats, Floats]:
        """Return the posts beside no data or the raster's edge: lon_rad, lat_rad, height_m.

        Parameters
        ----------
        most : the rim is thinned to about this many places, evenly
        """
        strips = [self._rim_strip(top) for top in range(0, self._shape[0], BLOCK)]
        col, row, height = np.concatenate(strips, axis=1)
        lon, lat = self._place.places(col, row)
        step = -(-len(col) // most) or 1
        keep = np.argsort(cells.cell_at(lon, lat, cells.MAX_LEVEL), kind="stable")[::step]
        lon, lat = lon[keep], lat[keep]
        return lon, lat, height[keep].astype(np.float64)

    def _rim_strip(self, top: int) -> Floats:
        """Find the rim in one strip of blocks: (3, n) columns, rows and heights."""
        height, width = self._shape
        bottom = min(top + BLOCK, height)
        posts = self._blocks.window(0, top - 1, bottom + 1, -1, width + 1)
        known = np.isfinite(posts)
        if not self.wraps:
            known[:, [0, -1]] = False
        if top == 0:
            known[0] = self._polar[0]
        if bottom == height:
            known[-1] = self._polar[1]
        rows, cols = bottom - top, width
        shifts = [known[r : r + rows, c : c + cols] for r in range(3) for c in range(3)]
        row, col = np.nonzero(known[1:-1, 1:-1] & ~np.logical_and.reduce(shifts))
        return np.stack([col, row + top, posts[row + 1, col + 1]]).astype(np.float64)

    def own_surface(self, lon_rad: Floats, lat_rad: Floats) -> "OwnSurface | None":
        """Return the posts around places, as the source's own triangles.

        Returns
        -------
        None where a needed post holds no data or the places reach beyond the raster.
        """
        col, row = self.pixels(lon_rad, lat_rad)
        height, width = self._shape
        left, top = int(np.floor(col.min())), int(np.floor(row.min()))
        right, bottom = int(np.floor(col.max())) + 2, int(np.floor(row.max())) + 2
        beyond = left < 0 or right > width
        if top < 0 or bottom > height or (beyond and not self.wraps):
            return None
        raw = self._blocks.window(0, top, bottom, left, right).astype(np.float64)
        if not np.isfinite(raw).all():
            return None
        at = np.stack([col - left, row - top], axis=1)
        return OwnSurface(raw, at)


@dataclass(frozen=True, slots=True)
class OwnSurface:
    """A part of a source's own triangulated surface."""

    height_m: Floats
    """(h, w) posts, m above the ellipsoid"""
    at: Floats
    """(n, 2) columns and rows of the places that were asked for"""
