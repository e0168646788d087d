# SPDX-License-Identifier: Apache-2.0
"""What a drag does to a pose, and how the cursor glides on after it was let go."""

import math
from collections.abc import Callable
from dataclasses import replace

from tiles.frames import Ecef
from viewer.camera import Pose
from viewer.navigation_geometry import (
    STEEPEST_RAD,
    Grip,
    Lens,
    distance_m,
    hold,
    orbit_of,
    steepest_up,
)

Drag = Callable[[Pose, Lens, tuple[float, float], tuple[float, float]], Pose]
"""From pose, lens, cursor (px) and its way since the last step (px) to the pose."""
REACH = 12.0
"""What is held is taken up to so many times as far as it was."""
LOWEST_RAD = math.radians(3.0)
"""A tilt ends so far above the pivot's level."""
GLIDE_S, QUICK_S, REST_PX_S = 0.25, 0.04, 8.0
"""Of the inertia: how long, from which motion before letting go, until how slow."""


class Cursor:
    """Where the cursor is, and where it glides after it was let go."""

    def __init__(self) -> None:
        self._at = self._seen = (0.0, 0.0)
        self._speed = (0.0, 0.0)
        self._free = True

    @property
    def moving(self) -> bool:
        """Whether it has moved since the last step, or glides."""
        return self._at != self._seen or self._free

    def put(self, x: float, y: float) -> None:
        """Begin at a pixel."""
        self._at = self._seen = (x, y)
        self._speed, self._free = (0.0, 0.0), False

    def move(self, x: float, y: float) -> None:
        """Follow the hand."""
        if not self._free:
            self._at = (x, y)

    def let_go(self) -> None:
        """Glide on."""
        self._free = True
        if math.hypot(*self._speed) < REST_PX_S:
            self._speed = (0.0, 0.0)

    def stop(self) -> None:
        """Stand still."""
        self._speed, self._free, self._seen = (0.0, 0.0), True, self._at

    def step(self, past_s: float) -> tuple[float, float, float, float, bool]:
        """Return cursor, its way since the last step, and whether it came to rest."""
        if self._free and self._at == self._seen:
            self._at = tuple(  # type: ignore[assignment]
                at + v * past_s for at, v in zip(self._at, self._speed, strict=True)
            )
            fade = math.exp(-past_s / GLIDE_S)
            self._speed = self._speed[0] * fade, self._speed[1] * fade
        elif past_s:
            keep = math.exp(-past_s / QUICK_S)
            self._speed = tuple(  # type: ignore[assignment]
                keep * v + (1 - keep) * (at - was) / past_s
                for v, at, was in zip(self._speed, self._at, self._seen, strict=True)
            )
        way = self._at[0] - self._seen[0], self._at[1] - self._seen[1]
        self._seen = self._at
        done = self._free and math.hypot(*self._speed) < REST_PX_S
        return *self._at, *way, done


def grab(pose: Pose, point: Ecef) -> Drag:
    """Return the drag that keeps a point of the world under the cursor."""
    grip = Grip(point, REACH * distance_m(pose, point))

    def drag(
        pose: Pose, lens: Lens, at: tuple[float, float], _way: tuple[float, float]
    ) -> Pose:
        nonlocal grip
        if (held := hold(pose, lens, at, grip)) is None:
            grip = replace(grip, turns=True)
            held = hold(pose, lens, at, grip)
        return held or pose

    return drag


def tilt(pose: Pose, pivot: Ecef) -> Drag:
    """Return the drag that tilts and turns the view around a pivot."""
    orbit = orbit_of(pose, pivot)

    def drag(
        pose: Pose, lens: Lens, _at: tuple[float, float], way: tuple[float, float]
    ) -> Pose:
        nonlocal orbit
        turn = math.pi / max(lens.size_px)
        heading = orbit.heading_rad + way[0] * turn
        above = min(max(orbit.above_rad + way[1] * turn, LOWEST_RAD), math.pi / 2)
        turned = replace(orbit, heading_rad=heading, above_rad=above)
        found = turned.pose()
        if found.pitch_rad > steepest_up(found.height_m):
            return pose
        orbit = turned
        return found

    return drag


def look(
    pose: Pose, lens: Lens, _at: tuple[float, float], way: tuple[float, float]
) -> Pose:
    """Turn the head: the sky stays under the cursor. A `Drag`."""
    turn = lens.fov_rad / lens.size_px[1]
    heading = (pose.heading_rad - way[0] * turn) % (2 * math.pi)
    pitch = min(pose.pitch_rad + way[1] * turn, steepest_up(pose.height_m))
    return replace(pose, heading_rad=heading, pitch_rad=max(pitch, -STEEPEST_RAD))
