# SPDX-License-Identifier: Apache-2.0
"""One source raster as a function of longitude and latitude."""

import sqlite3
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray

from ingest.datum import undulation_m
from ingest.raster_blocks import Blocks, level_count, level_shape
from ingest.sampling import bilinear_rgb, triangulated
from tiles.frames import Floats


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
        a, b, c, d, e, f = source["transform"]
        self._matrix = np.linalg.inv(np.array([[a, b], [d, e]]))
        self._origin = np.array([c, f])
        crs = pyproj.CRS.from_user_input(source["crs"])
        self._project = self._unproject = None
        if not crs.is_geographic:
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
        west, south, east, north = self.bounds_deg
        lat_deg, margin_deg = np.degrees(lat_rad), margin_m / 111e3
        wide = margin_deg / np.maximum(np.cos(lat_rad), 0.01)
        middle, half = (west + east) / 2, (east - west) / 2
        off_deg = np.abs((np.degrees(lon_rad) - middle + 180.0) % 360.0 - 180.0)
        inside = (lat_deg >= south - margin_deg) & (lat_deg <= north + margin_deg)
        return np.asarray(inside & (off_deg <= half + wide))

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
            raw = self._elevations(*self.pixels(lon_rad[at], lat_rad[at]), step_m)
            out[at] = raw
            known = at[np.isfinite(raw)]
            out[known] += undulation_m(self.datum, lon_rad[known], lat_rad[known])
        return out

    def _elevations(self, col: Floats, row: Floats, step_m: float) -> Floats:
        level = self._level(step_m)
        pole = np.zeros_like(row)
        if self.wraps:
            last = self._shape[0] - 1
            pole = np.clip(np.maximum(-row, row - last) / 0.5, 0.0, 1.0)
            row = np.clip(row, 0.0, last)
        x, y, window = self._window(level, col, row)
        found = triangulated(window, x, y)
        for polar in np.flatnonzero(pole > 0):
            edge = window[0 if row[polar] < 1 else -1]
            found[polar] += pole[polar] * (float(np.nanmean(edge)) - found[polar])
        return found

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
            x, y, window = self._window(self._level(step_m), col[at], row[at])
            out[at] = bilinear_rgb(window, x, y)
        return out

    def _level(self, step_m: float) -> int:
        ratio = max(step_m / self.spacing_m, 1.0)
        return int(np.clip(np.floor(np.log2(ratio) + 1e-6), 0, self._levels - 1))

    def _window(
        self, level: int, col: Floats, row: Floats
    ) -> tuple[Floats, Floats, NDArray[Any]]:
        """Read the posts around places, and give the places' columns and rows in them."""
        x, y = (col + 0.5) / 2**level - 0.5, (row + 0.5) / 2**level - 0.5
        if level:
            x, y = (x if self.wraps else np.maximum(x, 0.0)), np.maximum(y, 0.0)
        left, top = int(np.floor(x.min())), int(np.floor(y.min()))
        right, bottom = int(np.floor(x.max())) + 2, int(np.floor(y.max())) + 2
        if not self.wraps:
            left = max(left, 0)
        top = max(top, 0)
        return x - left, y - top, self._blocks.window(level, top, bottom, left, right)

    def rim(self, most_posts: int, most: int) -> tuple[Floats, Floats, Floats]:
        """Return the posts beside no data or the raster's edge: lon_rad, lat_rad, height_m.

        Parameters
        ----------
        most_posts : size above which a halved copy is searched instead
        most : the rim is thinned to about this many places
        """
        level = 0
        while (self._shape[0] >> level) * (self._shape[1] >> level) > most_posts:
            level += 1
        height, width = level_shape(self._shape[1], self._shape[0], level)
        posts = self._blocks.window(level, 0, height, 0, width)
        known = np.isfinite(posts)
        padded = np.pad(known, 1)
        shifts = [padded[r : r + height, c : c + width] for r in range(3) for c in range(3)]
        row, col = np.nonzero(known & ~np.logical_and.reduce(shifts))
        step = max(1, len(row) // most)
        row, col = row[::step], col[::step]
        places = self._places((col + 0.5) * 2**level - 0.5, (row + 0.5) * 2**level - 0.5)
        height = posts[row, col] + undulation_m(self.datum, *places)
        return *places, height

    def _places(self, col: Floats, row: Floats) -> tuple[Floats, Floats]:
        """Invert `pixels`."""
        pixel = np.stack([col + 0.5, row + 0.5])
        x, y = np.linalg.inv(self._matrix) @ pixel + self._origin[:, None]
        if self._unproject:
            x, y = self._unproject(x, y)
        return np.radians(x), np.radians(y)

    def post_heights(self, col: Floats, row: Floats) -> tuple[Floats, int, int] | None:
        """Return heights of the posts around places, and the first column and row.

        Returns
        -------
        (h, w) float64 m above the ellipsoid, left, top; or None where a needed post
        holds no data or the places reach beyond the raster.
        """
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
        places = self._places(cols.ravel().astype(float), rows.ravel().astype(float))
        return raw + undulation_m(self.datum, *places).reshape(raw.shape), left, top
