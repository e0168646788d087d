# SPDX-License-Identifier: Apache-2.0
"""Footprints astride longitude 180: made one polygon, whose longitudes run past 180."""

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.raw_features import Geometries
from tiles.frames import Floats


def unwrapped(geometry: Geometries) -> tuple[Geometries, NDArray[np.bool_]]:
    """Bring longitudes together, the middle into -180 (included) to 180.

    Parameters
    ----------
    geometry : (n,) 2-D, degrees, longitudes within +-360; those astride longitude 180
        are cut there (as RFC 7946 says), or jump from 180 to -180 along a ring

    Returns
    -------
    geometry : (n,) with longitudes that may run past +-180 by half a footprint
    joined : (n,) which were cut or jumped and now are one
    """
    made = geometry.copy()
    west, _, east, _ = shapely.bounds(geometry).T
    joined = east - west > 180.0
    for place in np.flatnonzero(joined):
        made[place] = _one(geometry[place])
    west, _, east, _ = shapely.bounds(made).T
    turns = np.floor(((west + east) / 2 + 180.0) / 360.0)
    for place in np.flatnonzero(np.isfinite(turns) & (turns != 0)):
        made[place] = _moved(made[place], -360.0 * turns[place])
    return made, joined


def _one(shape: shapely.Geometry) -> shapely.Geometry:
    """Move what is west of longitude 0 by 360 degrees; join what then touches."""

    def eastern(lon_lat: Floats) -> Floats:
        lon = lon_lat[:, 0]
        return np.column_stack((np.where(lon < 0, lon + 360.0, lon), lon_lat[:, 1]))

    moved = shapely.transform(shape, eastern)
    parts = shapely.get_parts(moved)
    joinable = len(parts) > 1 and shapely.is_valid(parts).all()
    return shapely.union_all(parts) if joinable else moved


def _moved(shape: shapely.Geometry, by_deg: float) -> shapely.Geometry:
    return shapely.transform(shape, lambda lon_lat: lon_lat + np.array((by_deg, 0.0)))
