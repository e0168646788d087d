# SPDX-License-Identifier: Apache-2.0
"""Between longitude, latitude, height and ECEF; directions and cell sizes on WGS84.

Angles are radians, heights metres above the ellipsoid, positions float64 ECEF metres.
"""

import math

import numpy as np

from tiles import cells, zones
from tiles.frames import WGS84_A_M, WGS84_B_M, WGS84_E2, Ecef, Floats
from tiles.kernels import kernel
from tiles.zones import FloatLike, IntLike

_E = math.sqrt(WGS84_E2)
# Bowring (1976): one turn is within 1e-6 m near the surface, 0.2 m at 20,000 km; two
# reach the rounding of float64 everywhere (measured), the third is spare.
_TURNS = 3
_TINY = float(np.finfo(np.float64).tiny)


@kernel
def ecef_of(lon_rad: float, lat_rad: float, height_m: float) -> tuple[float, float, float]:
    """Return x, y, z in metres of one point, for use inside other kernels."""
    sin_lat = math.sin(lat_rad)
    normal_m = WGS84_A_M / math.sqrt(1.0 - WGS84_E2 * sin_lat * sin_lat)
    axis_m = (normal_m + height_m) * math.cos(lat_rad)
    return (
        axis_m * math.cos(lon_rad),
        axis_m * math.sin(lon_rad),
        (normal_m * (1.0 - WGS84_E2) + height_m) * sin_lat,
    )


