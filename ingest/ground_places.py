# SPDX-License-Identifier: Apache-2.0
"""Where the ground under a footprint is looked at."""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from ingest.footprints import Geometries
from ingest.repair import metres_per_degree
from tiles.frames import Floats, Ints
from tiles.kernels import kernel

SPACING_M = 10.0
"""Edges are looked at this often, and at their ends."""
MAX_STEPS = 256
"""An edge of kilometres is looked at this often, however long it is."""
HALF_ROUND_DEG = 180.0


@dataclass(frozen=True, slots=True)
class Places:
    """Where the ground is looked at: the middle of each footprint, then along its rings."""

    deg: Floats
    """(p, 2) longitude and latitude"""
    start: Ints
    """(n + 1,) where the places of each footprint begin"""
    bounds_deg: Floats
    """(n, 4) west, south, east, north"""
    size_m: Floats
    """(n,) larger side of the box"""

    @property
    def radians(self) -> tuple[Floats, Floats]:
        """Longitudes and latitudes, rad."""
        return np.radians(self.deg[:, 0]), np.radians(self.deg[:, 1])


def places_of(polygon: Geometries, spacing_m: float | Floats = SPACING_M) -> Places:
    """Put places on all corners, every so often along edges, and on the middle.

    Parameters
    ----------
    polygon : (n,) valid polygons, degrees
    spacing_m : how often, for all or for each
    """
    corner, owner = shapely.get_coordinates(polygon, return_index=True)
    first = np.searchsorted(owner, np.arange(len(polygon) + 1))
    if not len(polygon):
        return Places(np.zeros((0, 2)), first, np.zeros((0, 4)), np.zeros(0))
    low = np.minimum.reduceat(corner, first[:-1])
    high = np.maximum.reduceat(corner, first[:-1])
    scale = np.column_stack(metres_per_degree((low[:, 1] + high[:, 1]) / 2))
    spacing = np.broadcast_to(spacing_m, len(polygon))[:, None]
    deg, start = _walked(corner, first, scale / spacing)
    side = high - low
    side[side > HALF_ROUND_DEG] = 0.0  # in parts on both sides of the antimeridian
    size_m = (side * scale).max(axis=1)
    return Places(deg, start, np.hstack((low, high)), size_m)


@kernel
def _walked(corner: Floats, first: Ints, scale: Floats) -> tuple[Floats, Ints]:
    """Return places as in `Places`; `scale` is (n, 2) steps per degree."""
    start = np.zeros(len(first), np.int64)
    for n in range(len(first) - 1):
        start[n + 1] = start[n] + 1
        for k in range(first[n], first[n + 1] - 1):
            start[n + 1] += _steps(corner, k, scale[n])
    # An upper bound: the jumps between rings were counted too.
    deg, count = np.empty((start[-1], 2)), 0
    for n in range(len(first) - 1):
        start[n] = count
        _middle(corner, first[n], first[n + 1], deg[count])
        count += 1
        k = first[n]
        while k < first[n + 1]:
            end = _ring_end(corner, k, first[n + 1])
            while k < end:
                steps = _steps(corner, k, scale[n])
                for step in range(steps):
                    for axis in range(2):
                        run = corner[k + 1, axis] - corner[k, axis]
                        deg[count, axis] = corner[k, axis] + run * (step / steps)
                    count += 1
                k += 1
            k += 1
    start[-1] = count
    return deg[:count], start


@kernel
def _steps(corner: Floats, k: int, scale: Floats) -> int:
    """Return in how many steps the edge after corner k is walked."""
    east = (corner[k + 1, 0] - corner[k, 0]) * scale[0]
    north = (corner[k + 1, 1] - corner[k, 1]) * scale[1]
    steps = math.ceil(math.sqrt(east * east + north * north))
    return min(max(steps, 1), MAX_STEPS)


@kernel
def _ring_end(corner: Floats, k: int, last: int) -> int:
    """Return the coordinate that closes the ring that begins at k."""
    end = k + 1
    while end < last - 1 and (
        corner[end, 0] != corner[k, 0] or corner[end, 1] != corner[k, 1]
    ):
        end += 1
    return end


@kernel
def _middle(corner: Floats, first: int, last: int, place: Floats) -> None:
    """Write the centroid of the largest of a footprint's rings."""
    largest, ring = 0.0, first
    place[0], place[1] = corner[first, 0], corner[first, 1]
    while ring < last:
        end = _ring_end(corner, ring, last)
        area, x, y = 0.0, 0.0, 0.0
        for k in range(ring, end):
            ax, ay = corner[k, 0] - corner[ring, 0], corner[k, 1] - corner[ring, 1]
            bx, by = corner[k + 1, 0] - corner[ring, 0], corner[k + 1, 1] - corner[ring, 1]
            cross = ax * by - bx * ay
            area += cross
            x += (ax + bx) * cross
            y += (ay + by) * cross
        if abs(area) > largest:
            largest = abs(area)
            place[0] = corner[ring, 0] + x / (3 * area)
            place[1] = corner[ring, 1] + y / (3 * area)
        ring = end + 1
