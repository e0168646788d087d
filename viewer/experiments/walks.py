# SPDX-License-Identifier: Apache-2.0
"""Five walks through a plane city: fast, slow, turning, backward and normal.

REVIEW names these five motions and gives no speeds; these are ours.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.view import ViewState
from tiles.frames import Floats
from viewer.camera import FOV_RAD, Pose, view_state
from viewer.experiments.city import lon_lat

STEP_S = 0.1
EYE_M = 1.7
DEEP_M = 1000.0
SIZE_PX = (1000, 1000)
"""Square, so that both fields of view are 60 degrees"""
SPEED_M_S = {"fast": 30.0, "slow": 1.5, "turning": 14.0, "backward": 6.0, "normal": 10.0}
CORNER_S, TURN_RAD_S = 8.0, math.pi / 2


@dataclass(frozen=True, slots=True)
class Walk:
    """Where the eye is at each step, in metres east and north, and how it looks."""

    name: str
    place: Floats
    """(n, 2)"""
    heading_rad: Floats
    """(n,) of the view, clockwise from north"""

    def velocity(self, i: int) -> Floats:
        """Return the speed at a step, (2,) m/s."""
        j = max(i, 1)
        return np.asarray((self.place[j] - self.place[j - 1]) / STEP_S)

    def view(self, i: int) -> ViewState:
        """Return the view at a step."""
        lon, lat = lon_lat(*self.place[i])
        pose = Pose(float(lon), float(lat), EYE_M, float(self.heading_rad[i]), 0.0)
        return view_state(pose, SIZE_PX, FOV_RAD, i * STEP_S)


def make_walk(name: str, start: Floats, seconds: float) -> Walk:
    """Return one of the five walks, the same each time."""
    t_s = np.arange(0.0, seconds, STEP_S)
    heading = COURSES[name](t_s)
    steps = np.stack((np.sin(heading), np.cos(heading)), -1) * SPEED_M_S[name] * STEP_S
    place = start + np.cumsum(steps, axis=0) - steps[0]
    glance = 0.6 * np.sin(0.2 * t_s) if name == "normal" else 0.0
    return Walk(name, place, heading + glance + (np.pi if name == "backward" else 0.0))


def _gentle(t_s: Floats) -> Floats:
    return np.asarray(np.pi / 4 + 0.4 * np.sin(0.05 * t_s))


def _corners(t_s: Floats) -> Floats:
    """Turn a corner every few seconds, two to the right and two to the left."""
    turns = np.array([1, 1, -1, -1])[(t_s // CORNER_S).astype(int) % 4]
    is_turning = t_s % CORNER_S < np.pi / 2 / TURN_RAD_S
    return np.asarray(np.cumsum(turns * is_turning * TURN_RAD_S * STEP_S))


def _wandering(t_s: Floats) -> Floats:
    return np.asarray(np.pi / 4 + np.sin(0.03 * t_s) + 0.5 * np.sin(0.11 * t_s))


COURSES = {
    "fast": _gentle,
    "slow": _wandering,
    "turning": _corners,
    "backward": _gentle,
    "normal": _wandering,
}


def frustum_corners(place: Floats, heading_rad: float) -> Floats:
    """Return eye and far corners of the view, (5, 3) m, 60 by 60 degrees, 1 km deep."""
    wide = DEEP_M * math.tan(FOV_RAD / 2)
    ahead = np.array((math.sin(heading_rad), math.cos(heading_rad), 0.0))
    right = np.array((ahead[1], -ahead[0], 0.0))
    eye = np.array((*place, EYE_M))
    sides = [(x, y) for x in (-wide, wide) for y in (-wide, wide)]
    up = np.array((0.0, 0.0, 1.0))
    return np.array([eye, *(eye + DEEP_M * ahead + x * right + y * up for x, y in sides)])


def in_frustum(
    low: Floats, high: Floats, place: Floats, heading_rad: float
) -> NDArray[np.bool_]:
    """Say which boxes, (n, 3), may be seen: none of the pyramid's faces has them outside.

    Exact but for boxes at the pyramid's edges; these are small.
    """
    tan = math.tan(FOV_RAD / 2)
    ahead = np.array((math.sin(heading_rad), math.cos(heading_rad), 0.0))
    right, up = np.array((ahead[1], -ahead[0], 0.0)), np.array((0.0, 0.0, 1.0))
    sides = (tan * ahead + right, tan * ahead - right, tan * ahead + up, tan * ahead - up)
    eye = np.array((*place, EYE_M))
    seen = np.ones(len(low), np.bool_)
    for normal, offset in (*((side, 0.0) for side in sides), (-ahead, DEEP_M)):
        best = np.where(normal > 0, high, low) - eye
        seen &= best @ normal >= -offset
    return seen