@kernel
def geodetic_of(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return longitude, latitude and height of one point, for use inside other kernels.

    The same as `to_geodetic`.
    """
    axis = math.hypot(x, y)
    sin_b, cos_b = _unit_of(z * WGS84_A_M, axis * WGS84_B_M)
    up, out = 0.0, 0.0
    for _ in range(_TURNS):
        up = z + WGS84_E2 * WGS84_A_M**2 / WGS84_B_M * sin_b**3
        out = axis - WGS84_E2 * WGS84_A_M * cos_b**3
        sin_b, cos_b = _unit_of(up * WGS84_B_M, out * WGS84_A_M)
    sin_lat, cos_lat = _unit_of(up, out)
    height = axis * cos_lat + z * sin_lat
    height = height - WGS84_A_M * math.sqrt(1.0 - WGS84_E2 * sin_lat**2)
    return math.atan2(y, x), math.atan2(sin_lat, cos_lat), height


@kernel
def _unit_of(sine: float, cosine: float) -> tuple[float, float]:
    cosine = max(cosine, 0.0)
    length = max(math.hypot(sine, cosine), _TINY)
    return sine / length, cosine / length


def to_ecef(lon_rad: FloatLike, lat_rad: FloatLike, height_m: FloatLike) -> Ecef:
    """Return ECEF positions, shape (..., 3) metres, of points given by broadcasting."""
    lon, lat = np.asarray(lon_rad, np.float64), np.asarray(lat_rad, np.float64)
    height = np.asarray(height_m, np.float64)
    sin_lat = np.sin(lat)
    normal_m = WGS84_A_M / np.sqrt(1.0 - WGS84_E2 * sin_lat**2)
    axis_m = (normal_m + height) * np.cos(lat)
    z = (normal_m * (1.0 - WGS84_E2) + height) * sin_lat
    x, y, z = np.broadcast_arrays(axis_m * np.cos(lon), axis_m * np.sin(lon), z)
    return Ecef(np.stack((x, y, z), axis=-1))


def to_geodetic(ecef: Ecef) -> tuple[Floats, Floats, Floats]:
    """Return (longitude, latitude, height) of ECEF positions of shape (..., 3).

    Bowring's iteration on the parametric latitude, kept as a sine and a cosine so that
    the poles need no special case. Better than 1e-8 m near the surface and 1e-7 m to
    20,000 km. On the axis
    the longitude is 0. Within 43 km of the earth's centre the latitude is not unique.
    """
    ecef_m = np.asarray(ecef, np.float64)
    x, y, z = ecef_m[..., 0], ecef_m[..., 1], ecef_m[..., 2]
    axis = np.hypot(x, y)
    sin_b, cos_b = _unit(z * WGS84_A_M, axis * WGS84_B_M)
    for _ in range(_TURNS):
        up = z + WGS84_E2 * WGS84_A_M**2 / WGS84_B_M * sin_b**3
        out = axis - WGS84_E2 * WGS84_A_M * cos_b**3
        sin_b, cos_b = _unit(up * WGS84_B_M, out * WGS84_A_M)
    sin_lat, cos_lat = _unit(up, out)
    # This form of the height has no error of first order in the latitude, even at poles.
    height = axis * cos_lat + z * sin_lat
    height = height - WGS84_A_M * np.sqrt(1.0 - WGS84_E2 * sin_lat**2)
    return np.arctan2(y, x), np.arctan2(sin_lat, cos_lat), height


def up(lon_rad: FloatLike, lat_rad: FloatLike) -> Floats:
    """Return the ellipsoid's outward unit normal, ECEF axes, shape (..., 3)."""
    lon, lat = np.asarray(lon_rad, np.float64), np.asarray(lat_rad, np.float64)
    flat = np.cos(lat)
    x, y, z = np.broadcast_arrays(flat * np.cos(lon), flat * np.sin(lon), np.sin(lat))
    return np.stack((x, y, z), axis=-1)


def enu_axes(lon_rad: FloatLike, lat_rad: FloatLike) -> Floats:
    """Return unit vectors in ECEF axes, shape (..., 3, 3), rows east, north, up.

    ``enu_axes(lon, lat) @ v`` turns an ECEF difference v into east, north and up.
    """
    lon, lat = np.broadcast_arrays(
        np.asarray(lon_rad, np.float64), np.asarray(lat_rad, np.float64)
    )
    sin_lon, cos_lon, sin_lat, cos_lat = np.sin(lon), np.cos(lon), np.sin(lat), np.cos(lat)
    east = np.stack((-sin_lon, cos_lon, np.zeros_like(lon)), axis=-1)
    north = np.stack((-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat), axis=-1)
    outward = np.stack((cos_lat * cos_lon, cos_lat * sin_lon, sin_lat), axis=-1)
    return np.stack((east, north, outward), axis=-2)


def cell_edge_m(cell: IntLike) -> Floats:
    """Return the true edge of a cell: the square root of its area on the ellipsoid, m.

    The area of a band is the difference of two authalic terms of the sines s and t of
    its edges. It is written in t - s, so that nothing cancels for a 2 cm cell.
    """
    near, far, step = _pole_distances(cell)
    s, t = np.cos(far), np.cos(near)
    rise = 2.0 * np.sin((near + far) / 2) * np.sin(step / 2)
    e2 = WGS84_E2
    rational = rise * (1 + e2 * s * t) / ((1 - e2 * s**2) * (1 - e2 * t**2))
    band = rational + np.arctanh(_E * rise / (1 - e2 * s * t)) / _E
    return np.asarray(np.sqrt(step * WGS84_B_M**2 / 2 * band))[()]


def cell_width_m(cell: IntLike) -> Floats:
    """Return Lq, the width in metres that an object of a cell must not exceed.

    It is the straight line between the ends of the cell's most poleward parallel (0 at
    a pole), or the same across half a cell each way along the meridian where that is
    shorter (within 7 degrees of the equator). Straight lines make the rule of linked
    cells exact: a ball of diameter Lq around a centre in the cell (on the ellipsoid or
    above) reaches at most half a cell's angle west, east, south and north, because its
    distance from the meridian plane half a cell away is p sin(step / 2), p being the
    distance from the axis, and from the cone of normals at least M sin(step / 2).
    """
    near, _, step = _pole_distances(cell)
    axis_m = WGS84_A_M * np.sin(near) / np.sqrt(1 - WGS84_E2 * np.cos(near) ** 2)
    equator_m = WGS84_A_M * (1 - WGS84_E2)  # M is smallest there
    return np.asarray(2 * np.sin(step / 2) * np.minimum(axis_m, equator_m))[()]


def _pole_distances(cell: IntLike) -> tuple[Floats, Floats, Floats]:
    """Return the angles from the nearest pole to a cell's edges, and the cell's side."""
    # Counted in rows from the pole, so that the sine is exact (and 0) at the pole.
    level = cells.level(cell)
    row, _ = cells.global_row_col(cell)
    step = zones.step_rad(level)
    rows = np.minimum(row, (zones.ROWS << level) - 1 - row)
    return rows * step, (rows + 1) * step, step


def _unit(sine: Floats, cosine: Floats) -> tuple[Floats, Floats]:
    """Scale to length one; the cosine is kept non-negative, (0, 0) stays."""
    cosine = np.maximum(cosine, 0.0)
    length = np.maximum(np.hypot(sine, cosine), np.finfo(np.float64).tiny)
    return sine / length, cosine / length
