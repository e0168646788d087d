# SPDX-License-Identifier: Apache-2.0
"""What proxies need to know of buildings, in arrays that compiled loops take."""

from typing import NamedTuple

import numpy as np
import shapely

from ingest.extrude import Prisms
from ingest.footprints import Geometries
from ingest.outlines import outlines_of
from ingest.repair import area_m2, metres_per_degree
from tiles.frames import Floats, Ints
from tiles.kernels import inlined, kernel
from tiles.mesh import ROOF

_LEAST_M2 = 1e-3


class Solids(NamedTuple):
    """n solids with e edges; heights above the ellipsoid, m, in the solids' middles.

    A solid fills its footprint from `foot_m` to `low_top_m` at least, and to `top_m` at
    most: the eaves and the ridge. A leaning one, a box, rises evenly with all its heights.
    """

    edge_deg: Floats
    """(e, 4) longitude and latitude of both ends"""
    start: Ints
    """(n + 1,) where each solid's edges begin"""
    centre_deg: Floats
    """(n, 2) middle of the footprint's box"""
    moment: Floats
    """(n, 2) lengths of edges times cosine and sine of four times their direction"""
    lean: Floats
    """(n, 2) rise to the east and to the north, m/m"""
    area_m2: Floats
    foot_m: Floats
    ground_m: Floats
    low_top_m: Floats
    top_m: Floats


def solids_of(
    polygon: Geometries,
    foot_m: Floats,
    ground_m: Floats,
    top_m: Floats,
    low_top_m: Floats | None = None,
    lean: Floats | None = None,
) -> Solids:
    """Return footprints with heights as solids.

    Parameters
    ----------
    polygon : (n,) Polygon or MultiPolygon, degrees
    foot_m, ground_m, top_m : (n,) walls' lower edge, lowest ground, highest roof
    low_top_m : (n,) lowest roof; by default the same, a flat roof
    lean : (n, 2) by default none
    """
    xy, ring, part, owner = outlines_of(polygon)
    closing = np.zeros(len(xy), bool)
    closing[ring[1:] - 1] = True
    edge = np.hstack((xy[:-1], xy[1:]))[~closing[:-1]]
    first = (ring - np.arange(len(ring)))[part]
    start = first[np.searchsorted(owner, np.arange(len(polygon) + 1))]
    bounds = shapely.bounds(polygon).reshape(-1, 4)
    centre = (bounds[:, :2] + bounds[:, 2:]) / 2
    scale = np.column_stack(metres_per_degree(centre[:, 1]))
    heights = (foot_m, ground_m, top_m if low_top_m is None else low_top_m, top_m)
    return Solids(
        edge,
        start.astype(np.int64),
        centre,
        _moments(edge, start, scale),
        np.zeros((len(polygon), 2)) if lean is None else np.ascontiguousarray(lean),
        np.maximum(area_m2(polygon), _LEAST_M2),
        *(np.ascontiguousarray(one, np.float64) for one in heights),
    )


@kernel
def _moments(edge: Floats, start: Ints, scale: Floats) -> Floats:
    """Add up edges' directions so that parallel and perpendicular ones agree."""
    moment = np.zeros((len(start) - 1, 2))
    for i in range(len(moment)):
        for e in range(start[i], start[i + 1]):
            x = (edge[e, 2] - edge[e, 0]) * scale[i, 0]
            y = (edge[e, 3] - edge[e, 1]) * scale[i, 1]
            a, b = x * x - y * y, 2 * x * y
            length = max((x * x + y * y) ** 1.5, 1e-12)
            moment[i, 0] += (a * a - b * b) / length
            moment[i, 1] += 2 * a * b / length
    return moment


def low_roofs_m(prisms: Prisms) -> Floats:
    """Return the lowest point of each object's roof, or of it where it has none, (n,) m."""
    first = prisms.vertex_start[:-1]
    roof = np.where(prisms.vertices["flags"] == ROOF, prisms.height_m, np.inf)
    low_m = np.minimum.reduceat(roof, first)
    foot_m = np.minimum.reduceat(prisms.height_m, first)
    return np.where(np.isfinite(low_m), low_m, foot_m)


class Frame(NamedTuple):
    """A plane to measure a group of solids in."""

    lon_deg: float
    lat_deg: float
    per_lon_m: float
    per_lat_m: float


def frames_of(solids: Solids, first: Ints, last: Ints) -> Floats:
    """Return a frame for each group of solids, none of them empty, (g, 4).

    Its scales are the largest in the group: distances are never measured too short.
    """
    count = last - first
    start = np.cumsum(count) - count
    lat = solids.centre_deg[np.arange(count.sum()) + np.repeat(first - start, count), 1]
    south, north = np.minimum.reduceat(lat, start), np.maximum.reduceat(lat, start)
    equatorward = np.where(south > 0, south, np.where(north < 0, north, 0.0))
    poleward = np.maximum(np.abs(south), np.abs(north))
    return np.column_stack(
        (
            solids.centre_deg[first, 0],
            (south + north) / 2,
            metres_per_degree(equatorward)[0],
            metres_per_degree(poleward)[1],
        )
    )


@inlined
def placed(frame: Frame, lon_deg: float, lat_deg: float) -> tuple[float, float]:
    """Return metres east and north in a frame, also across the antimeridian."""
    step = lon_deg - frame.lon_deg
    if step > 180.0:
        step -= 360.0
    elif step < -180.0:
        step += 360.0
    return step * frame.per_lon_m, (lat_deg - frame.lat_deg) * frame.per_lat_m


@inlined
def turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector along axes turned by an angle."""
    cos, sin = np.cos(angle), np.sin(angle)
    return x * cos + y * sin, y * cos - x * sin
