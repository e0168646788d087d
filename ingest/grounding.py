# SPDX-License-Identifier: Apache-2.0
"""Buildings stand on the terrain that is drawn, at every level at which both are drawn.

**Where heights count from.** From the lowest ground along the footprint's edge and
under its middle: OpenStreetMap counts heights, and storeys, from the lowest point of the
ground. Where the slope is higher than the building, the roof would then be under the
ground uphill, which says that the slope is not real (terraces, posts 30 m apart) or that
the height counts from elsewhere. There the building is lifted, by the least amount that
leaves its roof CLEAR_M (or its own height, if that is less) above the highest ground
along its edge. The height itself never changes: what moves is the ground that it counts
from, and each such building is listed.

**Where walls end.** PLINTH_M below the lowest ground along the edge, of the finest
terrain and of every coarser level that can be drawn with it. A building is drawn while
its dimension D takes more than the object threshold, D * scale > object_px; a terrain
tile while its error E takes at most the terrain's, E * scale <= threshold_px. So
E < D * threshold_px / object_px. The ratio is 1 unless a person sets the thresholds
apart, and THRESHOLD_RATIO allows for twice that, because the two scales are those of two
bounding spheres. The depth is not this bound but what those levels measure there, mostly
a metre or two; it costs no triangle. Beyond the bound a gap is at most E, less than
threshold_px on the screen, and so is what a coarser terrain hides of a wall.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ingest.footprints import Geometries
from ingest.ground_places import Places, places_of
from ingest.repair import metres_per_degree
from ingest.repair import size_m as size_m_of
from tiles.frames import Floats, Ints
from tiles.kernels import kernel

Ground = Callable[[Floats, Floats], tuple[Floats, Floats]]
"""(lon_rad, lat_rad) -> heights above the ellipsoid and the terrain's error there, m"""
Coarser = Callable[[Floats, Floats, Floats], Floats]
"""(lon_rad, lat_rad, within_m) -> lowest of the coarser terrains up to an error, m;
infinite where there is none: `tiles.surface.Surface.lowest`"""
Terrain = tuple[Ground, Coarser]
"""The finest terrain, and the coarser above it."""
PLINTH_M = 1.0
CLEAR_M = 1.0
TOLERANCE_M = 0.5
THRESHOLD_RATIO = 2.0
LARGE_M = 30.0
"""Coarser ground counts under the corners and the middle of a smaller building's box."""
PROXY_SLACK = 0.05
"""Share of a box's size that the ground between the places may be lower."""


@dataclass(frozen=True, slots=True)
class Grounding:
    """Where n buildings stand, and how well."""

    low_m: Floats
    """(n,) ground that heights count from, above the ellipsoid"""
    plinth_m: Floats
    """(n,) how far walls go on below it"""
    edge_low_m: Floats
    """(n,) lowest ground along the rings"""
    edge_high_m: Floats
    """(n,) highest ground along the rings"""
    lifted_m: Floats
    """(n,) how far `low_m` is above the lowest ground, for the roof to be clear of it"""

    def foot_m(self, raised_m: Floats) -> Floats:
        """Return where walls begin, above the ellipsoid; raised parts have no plinth."""
        return np.where(raised_m > 0, self.low_m + raised_m, self.low_m - self.plinth_m)

    def floating(self, raised_m: Floats) -> NDArray[np.bool_]:
        """Tell whose walls end more than half a metre above the ground somewhere."""
        gap_m = self.foot_m(raised_m) - self.edge_low_m
        return np.asarray((raised_m <= 0) & (gap_m > TOLERANCE_M))

    def sunk(self, top_m: Floats) -> NDArray[np.bool_]:
        """Tell whose roof, `top_m` above `low_m`, is under the ground."""
        return np.asarray(self.edge_high_m - (self.low_m + top_m) > TOLERANCE_M)


def ellipsoid(lon_rad: Floats, lat_rad: Floats) -> tuple[Floats, Floats]:
    """Ground of a store without terrain: height 0, no error."""
    del lat_rad
    return np.zeros(np.shape(lon_rad)), np.zeros(np.shape(lon_rad))


