# SPDX-License-Identifier: Apache-2.0
"""Rasters that reach beyond the edge of their map, as those of the whole globe do.

What lies beyond the edge has no place on the earth, or another post's.
"""

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.placement import Box, Placement

LOST_POSTS = 0.1
"""A post that is looked for at its place must be found so near"""
MOST_STEPS = 4096
"""Places along a side, and across 256 of them: what lies between is nearly straight"""
ACROSS = 257
MARGIN_STEPS = 3.0
"""The edge of a map is no further beyond the last place than its neighbours are"""
Shape = tuple[int, int]


def known_places(
    place: Placement, col: Floats, row: Floats, columns: int = 0
) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes of posts, (n,) rad, NaN where they have none.

    Parameters
    ----------
    columns : once round the globe; 0 where a raster does not go round
    """
    lon, lat = place.places(col, row)
    there = np.isfinite(lon) & np.isfinite(lat)
    found = place.pixels(np.where(there, lon, 0.0), np.where(there, lat, 0.0))
    off = np.abs(np.subtract(found, (col, row)))
    off[0] = np.minimum(off[0], np.abs(off[0] - columns))
    there &= (off < LOST_POSTS).all(axis=0)
    return np.where(there, lon, np.nan), np.where(there, lat, np.nan)


def reaches_beyond(place: Placement, shape: Shape) -> bool:
    """Say whether a raster of a projected map reaches beyond its edge.

    Then posts on its own border do.
    """
    rows, cols = (np.linspace(0, n - 1, min(n, MOST_STEPS)) for n in shape)
    col = np.concatenate([cols, cols, 0 * rows, 0 * rows + shape[1] - 1])
    row = np.concatenate([0 * cols, 0 * cols + shape[0] - 1, rows, rows])
    return bool(np.isnan(known_places(place, col, row)[0]).any())


def bounds_beyond(place: Placement, shape: Shape) -> Box:
    """Return the bounds of a raster that reaches beyond the edge of its map, degrees.

    Not of its own border, most of which may have no place.
    """
    rows, cols = (np.linspace(0, n - 1, min(n, ACROSS)) for n in shape)
    col, row = np.meshgrid(cols, rows)
    lon, lat = known_places(place, col.ravel(), row.ravel())
    lon, lat = (np.degrees(one).reshape(col.shape) for one in (lon, lat))
    west, _, east, _ = place.bounds_deg
    middle = (west + east) / 2
    lon = (lon - middle + 180.0) % 360.0 - 180.0
    aside = min(np.nanmax(np.abs(lon)) + MARGIN_STEPS * _step(lon), 180.0)
    margin = MARGIN_STEPS * _step(lat)
    low, high = max(np.nanmin(lat) - margin, -90.0), min(np.nanmax(lat) + margin, 90.0)
    return float(middle - aside), float(low), float(middle + aside), float(high)


def _step(values: NDArray[np.float64]) -> float:
    """Return the largest difference between neighbours in a table."""
    steps = [np.abs(np.diff(values, axis=k)).ravel() for k in (0, 1)]
    return float(np.nanmax(np.concatenate(steps), initial=0.0))
