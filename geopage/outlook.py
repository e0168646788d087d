# SPDX-License-Identifier: Apache-2.0
"""The pictures of the next seconds: where the eye will be, and where its rays end.

Rays through a coarse grid of pixels meet the ellipsoid, raised to the ground's height
under the eye. Relief and what it hides are left out.
"""

import math
from typing import NamedTuple

import numpy as np

from geopage.prediction import LEAST_HEIGHT_M, MOST_TURN_RAD, Motion
from geopage.tree import F8
from geopage.view import ViewState
from tiles import geodesy
from tiles.frames import WGS84_A_M, WGS84_B_M
from tiles.geodesy import ecef_of
from tiles.kernels import kernel

COLUMNS, LINES = 32, 18
LEAST_DEPTH_M = 1e-3
STILL_RAD = 1e-12


class Ahead(NamedTuple):
    """Views at some times ahead, sharing one size."""

    ahead_s: F8
    """(k,) ascending"""
    eye: F8
    """(k, 3) ECEF m"""
    rotation: F8
    """(k, 3, 3) as `ViewState.rotation`"""
    focal_px: float
    width_px: float
    height_px: float
    ground_m: float
    """height of the ground above the ellipsoid"""


def outlook(view: ViewState, motion: Motion | None, floor_m: float, ahead_s: F8) -> Ahead:
    """Return the views that a motion leads to: `prediction.predict` for many times.

    Parameters
    ----------
    motion : None at rest: the same view at all times
    floor_m : height of the ground above the ellipsoid
    ahead_s : (k,) ascending
    """
    lon, lat, height_m = (float(x) for x in geodesy.to_geodetic(view.eye))
    above_m = max(height_m - floor_m, LEAST_HEIGHT_M)
    size = float(view.focal_px), float(view.width_px), float(view.height_px)
    if motion is None:
        count = len(ahead_s)
        eye, rotation = np.tile(view.eye, (count, 1)), np.tile(view.rotation, (count, 1, 1))
    else:
        place = lon, lat, above_m, floor_m
        rates = motion.lon_rad_s, motion.lat_rad_s, motion.climb
        eye, rotation = fly(place, rates, motion.spin_rad_s, view.rotation, ahead_s)
    return Ahead(ahead_s, eye, rotation, *size, floor_m)


@kernel
def fly(
    place: tuple[float, float, float, float],
    rates: tuple[float, float, float],
    spin_rad_s: F8,
    rotation: F8,
    ahead_s: F8,
) -> tuple[F8, F8]:
    """Continue a motion: see `outlook`.

    Parameters
    ----------
    place : longitude and latitude, rad; height above the floor and the floor's, m
    rates : of longitude and latitude, rad/s; of the height's logarithm, 1/s
    """
    count = len(ahead_s)
    eyes, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    rate = math.sqrt((spin_rad_s**2).sum())
    for k in range(count):
        t_s = ahead_s[k]
        lat = min(max(place[1] + rates[1] * t_s, -math.pi / 2), math.pi / 2)
        above_m = max(place[2] * math.exp(rates[2] * t_s), LEAST_HEIGHT_M)
        eyes[k] = ecef_of(place[0] + rates[0] * t_s, lat, place[3] + above_m)
        turn = spin_rad_s * t_s
        turn *= min(1.0, MOST_TURN_RAD / max(rate * t_s, STILL_RAD))
        rotate(turn, rotation, rotations[k])
    return eyes, rotations


@kernel
def rotate(turn_rad: F8, rotation: F8, out: F8) -> None:
    """Turn a (3, 3) view rotation by a (3,) rotation vector, ECEF axes (Rodrigues)."""
    angle = math.sqrt(turn_rad[0] ** 2 + turn_rad[1] ** 2 + turn_rad[2] ** 2)
    if angle < STILL_RAD:
        out[:] = rotation
        return
    x, y, z = turn_rad[0] / angle, turn_rad[1] / angle, turn_rad[2] / angle
    sine, rest = math.sin(angle), 1.0 - math.cos(angle)
    for i in range(3):
        a, b, c = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        along = (a * x + b * y + c * z) * rest
        out[i, 0] = a * (1.0 - rest) + (y * c - z * b) * sine + x * along
        out[i, 1] = b * (1.0 - rest) + (z * a - x * c) * sine + y * along
        out[i, 2] = c * (1.0 - rest) + (x * b - y * a) * sine + z * along


@kernel
def ray_ends(ahead: Ahead, k: int, along: F8, ends: F8) -> int:
    """Find where the rays of view `k` meet the ground; return how many do.

    Parameters
    ----------
    along : (3,) room for one ray
    ends : (rays, 3) receives view depth, m, and longitude and latitude, rad
    """
    eye, turn = ahead.eye[k], ahead.rotation[k]
    a_m, b_m = WGS84_A_M + ahead.ground_m, WGS84_B_M + ahead.ground_m
    flat = a_m / b_m
    ez = eye[2] * flat
    c = eye[0] * eye[0] + eye[1] * eye[1] + ez * ez - a_m * a_m
    if c <= 0.0:
        return 0
    count = 0
    for line in range(LINES):
        y = ((line + 0.5) / LINES - 0.5) * ahead.height_px / ahead.focal_px
        for column in range(COLUMNS):
            x = ((column + 0.5) / COLUMNS - 0.5) * ahead.width_px / ahead.focal_px
            for axis in range(3):
                along[axis] = x * turn[0, axis] + y * turn[1, axis] - turn[2, axis]
            z = along[2] * flat
            a = along[0] * along[0] + along[1] * along[1] + z * z
            b = along[0] * eye[0] + along[1] * eye[1] + z * ez
            under = b * b - a * c
            if under < 0.0 or b >= 0.0:
                continue
            t = c / (-b + math.sqrt(under))
            px, py = eye[0] + t * along[0], eye[1] + t * along[1]
            pz = eye[2] + t * along[2]
            axis_m = math.sqrt(px * px + py * py)
            ends[count, 0] = max(t, LEAST_DEPTH_M)
            ends[count, 1] = math.atan2(py, px)
            ends[count, 2] = math.atan2(pz * flat * flat, axis_m)
            count += 1
    return count
