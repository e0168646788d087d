# SPDX-License-Identifier: Apache-2.0
"""The 32 zones of the globe and the longitude/latitude grid of every level.

The globe is 8 columns by 4 rows of zones, 45 degrees on a side. Row 0 touches the
south pole, column 0 starts at longitude -180 degrees, and ``zone = row * 8 + col``.
At level L every zone is 2**L by 2**L cells, so the globe is one grid of ``4 * 2**L``
rows and ``8 * 2**L`` columns.

A grid line is an integer times ``step_rad(level)``, and the step is the float64 number
pi/4 divided by a power of two. So two cells that share an edge, also of different
levels, have bit-identical values for it, and ``grid_at`` agrees with those bits: a
point on a grid line is in the cell to its east or north.
"""

import math

import numpy as np

from tiles.frames import Floats, Ints

IntLike = int | np.int64 | Ints
FloatLike = float | np.float64 | Floats
Bounds = tuple[Floats, Floats, Floats, Floats]

COLUMNS = 8
ROWS = 4
COUNT = ROWS * COLUMNS
SIZE_RAD = math.pi / 4


def zone_of(row: IntLike, col: IntLike) -> Ints:
    """Return the zone at a row (0 south) and column (0 at -180 degrees)."""
    return np.asarray(row, np.int64) * COLUMNS + np.asarray(col, np.int64)


def row_col(zone: IntLike) -> tuple[Ints, Ints]:
    """Return the row and column of a zone."""
    zone = np.asarray(zone, np.int64)
    return zone // COLUMNS, zone % COLUMNS


def step_rad(level: IntLike) -> Floats:
    """Return the side of a cell of a level in radians, float64, exactly pi/4 / 2**level."""
    return np.asarray(np.ldexp(SIZE_RAD, -np.asarray(level, np.int32)))[()]


def grid_bounds_rad(level: IntLike, row: IntLike, col: IntLike) -> Bounds:
    """Return (west, south, east, north), radians, of a square of the whole globe's grid."""
    level = np.asarray(level, np.int64)
    step = step_rad(level)
    across = np.asarray(col, np.int64) - (COLUMNS // 2 << level)
    up = np.asarray(row, np.int64) - (ROWS // 2 << level)
    return across * step, up * step, (across + 1) * step, (up + 1) * step


def wrap_lon(lon_rad: FloatLike) -> Floats:
    """Return the longitude in [-pi, pi); a value already there keeps its bits."""
    lon = np.asarray(lon_rad, np.float64)
    turned = np.mod(lon + math.pi, 2 * math.pi) - math.pi
    turned = np.where(turned >= math.pi, -math.pi, turned)
    return np.where((lon >= -math.pi) & (lon < math.pi), lon, turned)[()]


def grid_at(lon_rad: FloatLike, lat_rad: FloatLike, level: IntLike) -> tuple[Ints, Ints]:
    """Return (row, col) of the whole globe's grid that hold a point.

    Parameters
    ----------
    lon_rad, lat_rad
        The point, radians; longitude wraps, latitude is clamped to the poles.
    level
        Level of the grid, 0 to 29 (one more than cells have, so that the quadrant of
        a cell of the deepest level can be asked for too).

    Raises
    ------
    ValueError
        When a longitude or latitude is not finite.
    """
    lat = np.clip(np.asarray(lat_rad, np.float64), -math.pi / 2, math.pi / 2)
    lon = wrap_lon(lon_rad)
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        raise ValueError("a longitude or latitude is not a finite number")
    level = np.asarray(level, np.int64)
    step = step_rad(level)
    rows = ROWS << level
    row = np.minimum(_line_below(lat, step) + rows // 2, rows - 1)
    return row, _line_below(lon, step) + (COLUMNS // 2 << level)


def _line_below(x: Floats, step: Floats) -> Ints:
    """Return the last grid line at or below x, exact against ``k * step``."""
    # The quotient is rounded and can be one off beside a line; the line itself decides.
    line = np.floor(x / step)
    line = line + (x >= (line + 1) * step) - (x < line * step)
    return line.astype(np.int64)
