# SPDX-License-Identifier: Apache-2.0
"""How many pixels a metre of error can take in a cell of terrain.

That is focal / view depth (design: an error is a distance x focal / view depth), for the
least depth that a point of the picture can have in the cell. Of three bounds of it the
largest holds: that of the cell's box, that of the ground anywhere in the picture, and that
of the nearest of the cell's pieces: a cell that narrows to a pole fills no box. All change
little when the eye moves little, so that detail does not come and go.
"""

import math

import numpy as np
from numpy.typing import NDArray

from geopage.ground_depth import least_depth_m
from geopage.screen_error import NEAR_M, Lens, weight_of
from tiles.frames import WGS84_A_M, WGS84_B_M, WGS84_E2
from tiles.kernels import kernel

PIECES = 24
"""of a cell, at most"""
SMALL = 1 / 16
"""A cell whose radius is at most this share of its depth is not cut: it hardly matters."""
FLATTEST_M, ROUNDEST_M = WGS84_A_M**2 / WGS84_B_M, WGS84_B_M**2 / WGS84_A_M
"""Largest and least radius that the ellipsoid curves with"""


@kernel
def error_px_per_m(
    lens: Lens,
    centre: NDArray[np.float64],
    radius_m: float,
    box_m: NDArray[np.float32],
    box_rad: NDArray[np.float64],
) -> float:
    """Return the most pixels that a metre of error takes in a cell of terrain.

    Parameters
    ----------
    centre, radius_m : of the bounding sphere
    box_m : (5,) half the sides of the box: east, north, up at the centre; and the cell's
        least and greatest height above the ellipsoid
    box_rad : (4,) west, south, east, north; all 0 to take the cell as one piece
    """
    x, y, z = centre[0] - lens.eye[0], centre[1] - lens.eye[1], centre[2] - lens.eye[2]
    half = lens.width_px / 2 / lens.focal_px, lens.height_px / 2 / lens.focal_px
    depth_m = least_depth_m(lens.eye, lens.rotation, half, box_m[4])
    depth_m = max(depth_m, _box_depth_m(lens, centre, radius_m, box_m))
    if box_rad[2] > box_rad[0] and radius_m > SMALL * depth_m:
        depth_m = max(depth_m, _piece_depth_m(lens, box_m, box_rad))
    return float(lens.focal_px / depth_m * weight_of(lens, x, y, z, radius_m))


@kernel
def _box_depth_m(
    lens: Lens, centre: NDArray[np.float64], radius_m: float, box_m: NDArray[np.float32]
) -> float:
    """Return the least depth that a point of the picture can have in a box."""
    cx, cy, cz = centre[0], centre[1], centre[2]
    x, y, z = cx - lens.eye[0], cy - lens.eye[1], cz - lens.eye[2]
    fx, fy, fz = lens.forward[0], lens.forward[1], lens.forward[2]
    level = max(math.sqrt(cx * cx + cy * cy), NEAR_M)
    height = max(math.sqrt(cx * cx + cy * cy + cz * cz), NEAR_M)
    ux, uy, uz = cx / height, cy / height, cz / height
    ex, ey = -cy / level, cx / level
    nx, ny, nz = -uz * ey, uz * ex, ux * ey - uy * ex
    away = math.sqrt(x * x + y * y + z * z)
    along = x * fx + y * fy + z * fz
    reach = abs(fx * ex + fy * ey) * box_m[0] + abs(fx * ux + fy * uy + fz * uz) * box_m[2]
    reach += abs(fx * nx + fy * ny + fz * nz) * box_m[1]
    east = max(abs(x * ex + y * ey) - box_m[0], 0.0)
    north = max(abs(x * nx + y * ny + z * nz) - box_m[1], 0.0)
    up = max(abs(x * ux + y * uy + z * uz) - box_m[2], 0.0)
    near = math.sqrt(east * east + north * north + up * up)
    near = max(near, away - radius_m, NEAR_M)
    return float(max(along - min(reach, radius_m), near * lens.corner_cos))


@kernel
def _piece_depth_m(
    lens: Lens, box_m: NDArray[np.float32], box_rad: NDArray[np.float64]
) -> float:
    """Return the least depth that a point of the picture can have in spheres around pieces.

    The pieces are about square.
    """
    west, south, east, north = box_rad[0], box_rad[1], box_rad[2], box_rad[3]
    wide, high = east - west, north - south
    narrow = high / (wide * math.cos((south + north) / 2))
    columns = max(int(math.sqrt(PIECES / narrow)), 1)
    rows = PIECES // columns
    low_m, top_m, least_m = float(box_m[3]), float(box_m[4]), np.inf
    for row in range(rows):
        start = south + high * row / rows
        lat = start + high / rows / 2
        sine, cosine = math.sin(lat), math.cos(lat)
        across_m = WGS84_A_M / math.sqrt(1.0 - WGS84_E2 * sine * sine)
        flat_m = (across_m + (low_m + top_m) / 2) * cosine
        z = (across_m * (1.0 - WGS84_E2) + (low_m + top_m) / 2) * sine - lens.eye[2]
        widest = math.cos(min(abs(start), abs(start + high / rows)))
        half_m = high / rows / 2, wide / columns / 2 * widest
        aside_m = math.hypot(half_m[0], half_m[1]) * (FLATTEST_M + max(top_m, 0.0))
        up_m = (top_m - low_m) / 2 + aside_m * aside_m / 2 / (ROUNDEST_M + min(low_m, 0.0))
        radius_m = math.sqrt(aside_m * aside_m + up_m * up_m)
        for column in range(columns):
            lon = west + wide * (column + 0.5) / columns
            x = flat_m * math.cos(lon) - lens.eye[0]
            y = flat_m * math.sin(lon) - lens.eye[1]
            along_m = x * lens.forward[0] + y * lens.forward[1] + z * lens.forward[2]
            near_m = math.sqrt(x * x + y * y + z * z) - radius_m
            depth_m = max(along_m - radius_m, near_m * lens.corner_cos)
            least_m = min(least_m, depth_m)
    return float(least_m)
