# SPDX-License-Identifier: Apache-2.0
"""Footprints to prisms: walls along every ring, a roof by ear clipping, no floor.

Everything but the roofs' triangulation is one numpy pass over ragged arrays. Walls
follow the local vertical, because foot and top are the same longitude and latitude.
"""

from dataclasses import dataclass

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.extrude_kernels import faces, walls_and_roofs
from ingest.footprints import Geometries
from ingest.outlines import outlines_of
from ingest.repair import metres_per_degree
from tiles import geodesy
from tiles.frames import Ecef, Floats, Ints
from tiles.mesh import VERTEX

CORNER_VERTICES = 5
"""Vertices per corner of a ring: two walls' ends, foot and top, and one of the roof."""


@dataclass(frozen=True, slots=True)
class Prisms:
    """Meshes of n objects, one after the other."""

    lon_rad: Floats
    lat_rad: Floats
    height_m: Floats
    """(v,) each: the vertices, heights above the ellipsoid"""
    vertices: NDArray[np.void]
    """(v,) VERTEX, all but the position and the ordinal filled in"""
    triangles: Ints
    """(t, 3) vertex numbers, counter-clockwise seen from outside"""
    vertex_start: Ints
    """(n + 1,) where each object's vertices begin"""
    triangle_start: Ints
    """(n + 1,) where each object's triangles begin"""

    @property
    def ecef(self) -> Ecef:
        """Vertex positions, (v, 3) float64 m."""
        return geodesy.to_ecef(self.lon_rad, self.lat_rad, self.height_m)


@dataclass(frozen=True, slots=True)
class _Corners:
    """Ring corners without the closing one; corner k starts the edge to `ahead[k]`."""

    lon_deg: Floats
    lat_deg: Floats
    ahead: Ints
    owner: Ints
    start: Ints
    part_start: Ints
    ring_end: Ints
    part_ring: Ints
    """(p + 1,) where each part's rings begin in `ring_end`"""


def extrude(
    polygon: Geometries, foot_m: Floats, top_m: Floats, ground_m: Floats | None = None
) -> Prisms:
    """Raise footprints to prisms.

    Parameters
    ----------
    polygon : (n,) Polygon or MultiPolygon in degrees, shells counter-clockwise
    foot_m, top_m : (n,) heights of the walls' lower edge and of the roof, above the
        ellipsoid, m
    ground_m : (n,) where floors are counted from; by default the lower edge
    """
    if not len(polygon):
        return _no_prisms()
    corners = _corners(polygon)
    count = np.diff(corners.start)
    roof, roof_count = _roofs(corners, polygon)
    vertex_start = np.concatenate(([0], np.cumsum(CORNER_VERTICES * count)))
    triangle_start = np.concatenate(([0], np.cumsum(2 * count + roof_count)))
    heights_m = np.column_stack((foot_m, top_m, foot_m if ground_m is None else ground_m))
    return _raised(corners, heights_m, roof, vertex_start, triangle_start)


def _raised(
    corners: _Corners,
    heights_m: Floats,
    roof: Ints,
    vertex_start: Ints,
    triangle_start: Ints,
) -> Prisms:
    total = int(vertex_start[-1])
    place, normal = np.empty((3, total)), np.zeros((total, 4), np.int8)
    marks = np.empty((total, 2), np.uint16)
    lon_rad, lat_rad = np.radians(corners.lon_deg), np.radians(corners.lat_deg)
    corner = np.column_stack((lon_rad, lat_rad, *metres_per_degree(corners.lat_deg)))
    walls_and_roofs(corner, corners.ahead, corners.start, heights_m, place, normal, marks)
    triangles = np.empty((int(triangle_start[-1]), 3), np.int64)
    faces(corners.start, roof, vertex_start, triangle_start, triangles)
    vertices = np.zeros(total, VERTEX)
    vertices["normal"], vertices["flags"] = normal, marks[:, 1]
    vertices["detail"][:, 0] = marks[:, 0]
    lon, lat, height = place
    return Prisms(lon, lat, height, vertices, triangles, vertex_start, triangle_start)


