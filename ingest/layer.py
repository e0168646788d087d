# SPDX-License-Identifier: Apache-2.0
"""One source raster as a function of longitude and latitude."""

import sqlite3
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray

from ingest.datum import undulation_m
from ingest.dem import is_lon_lat
from ingest.raster_blocks import BLOCK, Blocks, level_count, level_shape
from ingest.sampling import bilinear_rgb, triangulated
from tiles import cells
from tiles.frames import Floats
from tiles.kernels import kernel

POLAR_DEG = 89.9999
RADIAN_M = 6.36e6
"""A little less than the earth's radius, so that margins are wide enough."""
ROUNDING = 1e-12


class Layer:
    """Posts of one source, read from the store at the resolution that is asked for."""

    def __init__(self, connection: sqlite3.Connection, source: dict[str, Any]) -> None:
        self.name = str(source["name"])
        self.datum = str(source.get("datum", "ellipsoid"))
        self.spacing_m = float(source["spacing_m"])
        self.vertical_step_m = float(source.get("vertical_step_m", 0.0))
        self.bounds_deg: tuple[float, float, float, float] = tuple(source["bounds_deg"])
        self.wraps = bool(source["wraps"])
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
        a, b, c, d, e, f = source["transform"]
        self._matrix = np.linalg.inv(np.array([[a, b], [d, e]]))
        self._origin = np.array([c, f])
        crs = pyproj.CRS.from_user_input(source["crs"])
        self._project = self._unproject = None
        self.is_projected = not is_lon_lat(crs)
        if self.is_projected:
            self._project = pyproj.Transformer.from_crs(4326, crs, always_xy=True).transform
            self._unproject = pyproj.Transformer.from_crs(
                crs, 4326, always_xy=True
            ).transform

    def pixels(self, lon_rad: Floats, lat_rad: Floats) -> tuple[Floats, Floats]:
        """Return column and row of places, posts at whole numbers."""
        lon_deg, lat_deg = np.degrees(lon_rad), np.degrees(lat_rad)
        if self._project:
            x, y = self._project(lon_deg, lat_deg)
        else:
            x, y = lon_deg, lat_deg
            middle = (self.bounds_deg[0] + self.bounds_deg[2]) / 2
            x = (x - middle + 180.0) % 360.0 - 180.0 + middle
        col, row = self._matrix @ np.stack([x - self._origin[0], y - self._origin[1]])
        if self.wraps:
            width, middle = self._shape[1], float(np.median(col))
            col = middle + (col - middle + width / 2) % width - width / 2
        return col - 0.5, row - 0.5

    def near(
        self, lon_rad: Floats, lat_rad: Floats, margin_m: float = 0.0
    ) -> NDArray[np.bool_]:
        """Say which places are within a margin of the raster's bounding box."""
        return _near(lon_rad, lat_rad, np.radians(self.bounds_deg), margin_m / RADIAN_M)

    def heights(
        self, lon_rad: Floats, lat_rad: Floats, step_m: float, sea: Floats | None = None
    ) -> Floats:
        """Return heights above the ellipsoid, NaN where the source has none.

        Parameters
        ----------
        lon_rad, lat_rad : (n,) float64
        step_m : distance of the wanted points; posts closer than that are averaged
        sea : (n,) heights of EGM96's zero surface, where the caller knows them already
        """
        out = np.full(lon_rad.shape, np.nan)
        at = np.flatnonzero(self.near(lon_rad, lat_rad))
        if len(at):
            raw = self._elevations(*self.pixels(lon_rad[at], lat_rad[at]), step_m)
            out[at] = raw
            known = at[np.isfinite(raw)]
            if sea is not None and self.datum == "egm96":
                out[known] += sea[known]
            else:
                out[known] += undulation_m(self.datum, lon_rad[known], lat_rad[known])
        return out

    def _elevations(self, col: Floats, row: Floats, step_m: float) -> Floats:
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
        col, row, raw = np.concatenate(strips, axis=1)
        lon, lat = self._places(col, row)
        step = -(-len(col) // most) or 1
        keep = np.argsort(cells.cell_at(lon, lat, cells.MAX_LEVEL), kind="stable")[::step]
        lon, lat = lon[keep], lat[keep]
        return lon, lat, raw[keep] + undulation_m(self.datum, lon, lat)

    def _rim_strip(self, top: int) -> Floats:
        """Find the rim in one strip of blocks: (3, n) columns, rows and elevations."""
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

    def _places(self, col: Floats, row: Floats) -> tuple[Floats, Floats]:
        """Invert `pixels`."""
        pixel = np.stack([col + 0.5, row + 0.5])
        x, y = np.linalg.inv(self._matrix) @ pixel + self._origin[:, None]
        if self._unproject:
            x, y = self._unproject(x, y)
        return np.radians(x), np.radians(y)

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
        cols, rows = np.meshgrid(np.arange(left, right), np.arange(top, bottom))
        zero = self._zero(cols, rows)
        between = self._zero(0.5 + cols[:-1, :-1], 0.5 + rows[:-1, :-1])
        slack_m = float(np.abs((zero[:-1, :-1] + zero[1:, 1:]) / 2 - between).max())
        at = np.stack([col - left, row - top], axis=1)
        return OwnSurface(raw + zero, at, slack_m)

    def _zero(self, col: NDArray[Any], row: NDArray[Any]) -> Floats:
        """Return the height of the datum's zero surface at columns and rows."""
        places = self._places(col.ravel().astype(float), row.ravel().astype(float))
        return undulation_m(self.datum, *places).reshape(col.shape)


@kernel
def _near(
    lon_rad: Floats, lat_rad: Floats, box_rad: Floats, margin_rad: float
) -> NDArray[np.bool_]:
    """Say which places, (n,), are in a box or within a margin of it."""
    middle, half = (box_rad[0] + box_rad[2]) / 2, (box_rad[2] - box_rad[0]) / 2 + ROUNDING
    low, high = box_rad[1] - margin_rad - ROUNDING, box_rad[3] + margin_rad + ROUNDING
    out = np.zeros(len(lon_rad), np.bool_)
    for i in range(len(lon_rad)):
        if low <= lat_rad[i] <= high:
            turns = (lon_rad[i] - middle) / (2.0 * np.pi)
            off = abs(turns - np.floor(turns + 0.5)) * 2.0 * np.pi
            out[i] = off <= half or off - half <= margin_rad / max(np.cos(lat_rad[i]), 0.01)
    return out


@dataclass(frozen=True, slots=True)
class OwnSurface:
    """A part of a source's own triangulated surface."""

    height_m: Floats
    """(h, w) posts, m above the ellipsoid"""
    at: Floats
    """(n, 2) columns and rows of the places that were asked for"""
    slack_m: float
    """How far the datum's zero surface bends between posts"""
