# SPDX-License-Identifier: Apache-2.0
"""Where the posts of a source raster are: between longitude, latitude and column, row."""

import warnings
from functools import partial
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray
from pyproj.transformer import AreaOfInterest, TransformerGroup

from tiles.frames import WGS84_A_M, Floats
from tiles.kernels import kernel

RADIAN_M = 6.36e6
"""A little less than the earth's radius, so that margins are wide enough."""
ROUNDING = 1e-12
POLAR_DEG = 89.9999
ASIDE_TURNS = 1e-5
"""Step over which an x coordinate's scale is measured"""
EVEN = 1e-7
"""Share of its period by which a periodic x coordinate may be off"""
Box = tuple[float, float, float, float]


def is_lon_lat(crs: pyproj.CRS) -> bool:
    """Say whether coordinates are WGS84 longitude and latitude in degrees as they are.

    Systems on the same ellipsoid (ETRS89, NAD83) differ by less than two metres.
    """
    plain = crs.is_geographic and not crs.is_derived
    if not plain or crs.ellipsoid is None or crs.prime_meridian is None:
        return False
    flat, degree = crs.ellipsoid.semi_major_metre, crs.axis_info[0].unit_name.lower()
    return flat == WGS84_A_M and not crs.prime_meridian.longitude and degree == "degree"


def ways_between(
    one: pyproj.CRS, other: pyproj.CRS, area: AreaOfInterest | None = None
) -> TransformerGroup:
    """Return PROJ's ways, best first: those whose grids are installed, and the others.

    None of them leaves a change of datum out: PROJ would, where a grid is missing.
    """
    with warnings.catch_warnings():
        # That a better grid could be installed: where it matters, it is said.
        warnings.simplefilter("ignore", UserWarning)
        return TransformerGroup(
            one, other, always_xy=True, area_of_interest=area, allow_ballpark=False
        )


def area_of(bounds_deg: Box) -> AreaOfInterest | None:
    """Return bounds as PROJ wants them; None for all of the globe, or unknown ones."""
    west, south, east, north = bounds_deg
    if not np.isfinite(bounds_deg).all() or east - west >= 359.0:
        return None
    west, east = ((one + 180.0) % 360.0 - 180.0 for one in (west, east))
    return AreaOfInterest(west, south, east, north)


def way_to_degrees(crs: pyproj.CRS, bounds_deg: Box) -> pyproj.Transformer:
    """Return the way to longitude and latitude that is best for all of a raster.

    PROJ by itself takes another way in each country, and often not the same there and
    back: neighbours would move apart. One that is made for elsewhere does where none is
    made for here; a change of datum is left out (a ballpark) only where none is known.
    """
    for area in (area_of(bounds_deg), None):
        for way in ways_between(crs, pyproj.CRS(4326), area).transformers:
            return way
    return pyproj.Transformer.from_crs(crs, 4326, always_xy=True)