def _no_prisms() -> Prisms:
    none, start = np.zeros(0), np.zeros(1, np.int64)
    triangles = np.zeros((0, 3), np.int64)
    return Prisms(none, none, none, np.zeros(0, VERTEX), triangles, start, start)


def _corners(polygon: Geometries) -> _Corners:
    xy, ring_start, part_ring, owner_of_part = outlines_of(polygon)
    closing = np.zeros(len(xy), bool)
    closing[ring_start[1:] - 1] = True
    size = np.diff(ring_start) - 1
    begin = np.concatenate(([0], np.cumsum(size)))
    ahead = np.arange(1, int(begin[-1]) + 1)
    ahead[begin[1:] - 1] = begin[:-1]
    part_start = begin[part_ring]
    owner = np.repeat(owner_of_part, np.diff(part_start))
    start = np.searchsorted(owner, np.arange(len(polygon) + 1))
    lon, lat = xy[~closing].T
    return _Corners(lon, lat, ahead, owner, start, part_start, begin[1:], part_ring)


def _roofs(corners: _Corners, polygon: Geometries) -> tuple[Ints, Ints]:
    """Return roof triangles as corner numbers, (r, 3), and how many each object has."""
    bounds = shapely.bounds(polygon)
    middle = (bounds[:, :2] + bounds[:, 2:]) / 2
    scale = np.column_stack(metres_per_degree(middle[:, 1]))
    xy = np.column_stack((corners.lon_deg, corners.lat_deg)) - middle[corners.owner]
    xy = np.ascontiguousarray(xy * scale[corners.owner])
    quad = _convex_quads(corners, xy)
    fan = corners.part_start[quad][:, None] + (0, 1, 2, 0, 2, 3)
    roof = np.concatenate((fan.reshape(-1, 3), _ear_clipped(corners, xy, quad)))
    roof = roof[np.argsort(roof[:, 0], kind="stable")]
    a, b, c = xy[roof[:, 0]], xy[roof[:, 1]], xy[roof[:, 2]]
    ab, ac = b - a, c - a
    clockwise = ab[:, 0] * ac[:, 1] < ab[:, 1] * ac[:, 0]
    roof[clockwise] = roof[clockwise][:, ::-1]
    return roof, np.bincount(corners.owner[roof[:, 0]], minlength=len(polygon))


def _convex_quads(corners: _Corners, xy: Floats) -> Ints:
    """Return the parts that are one convex ring of four corners."""
    size = np.diff(corners.part_start)
    quad = np.flatnonzero((size == 4) & (np.diff(corners.part_ring) == 1))
    corner = xy[corners.part_start[quad][:, None] + np.arange(4)]
    side = np.roll(corner, -1, axis=1) - corner
    after = np.roll(side, -1, axis=1)
    turn = side[..., 0] * after[..., 1] - side[..., 1] * after[..., 0]
    return np.asarray(quad[(turn > 0).all(axis=1)])


def _ear_clipped(corners: _Corners, xy: Floats, but: Ints) -> Ints:
    """Return roof triangles of all parts but some, (r, 3)."""
    part = np.setdiff1d(np.arange(len(corners.part_start) - 1), but)
    first, last = corners.part_start[part], corners.part_start[part + 1]
    ring = corners.part_ring
    begin = np.repeat(corners.part_start[:-1], np.diff(ring))
    ends = (corners.ring_end - begin).astype(np.uint32)
    spans = np.column_stack((first, last, ring[part], ring[part + 1])).tolist()
    clip = mapbox_earcut.triangulate_float64
    found = [clip(xy[a:b], ends[c:d]) for a, b, c, d in spans]
    count = [len(one) for one in found]
    shift = np.repeat(first, count)
    joined = np.concatenate([np.zeros(0, np.uint32), *found]).astype(np.int64)
    return (joined + shift).reshape(-1, 3)
