# SPDX-License-Identifier: Apache-2.0
"""The way of a flight to a place: up, over and down again.

Height and way follow the path on which the picture seems to move evenly and as little
as possible (van Wijk and Nuij, Smooth and efficient zooming and panning, 2003): the
logarithm of the height rises, stands and falls with the way over the ground.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tiles.frames import Floats
from viewer.camera import Pose
from viewer.navigation_geometry import steepest_up

RHO = 1.3
"""How much higher a longer way leads."""
SPEED = 1.6
"""Of the path, in its own unit, a second."""
SHORTEST_S, LONGEST_S = 0.8, 7.0
LOWEST_M = 2.0
MEAN_RADIUS_M = 6.371e6
GroundBelow = Callable[[Pose], float]
"""Ellipsoidal height of the ground below a pose, m."""


@dataclass(frozen=True, slots=True)
class _Way:
    """The shape of the path: share of the way and height at a share of its length."""

    length: float
    start_m: float
    end_m: float
    ground_m: float
    r0: float

    def at(self, share: float) -> tuple[float, float]:
        """Return the share of the way over the ground, and the height, m."""
        s = share * self.length
        if self.ground_m <= 0.0:
            return share, self.start_m * (self.end_m / self.start_m) ** share
        turned = RHO * s + self.r0
        cosh0 = math.cosh(self.r0)
        height_m = self.start_m * cosh0 / math.cosh(turned)
        way_m = cosh0 * math.tanh(turned) - math.sinh(self.r0)
        return self.start_m / RHO**2 * way_m / self.ground_m, height_m


def _way(start_m: float, end_m: float, ground_m: float) -> _Way:
    """Return the path between two heights over a distance."""
    if ground_m < 1e-3 * min(start_m, end_m):
        return _Way(abs(math.log(end_m / start_m)) / RHO, start_m, end_m, 0.0, 0.0)
    rise, u = end_m**2 - start_m**2, RHO**4 * ground_m**2
    b0 = (rise + u) / (2 * start_m * RHO**2 * ground_m)
    b1 = (rise - u) / (2 * end_m * RHO**2 * ground_m)
    r0, r1 = -math.asinh(b0), -math.asinh(b1)
    return _Way((r1 - r0) / RHO, start_m, end_m, ground_m, r0)


class Arc:
    """A flight from one pose to another.

    Parameters
    ----------
    ground : height of the ground; asked at both ends only
    """

    def __init__(self, start: Pose, end: Pose, ground: GroundBelow) -> None:
        self.end = end
        self._start = start
        self._a, self._b = _unit(start), _unit(end)
        self._angle = math.atan2(
            float(np.linalg.norm(np.cross(self._a, self._b))), float(self._a @ self._b)
        )
        self._floor = ground(start), ground(end)
        heights = (start.height_m, end.height_m)
        a_m, b_m = (max(h - f, LOWEST_M) for h, f in zip(heights, self._floor, strict=True))
        self._path = _way(a_m, b_m, self._angle * MEAN_RADIUS_M)
        turn = math.remainder(end.heading_rad - start.heading_rad, 2 * math.pi)
        self._turn_rad = turn
        seen = self._path.length + (abs(turn) + abs(end.pitch_rad - start.pitch_rad)) / 2
        self.duration_s = min(max(seen / SPEED, SHORTEST_S), LONGEST_S)

    def pose_at(self, t_s: float) -> Pose:
        """Return the pose so long after the start."""
        if t_s >= self.duration_s:
            return self.end
        share = max(t_s, 0.0) / self.duration_s
        eased = share * share * share * (share * (share * 6 - 15) + 10)
        over, above_m = self._path.at(eased)
        over = min(max(over, 0.0), 1.0)
        lon, lat = self._place(over)
        floor_m = self._floor[0] + (self._floor[1] - self._floor[0]) * over
        height_m = above_m + floor_m
        start, end = self._start, self.end
        pitch = start.pitch_rad + (end.pitch_rad - start.pitch_rad) * eased
        heading = (start.heading_rad + self._turn_rad * eased) % (2 * math.pi)
        return Pose(lon, lat, height_m, heading, min(pitch, steepest_up(height_m)))

    def _place(self, share: float) -> tuple[float, float]:
        """Return longitude and latitude on the great circle."""
        if self._angle < 1e-12:
            return self.end.lon_rad, self.end.lat_rad
        side = np.cross(np.cross(self._a, self._b), self._a)
        if not side.any():  # to the other side of the earth: any way is the shortest
            side = np.cross(np.roll(self._a, 1), self._a)
        side /= np.linalg.norm(side)
        at = math.cos(share * self._angle) * self._a + math.sin(share * self._angle) * side
        x, y, z = at.tolist()
        return math.atan2(y, x), math.atan2(z, math.hypot(x, y))


def _unit(pose: Pose) -> Floats:
    lon, lat = pose.lon_rad, pose.lat_rad
    return np.array(
        (math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat))
    )
