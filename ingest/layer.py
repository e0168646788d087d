# SPDX-License-Identifier: Apache-2.0
"""One source raster as a function of longitude and latitude."""

import sqlite3
from collections.abc import Iterable, Iterator
from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.sampling import triangulated
from tiles.frames import WGS84_B_M, Floats
from tiles.geodesy import to_ecef
from tiles.placement import Placement
from tiles.raster_blocks import BlockCache, Blocks, level_count, level_shape

RIM_PX = np.array([-0.1, 0.1, -0.1, 0.1])
"""A picture covers its texels, and a little more, so that neighbours leave no gap."""

HELD_POSTS = 64
"""A search for data looks at this many posts of a halved copy each way, about."""
SPAN_STEPS = 16
CURVED_M = 1500.0
"""Triangles between posts closer than that are less than 10 cm off the earth's curve."""
Box = tuple[float, float, float, float]


class Layer:
    """Posts of one source, read from the store at the resolution that is asked for."""

    def __init__(
        self,
        connection: sqlite3.Connection,
        source: dict[str, Any],
        cache: BlockCache | None = None,
    ) -> None:
        """Open a source; `cache` may be shared by the sources of one store."""
        self.name = str(source["name"])
        self.spacing_m = float(source["spacing_m"])
        self.vertical_step_m = float(source.get("vertical_step_m", 0.0))
        self._place = Placement(source)
        self.bounds_deg, self.wraps = self._place.bounds_deg, self._place.wraps
        self.is_projected = self._place.is_projected
        self.pixels, self.places = self._place.pixels, self._place.places
        self.near = self._place.near
        self._shape = (int(source["height"]), int(source["width"]))
        key = str(source["blocks"])
        self._blocks = Blocks(connection, key, self._shape, wraps=self.wraps, cache=cache)
        self.is_picture = self._blocks.bands == 3
        self._levels = level_count(self._shape[1], self._shape[0])
        self._polar = self._place.closes
        is_turned = self.is_projected or any(source["transform"][k] for k in (1, 3))
        self._is_whole = not (is_turned or source.get("posts", {}).get("skipped", True))
        """whether there is data wherever the bounding box is"""
        self._pole_means: dict[tuple[int, int], float] = {}

    def heights(self, lon_rad: Floats, lat_rad: Floats, step_m: float) -> Floats:
        """Return heights above the ellipsoid, NaN where the source has none.

        Parameters
        ----------
        lon_rad, lat_rad : (n,) float64
        step_m : distance of the wanted points; posts closer than that are averaged.
            Where none are, heights are those of flat triangles between posts
        """
        near = self.near(lon_rad, lat_rad)
        if near.all() and len(near):
            return self._heights(*self.pixels(lon_rad, lat_rad), step_m)
        out = np.full(lon_rad.shape, np.nan)
        at = np.flatnonzero(near)
        if len(at):
            out[at] = self._heights(*self.pixels(lon_rad[at], lat_rad[at]), step_m)
        return out

    def _heights(self, col: Floats, row: Floats, step_m: float) -> Floats:
        level, last = self._level(step_m), self._shape[0] - 1
        found = triangulated(*self._window(level, col, self._within(row)))
        if level == 0 and self.spacing_m > CURVED_M:
            found -= self._sag_m(col, self._within(row))
        # Beyond the last row the surface closes over the pole, at that row's mean.
        for edge, sign, end in ((0, -1.0, 0), (-1, 1.0, last)):
            if self._polar[edge] and (sign * (row - end)).max() > 0.0:
                beyond = sign * (row - end)
                at = np.flatnonzero(beyond > 0.0)
                part = np.minimum(beyond[at] / 0.5, 1.0)
                found[at] += part * (self._pole_mean(level, edge) - found[at])
        return found

    @np.errstate(invalid="ignore")  # beyond the edge of a map there is no place
    def _sag_m(self, col: Floats, row: Floats) -> Floats:
        """Return how far flat triangles lie below what is interpolated along the earth.

        Of a square's corners the mean squared distance, weighted as their heights are, is
        a sum over the axes, whichever way the square is cut.
        """
        (left, x), (top, y) = (np.divmod(one, 1.0) for one in (col, row))
        corner, east, south = (
            to_ecef(*self.places(left + c, top + r), 0.0)
            for c, r in ((0, 0), (1, 0), (0, 1))
        )
        squared = x * (1 - x) * ((east - corner) ** 2).sum(axis=-1)
        squared += y * (1 - y) * ((south - corner) ** 2).sum(axis=-1)
        return np.asarray(squared / (2 * WGS84_B_M))

    def _within(self, row: Floats) -> Floats:
        """Return rows, those between a pole and the row beside it moved to that row."""
        row = np.maximum(row, 0.0) if self._polar[0] else row
        return np.minimum(row, self._shape[0] - 1.0) if self._polar[1] else row

    def _pole_mean(self, level: int, edge: int) -> float:
        """Return the mean of a level's first or last row, NaN when it has no data."""
        if (level, edge) not in self._pole_means:
            height, width = level_shape(self._shape[1], self._shape[0], level)
            row = 0 if edge == 0 else height - 1
            posts = self._blocks.window(level, row, row + 1, 0, width)
            known = posts[np.isfinite(posts)].astype(np.float64)
            self._pole_means[level, edge] = float(known.mean()) if len(known) else np.nan
        return self._pole_means[level, edge]

    def picture(
        self, step_m: float, col: Floats, row: Floats
    ) -> tuple[NDArray[Any], Floats, Floats, Floats] | None:
        """Read the part of a picture around places, None where it covers none of them.

        Parameters
        ----------
        step_m : distance of the wanted points; texels closer than that are averaged
        col, row : places among the finest texels

        Returns
        -------
        window : (h, w, 3) uint8; 0, 0, 0 is transparent
        x, y : the places' columns and rows in it
        limits : (4,) least and largest x, least and largest y that the picture covers
        """
        level = self._level(step_m)
        height, width = level_shape(self._shape[1], self._shape[0], level)
        x, y = (col + 0.5) / 2**level - 0.5, (row + 0.5) / 2**level - 0.5
        ends = np.array([0, self._shape[1], 0, self._shape[0]]) + RIM_PX
        limits = ends / 2**level - 0.5
        left, right = int(np.floor(x.min())), int(np.floor(x.max())) + 2
        top, bottom = int(np.floor(y.min())), int(np.floor(y.max())) + 2
        top, bottom = max(top, 0), min(bottom, height)
        if self.wraps:
            limits[:2] = -np.inf, np.inf
        else:
            left, right = max(left, 0), min(right, width)
        if left >= right or top >= bottom:
            return None
        window = self._blocks.window(level, top, bottom, left, right)
        return window, x - left, y - top, limits - np.array([left, left, top, top])

    def shows(self, lon_rad: Floats, lat_rad: Floats, step_m: float) -> NDArray[np.bool_]:
        """Say at which places, (n,), a picture is not transparent, within about a step."""
        shown = np.zeros(lon_rad.shape, bool)
        found = self.picture(step_m, *self.pixels(lon_rad, lat_rad))
        if found is not None:
            window, x, y, limits = found
            inside = (limits[0] < x) & (x < limits[1]) & (limits[2] < y) & (y < limits[3])
            col, row = np.rint(x[inside]).astype(int), np.rint(y[inside]).astype(int)
            last = np.array(window.shape[:2]) - 1
            texels = window[np.clip(row, 0, last[0]), np.clip(col, 0, last[1])]
            shown[inside] = texels[:, 0] > 0
        return shown

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

    def posts(self, left: int, top: int, right: int, bottom: int) -> Floats:
        """Return the posts [top, bottom) x [left, right), m, NaN where there are none."""
        height, width = self._shape
        found = self._blocks.window(0, top, bottom, left, right).astype(np.float64)
        rows, cols = np.arange(top, bottom), np.arange(left, right)
        found[(rows < 0) | (rows >= height)] = np.nan
        if not self.wraps:
            found[:, (cols < 0) | (cols >= width)] = np.nan
        return found

    def rim_heights(
        self, lon_rad: Floats, lat_rad: Floats, step_m: float
    ) -> tuple[Floats, Floats]:
        """Return heights of the raster's nearest posts, and how far away they are, (n,) m.

        Parameters
        ----------
        step_m : posts closer than that are averaged, but not over all of the raster
        """
        height, width = self._shape
        posts = min(step_m / self.spacing_m, min(height, width) / 4)
        edge = max(posts, 1.0) / 2
        col, row = self.pixels(lon_rad, lat_rad)
        x, y = np.clip(col, edge, width - 1 - edge), np.clip(row, edge, height - 1 - edge)
        found = self._heights(x, y, posts * self.spacing_m)
        return found, np.hypot(col - x, row - y) * self.spacing_m

    def holds(self, box_rad: Iterable[float | Floats]) -> bool:
        """Say whether a source holds data in a box: never no where it does.

        Parameters
        ----------
        box_rad : west, south, east, north; data a little outside may count
        """
        box = tuple(float(edge) for edge in box_rad)
        parts = _common_parts(box, self.bounds_deg)
        return any(self._is_whole or self._holds(part) for part in parts)

    def _holds(self, box_rad: Box) -> bool:
        """Look for data in a box that lies in the raster's own."""
        left, top, right, bottom = self._span(box_rad)
        level = 0
        while max(right - left, bottom - top) >> level > HELD_POSTS:
            level += 1
        level = min(level, self._levels - 1)
        height, width = level_shape(self._shape[1], self._shape[0], level)
        rows = max((top >> level) - 1, 0), min((bottom >> level) + 2, height)
        cols = (left >> level) - 1, (right >> level) + 2
        if not self.wraps:
            cols = max(cols[0], 0), min(cols[1], width)
        if rows[0] >= rows[1] or cols[0] >= cols[1]:
            return False
        posts = self._blocks.window(level, *rows, *cols)
        return self.is_picture or bool(np.isfinite(posts).any())

    def _span(self, box_rad: Box) -> tuple[int, int, int, int]:
        """Return columns and rows that hold a box: left, top, right, bottom."""
        height, width = self._shape
        steps = np.linspace(0.0, 1.0, SPAN_STEPS + 1 if self.is_projected else 2)
        west, south, east, north = box_rad
        lon, lat = np.meshgrid(
            west + steps * (east - west), south + steps * (north - south)
        )
        col, row = (one.reshape(lon.shape) for one in self.pixels(lon.ravel(), lat.ravel()))
        if not (np.isfinite(col).all() and np.isfinite(row).all()):
            return 0, 0, width - 1, height - 1
        span = []
        for one, last in ((col, width - 1), (row, height - 1)):
            # Between two samples a curve strays by less than an eighth of their distance.
            steps_px = max(np.abs(np.diff(one, axis=k)).max() for k in (0, 1))
            slack = steps_px / 8 if self.is_projected else 0.0
            span.append((float(one.min()) - slack, float(one.max()) + slack, last))
        (left, right, last), (top, bottom, low) = span
        if self.wraps and east - west > np.pi:
            left, right = 0.0, float(last)
        if not self.wraps:
            left, right = max(left, -1.0), min(right, last + 1.0)
        top, bottom = max(top, -1.0), min(bottom, low + 1.0)
        return floor(left), floor(top), ceil(right), ceil(bottom)

    def framed(
        self, rows: int, cols: int
    ) -> Iterator[tuple[int, int, NDArray[Any], NDArray[np.bool_]]]:
        """Yield all posts, a part at a time, each with a frame of one post around it.

        Yields
        ------
        top, left : row and column of the part's first post
        posts, known : (h + 2, w + 2) heights, and whether they hold data
        """
        height, width = self._shape
        for top in range(0, height, rows):
            bottom = min(top + rows, height)
            for left in range(0, width, cols):
                right = min(left + cols, width)
                posts = self._blocks.window(0, top - 1, bottom + 1, left - 1, right + 1)
                known = np.isfinite(posts)
                known[:, 0] &= left > 0 or self.wraps
                known[:, -1] &= right < width or self.wraps
                # Beyond its last row a raster that reaches a pole closes over it.
                known[0] = self._polar[0] if top == 0 else known[0]
                known[-1] = self._polar[1] if bottom == height else known[-1]
                yield top, left, posts, known


def _common_parts(box_rad: tuple[float, ...], bounds_deg: Box) -> Iterator[Box]:
    """Yield what a box and a raster's bounds have in common, in the raster's longitudes."""
    west, south, east, north = np.radians(bounds_deg).tolist()
    for turn in (-2.0 * np.pi, 0.0, 2.0 * np.pi):
        left, right = max(box_rad[0] + turn, west), min(box_rad[2] + turn, east)
        low, high = max(box_rad[1], south), min(box_rad[3], north)
        if left <= right and low <= high:
            yield left, low, right, high
