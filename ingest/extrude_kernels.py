# SPDX-License-Identifier: Apache-2.0
"""The vertices and triangles of prisms, as compiled loops.

Of each object first come four vertices per corner, the wall from it to the next one, then
one per corner, the roof.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats, Ints
from tiles.kernels import inlined, kernel
from tiles.mesh import ROOF, WALL


@kernel
def walls_and_roofs(
    corner: Floats,
    ahead: Ints,
    start: Ints,
    heights_m: Floats,
    place: Floats,
    normal: NDArray[np.int8],
    marks: NDArray[np.uint16],
) -> None:
    """Fill in the vertices.

    Parameters
    ----------
    corner : (c, 4) longitude and latitude, rad, and metres per degree of each
    ahead : (c,) the corner that the wall goes on to
    start : (n + 1,) where each object's corners begin
    heights_m : (n, 3) foot, top and ground
    place : (3, v) longitude and latitude, rad, height, m
    normal : (v, 4), the last column stays
    marks : (v, 2) decimetres above the ground, 16 bits with a sign; WALL or ROOF
    """
    for n in range(len(start) - 1):
        first, count = start[n], start[n + 1] - start[n]
        foot_m, top_m, ground_m = heights_m[n]
        low, high = _decimetres(foot_m - ground_m), _decimetres(top_m - ground_m)
        for c in range(first, start[n + 1]):
            out, up = _normals(corner[c], corner[ahead[c]])
            wall = 5 * first + 4 * (c - first)
            for k in range(4):
                end = ahead[c] if k in (1, 2) else c
                place[0, wall + k], place[1, wall + k] = corner[end, 0], corner[end, 1]
                place[2, wall + k] = top_m if k >= 2 else foot_m
                marks[wall + k, 0], marks[wall + k, 1] = high if k >= 2 else low, WALL
                for i in range(3):
                    normal[wall + k, i] = np.rint(127.0 * out[i])
            top = 5 * first + 4 * count + c - first
            place[0, top], place[1, top] = corner[c, 0], corner[c, 1]
            place[2, top], marks[top, 0], marks[top, 1] = top_m, high, ROOF
            for i in range(3):
                normal[top, i] = np.rint(127.0 * up[i])


@inlined
def _decimetres(height_m: float) -> int:
    return int(min(max(np.rint(height_m * 10.0), -32768.0), 32767.0)) & 0xFFFF


@kernel
def _normals(
    here: Floats, there: Floats
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the outward normal of the wall between two corners, and up, ECEF axes."""
    sin_lon, cos_lon = math.sin(here[0]), math.cos(here[0])
    sin_lat, cos_lat = math.sin(here[1]), math.cos(here[1])
    east = math.degrees(there[0] - here[0]) * here[2]
    north = math.degrees(there[1] - here[1]) * here[3]
    length = max(math.hypot(east, north), 1e-9)
    x, y = north / length, -east / length
    out = (-x * sin_lon - y * sin_lat * cos_lon, x * cos_lon - y * sin_lat * sin_lon)
    up = (cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
    return (out[0], out[1], y * cos_lat), up


@kernel
def faces(
    start: Ints, roof: Ints, vertex_start: Ints, triangle_start: Ints, triangles: Ints
) -> None:
    """Fill in the triangles, (t, 3): two for each wall, then the roof's.

    Parameters
    ----------
    start : (n + 1,) where each object's corners begin
    roof : (r, 3) corners, sorted by object
    """
    taken = 0
    for n in range(len(start) - 1):
        count, first = start[n + 1] - start[n], triangle_start[n]
        for c in range(count):
            a = vertex_start[n] + 4 * c
            for k in range(3):
                triangles[first + 2 * c, k] = a + k
                triangles[first + 2 * c + 1, k] = a + (k + 1 if k else 0)
        top = vertex_start[n] + 4 * count - start[n]
        for t in range(first + 2 * count, triangle_start[n + 1]):
            for k in range(3):
                triangles[t, k] = top + roof[taken, k]
            taken += 1
