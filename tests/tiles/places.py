# SPDX-License-Identifier: Apache-2.0
"""Where a point lies in a cell."""

import math

import numpy as np

from tiles import cells
from tiles.frames import Floats
from tiles.zones import FloatLike, IntLike


def uv_in_cell(
    cell: IntLike, lon_rad: FloatLike, lat_rad: FloatLike
) -> tuple[Floats, Floats]:
    """Return where a point lies in a cell: u from west 0 to east 1, v from south to north.

    Points of the cell, edges included, give values in [0, 1]; points outside give
    values outside, counted the shorter way around the globe.
    """
    west, south, east, north = cells.bounds_rad(cell)
    lon = np.asarray(lon_rad, np.float64)
    # Turn whole rounds only when needed: a turn costs the last bits of the longitude.
    away = lon - (west + east) / 2
    turns = np.where(np.abs(away) > math.pi, np.round(away / (2 * math.pi)), 0.0)
    lon = lon - turns * (2 * math.pi)
    u = (lon - west) / (east - west)
    return u, (np.asarray(lat_rad, np.float64) - south) / (north - south)
