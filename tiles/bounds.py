# SPDX-License-Identifier: Apache-2.0
"""Bounding spheres of cells: everything between two heights over a cell is inside.

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
from tiles.frames import Ecef, Floats
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
