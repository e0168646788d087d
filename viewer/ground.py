# SPDX-License-Identifier: Apache-2.0
"""How high the ground is under an eye, asked many times a second."""

import math

import numpy as np

from tiles.surface import Surface
from viewer.camera import Pose

HIGH_M = 20_000.0
"""From so far above the tile's lowest point the index's bounds are good enough."""
KEPT_RAD = 1e-9
"""A place nearer than this (6 mm) is the same."""


class Ground:
    """The ground of a store. Far above, no tile is read. Thread: the surface's."""

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self._last = (math.inf, math.inf, 0.0)

    def height_m(self, lon_rad: float, lat_rad: float) -> float:
        """Return the height of the finest stored terrain above the ellipsoid, m."""
        lon, lat, height_m = self._last
        if abs(lon - lon_rad) < KEPT_RAD and abs(lat - lat_rad) < KEPT_RAD:
            return height_m
        height_m = self._surface.height_at(lon_rad, lat_rad)
        self._last = lon_rad, lat_rad, height_m
        return height_m

    def below(self, pose: Pose) -> float:
        """Return the ground's height below an eye: exact near the ground."""
        lon, lat = np.array([pose.lon_rad]), np.array([pose.lat_rad])
        row = int(self._surface.rows(lon, lat)[0])
        if row < 0:
            return 0.0
        record = self._surface.forest.records[row]
        low, high = float(record["min_height_m"]), float(record["max_height_m"])
        if pose.height_m - low > HIGH_M:
            return (low + high) / 2
        return self.height_m(pose.lon_rad, pose.lat_rad)
