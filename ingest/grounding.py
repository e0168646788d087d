# SPDX-License-Identifier: Apache-2.0
"""Buildings stand on the terrain that is drawn: the lowest ground under a footprint.

A building's height counts from the lowest ground under its corners and its centroid.
Walls go on below the ground by a plinth, as deep as the terrain can be wrong and one
metre more, so that no light shows under them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.footprints import Geometries
from tiles.frames import Floats, Ints

Ground = Callable[[Floats, Floats], tuple[Floats, Floats]]
"""(lon_rad, lat_rad) -> heights above the ellipsoid and the terrain's error there, m"""
PLINTH_M = 1.0
TOLERANCE_M = 0.5


@dataclass(frozen=True, slots=True)
class Grounding:
    """Where n buildings stand, and how well."""

    low_m: Floats
    """(n,) lowest ground under corners and centroid, above the ellipsoid"""
    plinth_m: Floats
    """(n,) how far walls go on below it"""
    edge_low_m: Floats
    """(n,) lowest ground along the rings, corners and middles of edges"""
    edge_high_m: Floats
    """(n,) highest ground along the rings"""

    def foot_m(self, raised_m: Floats) -> Floats:
        """Return where walls begin, above the ellipsoid; raised parts have no plinth."""
        return np.where(raised_m > 0, self.low_m + raised_m, self.low_m - self.plinth_m)

    def floating(self, raised_m: Floats) -> NDArray[np.bool_]:
        """Tell whose walls end more than half a metre above the ground somewhere."""
        gap_m = self.foot_m(raised_m) - self.edge_low_m
        return np.asarray((raised_m <= 0) & (gap_m > TOLERANCE_M))

    def sunk(self, top_m: Floats) -> NDArray[np.bool_]:
        """Tell whose roof, `top_m` above the lowest ground, is under the ground."""
        return np.asarray(self.edge_high_m - (self.low_m + top_m) > TOLERANCE_M)


def ellipsoid(lon_rad: Floats, lat_rad: Floats) -> tuple[Floats, Floats]:
    """Ground of a store without terrain: height 0, no error."""
    del lat_rad
    return np.zeros(np.shape(lon_rad)), np.zeros(np.shape(lon_rad))


def ground_objects(polygon: Geometries, ground: Ground) -> Grounding:
    """Ask for the ground under footprints, all in one call.

    Parameters
    ----------
    polygon : (n,) polygons in degrees
    ground : terrain heights and errors, m
    """
    corner, owner = shapely.get_coordinates(polygon, return_index=True)
    ring = _ring_number(polygon)
    along = ring[1:] == ring[:-1]
    middle = (corner[1:] + corner[:-1])[along] / 2
    centroid = shapely.get_coordinates(shapely.centroid(polygon))
    place = np.radians(np.concatenate((corner, middle, centroid)))
    height_m, error_m = ground(place[:, 0], place[:, 1])
    height_m, error_m = np.nan_to_num(height_m), np.nan_to_num(error_m)

    count = len(polygon)
    everyone = np.concatenate((owner, owner[1:][along], np.arange(count)))
    edge = slice(0, len(corner) + len(middle))
    under = np.r_[0 : len(corner), edge.stop : len(place)]
    lowest = _reduced(np.minimum, everyone[under], height_m[under], count)
    worst = _reduced(np.maximum, everyone, error_m, count)
    return Grounding(
        lowest,
        PLINTH_M + worst,
        _reduced(np.minimum, everyone[edge], height_m[edge], count),
        _reduced(np.maximum, everyone[edge], height_m[edge], count),
    )


def _ring_number(polygon: Geometries) -> Ints:
    """Return for each coordinate which ring of all it belongs to."""
    parts = shapely.get_parts(polygon)
    rings = shapely.get_rings(parts)
    return np.repeat(np.arange(len(rings)), shapely.get_num_coordinates(rings))


def _reduced(how: np.ufunc, owner: Ints, value: Floats, count: int) -> Floats:
    order = np.argsort(owner, kind="stable")
    first = np.searchsorted(owner[order], np.arange(count))
    return np.asarray(how.reduceat(value[order], first), np.float64)