def ground_objects(
    polygon: Geometries,
    ground: Ground,
    top_m: Floats | None = None,
    coarser: Coarser | None = None,
) -> Grounding:
    """Ask for the ground under footprints, all in one call; best sorted by cell.

    Parameters
    ----------
    polygon : (n,) valid polygons in degrees
    ground : the finest terrain
    top_m : (n,) roofs above the ground that heights count from (`raised_m + height_m`);
        without them no building is lifted
    coarser : the coarser terrain, for the plinths; without it they know the finest only
    """
    places = places_of(polygon)
    height_m = np.nan_to_num(ground(*places.radians)[0])
    low_m, edge_low_m, edge_high_m = _reduced(places.start, height_m)
    lifted_m = np.zeros(len(polygon))
    if top_m is not None:
        clear_m = edge_high_m + np.minimum(top_m, CLEAR_M)
        lifted_m = np.maximum(clear_m - (low_m + top_m), 0.0)
    foot_m = low_m
    if coarser is not None and len(polygon):
        dimension_m = places.size_m if top_m is None else np.maximum(places.size_m, top_m)
        foot_m = np.minimum(foot_m, _lowest_coarse(places, dimension_m, coarser))
    low_m = low_m + lifted_m
    plinth_m = low_m - foot_m + PLINTH_M
    return Grounding(low_m, plinth_m, edge_low_m, edge_high_m, lifted_m)


def _lowest_coarse(places: Places, dimension_m: Floats, coarser: Coarser) -> Floats:
    """Return the lowest coarser ground: under the box, along the edges of the large."""
    low_m = lowest_under(places.bounds_deg, dimension_m, coarser)
    count = np.diff(places.start)
    large = places.size_m > LARGE_M
    if large.any():
        lon, lat = places.radians
        here = np.repeat(large, count)
        within_m = np.repeat(THRESHOLD_RATIO * dimension_m, count)[here]
        found = coarser(lon[here], lat[here], within_m)
        start = np.concatenate(([0], np.cumsum(count[large])[:-1]))
        low_m[large] = np.minimum(low_m[large], np.minimum.reduceat(found, start))
    return low_m


def lowest_under(bounds_deg: Floats, dimension_m: Floats, coarser: Coarser) -> Floats:
    """Return the lowest coarser ground under boxes that may be drawn with them.

    Parameters
    ----------
    bounds_deg : (n, 4) west, south, east, north
    dimension_m : (n,) bounding dimension of what is drawn or left out as a whole

    Returns
    -------
    (n,) m above the ellipsoid, of the corners and the middle of each box; infinite
    where no coarser terrain may be drawn
    """
    west, south, east, north = np.radians(bounds_deg).T
    west, east = np.where(east - west > np.pi, (east, west + 2 * np.pi), (west, east))
    middle = (west + east) / 2, (south + north) / 2
    lon = np.stack((west, east, east, west, middle[0]), axis=1)
    lat = np.stack((south, south, north, north, middle[1]), axis=1)
    within_m = np.repeat(THRESHOLD_RATIO * dimension_m, lon.shape[1])
    found = coarser(lon.ravel(), lat.ravel(), within_m)
    return np.asarray(found.reshape(lon.shape).min(axis=1))


def proxy_feet_m(
    polygon: Geometries,
    foot_m: Floats,
    lean: Floats,
    dimension_m: Floats,
    terrain: Terrain,
) -> Floats:
    """Return where the walls of proxies' boxes begin in their middles, (n,) m.

    A box covers ground between its buildings too, and a proxy is drawn as long as the
    whole of it is large enough, with terrain that is coarser than its buildings ever
    meet.

    Parameters
    ----------
    polygon : (n,) boxes, degrees
    foot_m : (n,) where they begin for their buildings' sake
    lean : (n, 2) rise of the boxes to the east and to the north, m/m
    dimension_m : (n,) bounding dimension of the whole proxy that each is a part of
    """
    if not len(polygon):
        return foot_m
    size_m = np.maximum(*size_m_of(polygon))
    places = places_of(polygon, size_m / 2)
    count = np.diff(places.start)
    within_m = np.repeat(THRESHOLD_RATIO * dimension_m, count)
    height_m = np.nan_to_num(terrain[0](*places.radians)[0])
    height_m = np.minimum(height_m, terrain[1](*places.radians, within_m))
    middle = (places.bounds_deg[:, :2] + places.bounds_deg[:, 2:]) / 2
    slope = lean * np.column_stack(metres_per_degree(middle[:, 1]))
    away = places.deg - np.repeat(middle, count, axis=0)
    height_m = height_m - (away * np.repeat(slope, count, axis=0)).sum(axis=1)
    low_m = np.minimum.reduceat(height_m, places.start[:-1])
    return np.minimum(foot_m, low_m - PLINTH_M - PROXY_SLACK * size_m)


@kernel
def _reduced(start: Ints, height_m: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the lowest ground along edges and under middles, and along edges both ends."""
    count = len(start) - 1
    low, edge_low, edge_high = np.empty(count), np.empty(count), np.empty(count)
    for n in range(count):
        edge_low[n], edge_high[n] = np.inf, -np.inf
        for k in range(start[n] + 1, start[n + 1]):
            edge_low[n] = min(edge_low[n], height_m[k])
            edge_high[n] = max(edge_high[n], height_m[k])
        low[n] = min(height_m[start[n]], edge_low[n])
    return low, edge_low, edge_high
