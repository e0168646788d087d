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
        most = _points_to_boxes(groups[g], points[g], box, place, scale[g])
        error[g] = math.sqrt(
            _boxes_to_points(groups[g], points[g], box, hint, place, scale[g], most)
        )
    return error


@kernel
def _points_to_boxes(
    group: Ints, points: Ints, box: Floats, place: Floats, scale: Floats
) -> float:
    most = 0.0
    for p in range(points[0], points[1]):
        nearest = np.inf
        for b in range(group[0], group[1]):
            x = max(box[b, 0] - place[p, 0], 0.0, place[p, 0] - box[b, 2]) * scale[0]
            y = max(box[b, 1] - place[p, 1], 0.0, place[p, 1] - box[b, 3]) * scale[1]
            z = max(box[b, 4] - place[p, 2], 0.0, place[p, 2] - box[b, 5])
            nearest = min(nearest, x * x + y * y + z * z)
            if nearest <= most:
                break
        most = max(most, nearest)
    return most


@kernel
def _boxes_to_points(
    group: Ints,
    points: Ints,
    box: Floats,
    hint: Ints,
    place: Floats,
    scale: Floats,
    most: float,
) -> float:
    """Take points of each box: 5 x 5 on the roof, and the rim half-way up the walls."""
    for b in range(group[0], group[1]):
        west, south, east, north = box[b, 0], box[b, 1], box[b, 2], box[b, 3]
        for i in range(_ROOF + 1):
            for j in range(_ROOF + 1):
                lon = west + (east - west) * i / _ROOF
                lat = south + (north - south) * j / _ROOF
                most = _farther(lon, lat, box[b, 5], points, hint[b], place, scale, most)
                if i in (0, _ROOF) or j in (0, _ROOF):
                    middle = (box[b, 5] + box[b, 6]) / 2
                    most = _farther(lon, lat, middle, points, hint[b], place, scale, most)
    return most


@kernel
def _farther(
    lon: float, lat: float, height: float, points: Ints, hint: int, place: Floats,
    scale: Floats, most: float,
) -> float:  # fmt: skip
    """Return the larger of `most` and the squared distance to the nearest point."""
    nearest = np.inf
    count = points[1] - points[0]
    p = hint
    for _ in range(count):
        x = (place[p, 0] - lon) * scale[0]
        y = (place[p, 1] - lat) * scale[1]
        z = place[p, 2] - height
        nearest = min(nearest, x * x + y * y + z * z)
        if nearest <= most:
            return most
        p += 1
        if p == points[1]:
            p = points[0]
    return nearest
