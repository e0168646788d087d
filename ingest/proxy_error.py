# SPDX-License-Identifier: Apache-2.0
"""The Hausdorff distance between boxes and sampled surfaces, as compiled loops.

Both directions stop early: a point whose nearest neighbour is closer than the largest
distance found so far can't raise it (Taha and Hanbury 2015).
"""

import math

import numpy as np

from tiles.frames import Floats, Ints
from tiles.kernels import kernel

_ROOF = 4
"""Steps across a roof."""


@kernel
def box_errors_m(
    groups: Ints, points: Ints, box: Floats, hint: Ints, place: Floats, scale: Floats
) -> Floats:
    """Return the error of each group of boxes.

    Parameters
    ----------
    groups : (g, 2) first and last + 1 of each group's boxes
    points : (g, 2) first and last + 1 of each group's sampled points
    box : (b, 7) west, south, east, north in degrees; foot, top, ground in m
    hint : (b,) a sampled point of a building in the box
    place : (p, 3) sampled points: degrees, degrees, m
    scale : (g, 2) metres per degree of longitude and latitude

    Returns
    -------
    (g,) largest distance from a point of one to the nearest point of the other, m
    """
    error = np.empty(len(groups))
    for g in range(len(groups)):
        real = place[points[g, 0] : points[g, 1]]
        boxes = slice(groups[g, 0], groups[g, 1])
        most = _points_to_boxes(real, box[boxes], scale[g])
        start = hint[boxes] - points[g, 0]
        error[g] = math.sqrt(_boxes_to_points(real, box[boxes], start, scale[g], most))
    return error


@kernel
def _points_to_boxes(real: Floats, box: Floats, scale: Floats) -> float:
    most = 0.0
    for p in range(len(real)):
        nearest = np.inf
        for b in range(len(box)):
            x = max(box[b, 0] - real[p, 0], 0.0, real[p, 0] - box[b, 2]) * scale[0]
            y = max(box[b, 1] - real[p, 1], 0.0, real[p, 1] - box[b, 3]) * scale[1]
            z = max(box[b, 4] - real[p, 2], 0.0, real[p, 2] - box[b, 5])
            nearest = min(nearest, x * x + y * y + z * z)
            if nearest <= most:
                break
        most = max(most, nearest)
    return most


@kernel
def _boxes_to_points(
    real: Floats, box: Floats, start: Ints, scale: Floats, most: float
) -> float:
    """Take points of each box: 5 x 5 on the roof, and its rim half-way up the walls."""
    for b in range(len(box)):
        for step in range((_ROOF + 1) ** 2):
            i, j = step // (_ROOF + 1), step % (_ROOF + 1)
            lon = box[b, 0] + (box[b, 2] - box[b, 0]) * i / _ROOF
            lat = box[b, 1] + (box[b, 3] - box[b, 1]) * j / _ROOF
            top = (lon, lat, box[b, 5])
            most = _farther(top, real, start[b], scale, most)
            if i in (0, _ROOF) or j in (0, _ROOF):
                middle = (lon, lat, (box[b, 5] + box[b, 6]) / 2)
                most = _farther(middle, real, start[b], scale, most)
    return most


@kernel
def _farther(
    point: tuple[float, float, float], real: Floats, start: int, scale: Floats, most: float
) -> float:
    """Return the larger of `most` and the squared distance to the nearest real point."""
    nearest = np.inf
    p = start
    for _ in range(len(real)):
        x = (real[p, 0] - point[0]) * scale[0]
        y = (real[p, 1] - point[1]) * scale[1]
        z = real[p, 2] - point[2]
        nearest = min(nearest, x * x + y * y + z * z)
        if nearest <= most:
            return most
        p += 1
        if p == len(real):
            p = 0
    return nearest
