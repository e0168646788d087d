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

from ingest.footprints import Geometries
from ingest.repair import metres_per_degree
from tiles import geodesy
from tiles.frames import Ecef, Floats, Ints
from tiles.mesh import ROOF, VERTEX, WALL

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
    ring_ends: list[NDArray[np.uint32]]


def extrude(polygon: Geometries, foot_m: Floats, top_m: Floats) -> Prisms:
    """Raise footprints to prisms.

    Parameters
    ----------
    polygon : (n,) Polygon or MultiPolygon in degrees, shells counter-clockwise
    foot_m, top_m : (n,) heights of the walls' lower edge and of the roof, above the
        ellipsoid, m
    """
    if not len(polygon):
        return _no_prisms()
    corners = _corners(polygon)
    count = np.diff(corners.start)
    roof, roof_count = _roofs(corners, polygon)
    vertex_start = np.concatenate(([0], np.cumsum(CORNER_VERTICES * count)))
    triangle_start = np.concatenate(([0], np.cumsum(2 * count + roof_count)))
    within = np.arange(len(corners.owner)) - corners.start[corners.owner]
    wall = vertex_start[corners.owner] + 4 * within
    top = vertex_start[corners.owner] + 4 * count[corners.owner] + within

    total = int(vertex_start[-1])
    lon, lat, height = np.empty(total), np.empty(total), np.empty(total)
    ends = (np.arange(len(wall)), corners.ahead, corners.ahead, np.arange(len(wall)))
    for k, (end, level_m) in enumerate(
        zip(ends, (foot_m, foot_m, top_m, top_m), strict=True)
    ):
        lon[wall + k], lat[wall + k] = corners.lon_deg[end], corners.lat_deg[end]
        height[wall + k] = level_m[corners.owner]
    lon[top], lat[top] = corners.lon_deg, corners.lat_deg
    height[top] = top_m[corners.owner]

    triangles = np.empty((int(triangle_start[-1]), 3), np.int64)
    first = triangle_start[corners.owner] + 2 * within
    triangles[first] = wall[:, None] + (0, 1, 2)
    triangles[first + 1] = wall[:, None] + (0, 2, 3)
    is_roof = np.ones(len(triangles), bool)
    is_roof[first], is_roof[first + 1] = False, False
    triangles[is_roof] = top[roof]
    vertices = _vertices(corners, wall, top, (top_m - foot_m)[corners.owner])
    return Prisms(
        np.radians(lon), np.radians(lat), height, vertices, triangles, vertex_start,
        triangle_start,
    )  # fmt: skip


def _no_prisms() -> Prisms:
    none, start = np.zeros(0), np.zeros(1, np.int64)
    triangles = np.zeros((0, 3), np.int64)
    return Prisms(none, none, none, np.zeros(0, VERTEX), triangles, start, start)


def _corners(polygon: Geometries) -> _Corners:
    parts, owner_of_part = shapely.get_parts(polygon, return_index=True)
    _, xy, (ring_start, part_ring) = shapely.to_ragged_array(parts)
    closing = np.zeros(len(xy), bool)
    closing[ring_start[1:] - 1] = True
    size = np.diff(ring_start) - 1
    begin = np.concatenate(([0], np.cumsum(size)))
    ahead = np.arange(1, int(begin[-1]) + 1)
    ahead[begin[1:] - 1] = begin[:-1]
    part_start = begin[part_ring]
    owner = np.repeat(owner_of_part, np.diff(part_start))
    start = np.searchsorted(owner, np.arange(len(polygon) + 1))
    ring_ends = np.split(begin[1:], part_ring[1:-1])
    relative = [
        (ends - first).astype(np.uint32)
        for ends, first in zip(ring_ends, part_start[:-1], strict=True)
    ]
    lon, lat = xy[~closing].T
    return _Corners(lon, lat, ahead, owner, start, part_start, relative)


def _roofs(corners: _Corners, polygon: Geometries) -> tuple[Ints, Ints]:
    """Return roof triangles as corner numbers, (r, 3), and how many each object has."""
    bounds = shapely.bounds(polygon)
    middle = (bounds[:, :2] + bounds[:, 2:]) / 2
    scale = np.column_stack(metres_per_degree(middle[:, 1]))
    xy = np.column_stack((corners.lon_deg, corners.lat_deg)) - middle[corners.owner]
    xy = np.ascontiguousarray(xy * scale[corners.owner])
    found, start = [], corners.part_start.tolist()
    for first, last, ends in zip(start[:-1], start[1:], corners.ring_ends, strict=True):
        part = mapbox_earcut.triangulate_float64(xy[first:last], ends)
        found.append(part.astype(np.int64) + first)
    roof = np.concatenate(found).reshape(-1, 3) if found else np.zeros((0, 3), np.int64)
    a, b, c = xy[roof[:, 0]], xy[roof[:, 1]], xy[roof[:, 2]]
    ab, ac = b - a, c - a
    clockwise = ab[:, 0] * ac[:, 1] < ab[:, 1] * ac[:, 0]
    roof[clockwise] = roof[clockwise][:, ::-1]
    return roof, np.bincount(corners.owner[roof[:, 0]], minlength=len(polygon))


def _vertices(corners: _Corners, wall: Ints, top: Ints, rise_m: Floats) -> NDArray[np.void]:
    """Fill in flags, normals and the height above the walls' foot."""
    vertices = np.zeros(CORNER_VERTICES * len(wall), VERTEX)
    per_lon, per_lat = metres_per_degree(corners.lat_deg)
    east = (corners.lon_deg[corners.ahead] - corners.lon_deg) * per_lon
    north = (corners.lat_deg[corners.ahead] - corners.lat_deg) * per_lat
    length = np.maximum(np.hypot(east, north), 1e-9)
    axes = geodesy.enu_axes(np.radians(corners.lon_deg), np.radians(corners.lat_deg))
    outward = (north / length)[:, None] * axes[:, 0] - (east / length)[:, None] * axes[:, 1]
    rise_dm = np.clip(np.rint(rise_m * 10), 0, 65535)
    for k in range(4):
        vertices["normal"][wall + k, :3] = np.rint(127 * outward)
        vertices["flags"][wall + k] = WALL
        vertices["detail"][wall + k, 0] = rise_dm if k >= 2 else 0
    vertices["normal"][top, :3] = np.rint(127 * axes[:, 2])
    vertices["flags"][top] = ROOF
    vertices["detail"][top, 0] = rise_dm
    return vertices
