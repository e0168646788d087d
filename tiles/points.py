# SPDX-License-Identifier: Apache-2.0
"""Geometry of single points for other kernels: triangles, the ellipsoid, rays."""

import math

from tiles.frames import WGS84_A_M, WGS84_B_M, WGS84_E2
from tiles.kernels import inlined, kernel

Point = tuple[float, float, float]


@inlined
def dot(a: Point, b: Point) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def less(a: Point, b: Point) -> Point:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inlined
def along(a: Point, way: Point, t: float) -> Point:
    """Return a + t way."""
    return (a[0] + t * way[0], a[1] + t * way[1], a[2] + t * way[2])


@inlined
def _share(part: float, whole: float) -> float:
    """Return part / whole; 0 in a triangle that is a line or a point."""
    return part / whole if whole != 0.0 else 0.0


@kernel
def nearest_on_triangle(  # noqa: PLR0911  (a way out for each corner and edge)
    a: Point, b: Point, c: Point
) -> Point:
    """Return the point of a triangle that is nearest to the origin.

    References
    ----------
    Ericson 2005, Real-Time Collision Detection, section 5.1.5.
    """
    ab, ac = less(b, a), less(c, a)
    d1, d2 = -dot(ab, a), -dot(ac, a)
    if d1 <= 0.0 and d2 <= 0.0:
        return a
    d3, d4 = -dot(ab, b), -dot(ac, b)
    if d3 >= 0.0 and d4 <= d3:
        return b
    d5, d6 = -dot(ab, c), -dot(ac, c)
    if d6 >= 0.0 and d5 <= d6:
        return c
    vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return along(a, ab, _share(d1, d1 - d3))
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return along(a, ac, _share(d2, d2 - d6))
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        return along(b, less(c, b), _share(d4 - d3, (d4 - d3) + (d5 - d6)))
    total = va + vb + vc
    return along(along(a, ab, _share(vb, total)), ac, _share(vc, total))


@kernel
def height_and_up(p: Point) -> tuple[float, Point]:
    """Return the height of an ECEF point and the ellipsoid's unit normal below it.

    One turn of Bowring's method: 1e-6 m near the surface.
    """
    axis = math.hypot(p[0], p[1])
    sin_b, cos_b = p[2] * WGS84_A_M, axis * WGS84_B_M
    length = max(math.hypot(sin_b, cos_b), 1e-300)
    sin_b, cos_b = sin_b / length, cos_b / length
    up = p[2] + WGS84_E2 * WGS84_A_M * WGS84_A_M / WGS84_B_M * sin_b**3
    out = max(axis - WGS84_E2 * WGS84_A_M * cos_b**3, 0.0)
    length = max(math.hypot(up, out), 1e-300)
    sin_lat, cos_lat = up / length, out / length
    normal_m = WGS84_A_M * math.sqrt(1.0 - WGS84_E2 * sin_lat * sin_lat)
    height = axis * cos_lat + p[2] * sin_lat - normal_m
    scale = cos_lat / axis if axis > 0.0 else 0.0
    return height, (p[0] * scale, p[1] * scale, sin_lat)


@kernel
def span_below(origin: Point, way: Point, height_m: float) -> tuple[float, float]:
    """Return where a line is inside the ellipsoid whose axes are longer by a height.

    Returns
    -------
    Parameters of entry and exit, (inf, -inf) when it passes by. That ellipsoid lies
    inside the surface of points with that height, by up to 2 cm.
    """
    a, b = WGS84_A_M + height_m, WGS84_B_M + height_m
    o, d = (
        (origin[0] / a, origin[1] / a, origin[2] / b),
        (way[0] / a, way[1] / a, way[2] / b),
    )
    square, middle = dot(d, d), dot(o, d)
    inside = middle * middle - square * (dot(o, o) - 1.0)
    if inside < 0.0:
        return math.inf, -math.inf
    half = math.sqrt(inside)
    return (-middle - half) / square, (half - middle) / square
