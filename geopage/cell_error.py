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
"""Of a cell whose radius is at most this share of its depth the box says enough; as it does
of one that counts less, beside the picture or behind the planet."""
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
    depth_m = _box_depth_m(lens, centre, radius_m, box_m)
    weight = weight_of(lens, x, y, z, radius_m)
    if weight == 1.0 and radius_m > SMALL * depth_m:
        half = lens.width_px / 2 / lens.focal_px, lens.height_px / 2 / lens.focal_px
        depth_m = max(depth_m, least_depth_m(lens.eye, lens.rotation, half, box_m[4]))
        if box_rad[2] > box_rad[0] and radius_m > SMALL * depth_m:
            depth_m = max(depth_m, _piece_depth_m(lens, box_m, box_rad))
    return float(lens.focal_px / depth_m * weight)


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
    # Sines and cosines of one step after another, from the last ones and the step's.
    up, aside = high / rows, wide / columns
    sine, cosine = math.sin(south + up / 2), math.cos(south + up / 2)
    up_sine, up_cosine = math.sin(up), math.cos(up)
    aside_sine, aside_cosine = math.sin(aside), math.cos(aside)
    first_x, first_y = math.cos(west + aside / 2), math.sin(west + aside / 2)
    for _ in range(rows):
        across_m = WGS84_A_M / math.sqrt(1.0 - WGS84_E2 * sine * sine)
        flat_m = (across_m + (low_m + top_m) / 2) * cosine
        z = (across_m * (1.0 - WGS84_E2) + (low_m + top_m) / 2) * sine - lens.eye[2]
        widest = min(cosine + up / 2 * abs(sine), 1.0)
        aside_m = math.sqrt((up / 2) ** 2 + (aside / 2 * widest) ** 2)
        aside_m *= FLATTEST_M + max(top_m, 0.0)
        up_m = (top_m - low_m) / 2 + aside_m * aside_m / 2 / (ROUNDEST_M + min(low_m, 0.0))
        radius_m = math.sqrt(aside_m * aside_m + up_m * up_m)
        east_x, east_y = first_x, first_y
        for _ in range(columns):
            x, y = flat_m * east_x - lens.eye[0], flat_m * east_y - lens.eye[1]
            along_m = x * lens.forward[0] + y * lens.forward[1] + z * lens.forward[2]
            near_m = math.sqrt(x * x + y * y + z * z) - radius_m
            least_m = min(least_m, max(along_m - radius_m, near_m * lens.corner_cos))
            east_x, east_y = (
                east_x * aside_cosine - east_y * aside_sine,
                east_y * aside_cosine + east_x * aside_sine,
            )
        sine, cosine = (
            sine * up_cosine + cosine * up_sine,
            cosine * up_cosine - sine * up_sine,
        )
    return float(least_m)