class Placement:
    """The posts of one raster on the earth; whole columns and rows are posts."""

    def __init__(self, source: dict[str, Any]) -> None:
        """Take a source as the store lists it: crs, transform, size, bounds_deg, wraps."""
        self.bounds_deg: Box = tuple(source["bounds_deg"])
        self.wraps = bool(source["wraps"])
        self._width = int(source["width"])
        a, b, c, d, e, f = source["transform"]
        self.closes = self._closes(north_up=e < 0)
        """whether the surface closes over a pole beyond the first row, and the last"""
        self._inverse = np.array([[a, b], [d, e]])
        self._matrix = np.linalg.inv(self._inverse)
        self._origin = np.array([c, f])
        crs = pyproj.CRS.from_user_input(source["crs"])
        self._project = self._unproject = None
        self.is_projected = not is_lon_lat(crs)
        if self.is_projected:
            way = way_to_degrees(crs, self.bounds_deg)
            self._project = partial(way.transform, direction="INVERSE")
            self._unproject = way.transform
            self._middle_x = self._origin[0] + self._inverse[0] @ (
                self._width / 2,
                int(source["height"]) / 2,
            )
            middle_turns = (self.bounds_deg[0] + self.bounds_deg[2]) / 720
            self._period_x = _period(crs, middle_turns)

    def _closes(self, *, north_up: bool) -> tuple[bool, bool]:
        north, south = self.bounds_deg[3] > POLAR_DEG, self.bounds_deg[1] < -POLAR_DEG
        first, last = (north, south) if north_up else (south, north)
        return self.wraps and first, self.wraps and last

    def pixels(self, lon_rad: Floats, lat_rad: Floats) -> tuple[Floats, Floats]:
        """Return column and row of places, (n,) each."""
        if self._project:
            x, y = self._project(np.degrees(lon_rad), np.degrees(lat_rad))
            x, y = (np.where(np.isfinite(one), one, np.nan) for one in (x, y))
            if self._period_x:
                x -= self._period_x * np.rint((x - self._middle_x) / self._period_x)
            col, row = self._matrix @ np.stack([x - self._origin[0], y - self._origin[1]])
            return col - 0.5, row - 0.5
        middle = (self.bounds_deg[0] + self.bounds_deg[2]) / 2
        width = float(self._width) if self.wraps else 0.0
        return _lon_lat_pixels(lon_rad, lat_rad, self._matrix, self._origin, middle, width)

    def places(self, col: Floats, row: Floats) -> tuple[Floats, Floats]:
        """Invert `pixels`: longitude and latitude, (n,) each."""
        pixel = np.stack([col + 0.5, row + 0.5])
        x, y = self._inverse @ pixel + self._origin[:, None]
        if self._unproject:
            x, y = self._unproject(x, y)
        return np.radians(x), np.radians(y)

    def near(
        self, lon_rad: Floats, lat_rad: Floats, margin_m: float = 0.0
    ) -> NDArray[np.bool_]:
        """Say which places are within a margin of the raster's bounding box."""
        return _near(lon_rad, lat_rad, np.radians(self.bounds_deg), margin_m / RADIAN_M)


def _period(crs: pyproj.CRS, turns: float) -> float:
    """Return what x grows by once round the globe; 0 where it isn't periodic.

    It is where it grows evenly along parallels, and as far on each of them.
    """
    own = crs.geodetic_crs
    if own is None:
        return 0.0
    # Without a change of datum, which is not the same everywhere.
    between = pyproj.Transformer.from_crs(own, crs, always_xy=True)
    turn = 2 * np.pi / own.axis_info[0].unit_conversion_factor
    lon = turn * (turns + np.array([-ASIDE_TURNS, ASIDE_TURNS, 0.0, 0.25, -0.25, 0.0]))
    lat = turn * np.array([0.0] * 5 + [0.1])
    x = np.asarray(between.transform(lon, lat)[0])
    period = float((x[1] - x[0]) / (2 * ASIDE_TURNS))
    if not np.isfinite(x).all() or not period:
        return 0.0
    off = (x[2:] - x[2]) / period - (0.0, 0.25, -0.25, 0.0)
    return period if (np.abs(off - np.rint(off)) < EVEN).all() else 0.0


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


@kernel
def _lon_lat_pixels(
    lon_rad: Floats,
    lat_rad: Floats,
    matrix: Floats,
    origin: Floats,
    middle_deg: float,
    width: float,
) -> tuple[Floats, Floats]:
    """Place longitudes and latitudes in a raster of degrees, (n,) columns and rows.

    Parameters
    ----------
    width : columns once round the globe, so that neighbours stay neighbours; 0 of others
    """
    count = len(lon_rad)
    col, row = np.empty(count), np.empty(count)
    for i in range(count):
        turn = (np.degrees(lon_rad[i]) - middle_deg + 180.0) / 360.0
        x = (turn - np.floor(turn)) * 360.0 - 180.0 + middle_deg - origin[0]
        y = np.degrees(lat_rad[i]) - origin[1]
        c = matrix[0, 0] * x + matrix[0, 1] * y
        if width and i:
            c -= np.floor((c - 0.5 - col[0]) / width + 0.5) * width
        col[i], row[i] = c - 0.5, matrix[1, 0] * x + matrix[1, 1] * y - 0.5
    return col, row
