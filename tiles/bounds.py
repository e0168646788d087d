# SPDX-License-Identifier: Apache-2.0
"""Bounding spheres and boxes of cells: all between two heights over a cell is inside.

Why eight corners are enough. The centre C lies in the meridian half-plane through the
middle of the cell, at cx >= 0 from the axis. Take any point of the cell's box.

1. Turn it away from the middle meridian, at the same latitude and height: the distance
   to C grows, so the farthest points are in the plane of the east (or west) edge.
2. Move it up or down: the position is linear in height, so the squared distance is
   convex, and an end of the height range is farthest.
3. Along that edge, at height h, let C' be C projected into the edge's plane and n, t
   the unit normal and tangent at the point P. Half the derivative of the squared
   distance by latitude is (M + h) s with s = (P - C').t, and s' = M + h - (P - C').n.
   With P.n = a W + h, W = sqrt(1 - e2 sin2(lat)), s' is positive wherever
   C'.n > a W - M, and a W - M is at most a e2 = 43 km. C is an average of points of
   the box, a cell never crosses the equator and is at most 45 degrees high and wide, so
   C'.n > 3,000 km. So s rises, the squared distance has no maximum between the ends,
   and a corner is farthest.

It holds for every level and at the poles, for heights from -1,000 km up. Rounding is
covered by adding a micrometre and 1e-12 of the radius.
"""

import numpy as np

from tiles import cells, geodesy
from tiles.frames import WGS84_A_M, Ecef, Floats
from tiles.zones import FloatLike, IntLike

_MARGIN_M = 1e-6
_MARGIN = 1.0 + 1e-12


def sphere_of(
    cell: IntLike, min_height_m: FloatLike, max_height_m: FloatLike
) -> tuple[Ecef, Floats]:
    """Return a sphere around all points of cells between two heights.

    Parameters
    ----------
    cell
        (...) cell ids.
    min_height_m, max_height_m
        (...) heights above the ellipsoid, metres, from -1e6 up, min <= max.

    Returns
    -------
    centre : (..., 3) float64 ECEF metres
    radius : (...) float64 metres
    """
    west, south, east, north = cells.bounds_rad(cell)
    low, high = np.asarray(min_height_m, np.float64), np.asarray(max_height_m, np.float64)
    half = (east - west) / 2
    mean_m = (low + high) / 2
    centre = _centre(
        geodesy.to_ecef(half, south, mean_m), geodesy.to_ecef(half, north, mean_m)
    )
    corners = [
        geodesy.to_ecef(half, lat, height)
        for lat in (south, north)
        for height in (low, high)
    ]
    distances = [np.linalg.norm(corner - centre, axis=-1) for corner in corners]
    radius = np.max(np.stack(distances), axis=0)
    return _turned(centre, (west + east) / 2), radius * _MARGIN + _MARGIN_M


def half_sides_of(
    cell: IntLike, min_height_m: FloatLike, max_height_m: FloatLike, centre: Ecef
) -> Floats:
    """Return half the sides of boxes around all points of cells between two heights.

    A box is around `centre`; its up is away from the middle of the earth, its north is
    upright to that in the plane of the axis, its east is level. The sides are those of
    3 x 3 places at both heights; between these a coordinate, whose second derivative by
    an angle is at most the distance from the middle of the earth, rises by no more than
    that times the squares of the steps over 8.

    Parameters
    ----------
    cell
        (n,) cell ids.
    min_height_m, max_height_m
        (n,) heights above the ellipsoid, metres, from -1e6 up, min <= max.
    centre
        (n, 3) ECEF metres

    Returns
    -------
    (n, 3) float64 metres: east, north, up
    """
    west, south, east, north = cells.bounds_rad(cell)
    low, high = np.asarray(min_height_m, np.float64), np.asarray(max_height_m, np.float64)
    up = centre / np.linalg.norm(centre, axis=-1, keepdims=True)
    level = np.hypot(up[..., 0], up[..., 1])
    level = np.maximum(level, np.finfo(np.float64).tiny)
    right = np.stack((-up[..., 1] / level, up[..., 0] / level, 0 * level), axis=-1)
    axes = np.stack((right, np.cross(up, right), up), axis=-2)
    half = np.zeros((*np.shape(west), 3))
    for share in np.ndindex(3, 3):
        lon = west + (east - west) * share[0] / 2
        lat = south + (north - south) * share[1] / 2
        for height in (low, high):
            away = geodesy.to_ecef(lon, lat, height) - centre
            along = np.abs(np.einsum("...ij,...j->...i", axes, away))
            half = np.maximum(half, along)
    steps = ((east - west) / 2) ** 2 + ((north - south) / 2) ** 2
    bulge_m = steps / 8 * (WGS84_A_M + np.maximum(high, 0.0))
    return np.asarray((half + bulge_m[..., np.newaxis]) * 1.001 + _MARGIN_M)


def _centre(a: Floats, b: Floats) -> Floats:
    """Return the centre of the smallest sphere around a, b and their mirrors in y = 0."""
    # On the line between the two mirror centres, where both are equally far, or at the
    # end of it when one pair is wider than the sphere that the other one needs.
    line = (b - a) * (1.0, 0.0, 1.0)
    length2 = np.maximum((line**2).sum(axis=-1), np.finfo(np.float64).tiny)
    share = 0.5 + (b[..., 1] ** 2 - a[..., 1] ** 2) / (2 * length2)
    start = a * (1.0, 0.0, 1.0)
    return np.asarray(start + np.clip(share, 0.0, 1.0)[..., np.newaxis] * line)


def _turned(point: Floats, lon_rad: Floats) -> Ecef:
    """Turn points of the plane of longitude 0 (y = 0) to a longitude."""
    x, z = point[..., 0], point[..., 2]
    lon = np.broadcast_to(lon_rad, x.shape)
    return Ecef(np.stack((x * np.cos(lon), x * np.sin(lon), z), axis=-1))
