# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of motion, compiled: it runs for each list, and between two frames.

In numpy each of these takes a tenth of a millisecond with the GIL held, most of it for
arrays of three numbers.
"""

import math

import numpy as np

from geopage.tree import F8
from tiles.forest import Rows
from tiles.geodesy import ecef_of, geodetic_of
from tiles.kernels import brief
from tiles.zones import COLUMNS, ROWS, SIZE_RAD

STILL = 1e-12
JITTER_RAD = 0.01


@brief
def rates(
    eyes: F8,
    rotations: F8,
    times_s: F8,
    floor_m: float,
    least_m: float,
    jump: tuple[float, float, float],
) -> tuple[int, float, float, float, float]:
    """Return how longitude, latitude and height changed since the last jump.

    Parameters
    ----------
    eyes : (n, 3) ECEF m, oldest first
    rotations : (n, 3, 3)
    times_s : (n,)
    floor_m, least_m : heights count from `floor_m`, and as `least_m` at least
    jump : heights and metres between two eyes, and radians a second, above which it is
        a jump

    Returns
    -------
    start : the first place after the last jump
    span_s : from there to the newest
    lon, lat : radians in that time
    climb : change of the natural logarithm of the height
    """
    n = len(times_s)
    place = np.empty((n, 3))
    start = 0
    for i in range(n):
        lon, lat, height_m = geodetic_of(eyes[i, 0], eyes[i, 1], eyes[i, 2])
        place[i] = lon, lat, max(height_m - floor_m, least_m)
        if i:
            x, y, z = eyes[i] - eyes[i - 1]
            low_m = min(place[i, 2], place[i - 1, 2])
            far = math.sqrt(x * x + y * y + z * z) > jump[0] * low_m + jump[1]
            same = (rotations[i] * rotations[i - 1]).sum()  # 1 + 2 cos(angle)
            most_rad = jump[2] * (times_s[i] - times_s[i - 1]) + JITTER_RAD
            if far or same < 1.0 + 2.0 * math.cos(min(most_rad, math.pi)):
                start = i
    turned = place[n - 1, 0] - place[start, 0]
    return (
        start,
        times_s[n - 1] - times_s[start],
        turned - 2 * math.pi * np.rint(turned / (2 * math.pi)),
        place[n - 1, 1] - place[start, 1],
        math.log(place[n - 1, 2] / place[start, 2]),
    )


@brief
def eye_ahead(
    eye: F8, way: tuple[float, float, float], floor_m: float, least_m: float
) -> tuple[float, float, float]:
    """Return where an eye gets to, ECEF m.

    Parameters
    ----------
    eye : (3,) ECEF m
    way : radians of longitude and of latitude, and logarithms of the height
    floor_m, least_m : heights count from `floor_m`, and as `least_m` at least
    """
    lon, lat, height_m = geodetic_of(eye[0], eye[1], eye[2])
    above_m = max(max(height_m - floor_m, least_m) * math.exp(way[2]), least_m)
    lat = min(max(lat + way[1], -math.pi / 2), math.pi / 2)
    return ecef_of(lon + way[0], lat, floor_m + above_m)


@brief
def rotation_vector(rotation: F8) -> F8:
    """Return the (3,) axis times angle of a (3, 3) rotation, up to half a turn."""
    skew = np.array(
        (
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        )
    )
    sine = math.sqrt((skew * skew).sum()) / 2
    trace = rotation[0, 0] + rotation[1, 1] + rotation[2, 2]
    angle = math.atan2(sine, (trace - 1) / 2)
    return skew * (angle / (2 * sine) if sine > STILL else 0.0)


@brief
def rotation_of(vector: F8) -> F8:
    """Return the (3, 3) rotation by a (3,) axis times angle (Rodrigues)."""
    turned = np.eye(3)
    angle = math.sqrt((vector * vector).sum())
    if angle < STILL:
        return turned
    x, y, z = vector / angle
    sine, rest = math.sin(angle), 1 - math.cos(angle)
    axis = (x, y, z)
    cross = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))
    for i in range(3):
        for k in range(3):
            turned[i, k] += sine * cross[i][k] + rest * (axis[i] * axis[k] - (i == k))
    return turned


@brief
def row_under(children: Rows, eye: F8) -> int:
    """Return the row of the deepest cell under an eye.

    Parameters
    ----------
    children : (n, 4) rows, -1 where there is none; the zones are the first rows
    eye : (3,) ECEF m
    """
    lon, lat, _ = geodetic_of(eye[0], eye[1], eye[2])
    across, up = lon / SIZE_RAD + COLUMNS // 2, lat / SIZE_RAD + ROWS // 2
    col = int(across) % COLUMNS
    line = min(max(int(up), 0), ROWS - 1)
    x, y = across - math.floor(across), min(max(up - line, 0.0), 1.0)
    row = line * COLUMNS + col
    while True:
        x, y = 2 * x, 2 * y
        east, north = int(x >= 1.0), int(y >= 1.0)
        below = children[row, east + 2 * north]
        if below < 0:
            return row
        x, y, row = x - east, y - north, below
