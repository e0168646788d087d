# SPDX-License-Identifier: Apache-2.0
"""From what hands do to where the eye is: no window, no drawing, any clock.

Mouse positions are pixels of the picture from its top left corner. What is held stays
under the cursor; what is let go glides on for a moment. Everything ends above ground.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from geopage.view import ViewState
from tiles import geodesy
from tiles.frames import Ecef
from viewer.camera import Pose, rotation, view_state
from viewer.navigation_arc import Arc, GroundBelow
from viewer.navigation_drag import Cursor, Drag, grab, look, tilt
from viewer.navigation_geometry import (
    Grip,
    Lens,
    Orbit,
    distance_m,
    eye_of,
    glide,
    hold,
    orbit_of,
    pose_of,
    steepest_up,
)

Touch = Callable[[float, float], Ecef | None]
"""The point of the world that is drawn at a pixel, None where sky."""

CLEAR_M = 2.0
"""The eye stays so far above the ground."""
HIGHEST_M = 5e7
NOTCH = 0.75
"""Distance after one notch of the wheel, of what it was."""
ZOOM_S, EASE_S = 0.09, 0.18
"""Time constants of the wheel's and the keys' inertia."""
PACE = 0.6
"""Heights above ground that the keys fly in a second."""
SLOWEST_M, FASTEST_M = 4.0, 4e6
FAST = 4.0
TURN_RAD_S = 0.9
NEAREST_M = 3.0
LONGEST_STEP_S = 0.25
WAYS = {
    "forward": (0, 1.0),
    "back": (0, -1.0),
    "right": (1, 1.0),
    "left": (1, -1.0),
    "up": (2, 1.0),
    "down": (2, -1.0),
    "turn_right": (3, 1.0),
    "turn_left": (3, -1.0),
    "look_up": (4, 1.0),
    "look_down": (4, -1.0),
}
"""What keys may be held for: an axis of the motion and its sign."""


class Navigator:
    """Turns drags, wheel and keys into poses.

    Parameters
    ----------
    pose : where to begin
    lens : of the picture
    touch : what is drawn where
    ground : height of the ground below a pose
    """

    def __init__(self, pose: Pose, lens: Lens, touch: Touch, ground: GroundBelow) -> None:
        self.lens, self._touch, self._ground = lens, touch, ground
        self.home = self.pose = self._above_ground(pose)
        self.held: set[str] = set()
        """which of `WAYS` are held down"""
        self.fast = False
        self._cursor = Cursor()
        self._drag: Drag | None = None
        self._zoom_log = 0.0
        self._zoom: tuple[tuple[float, float], Grip | None] = ((0.0, 0.0), None)
        self._speed = np.zeros(5)
        self._arc: tuple[Arc, float] | None = None
        self._now_s: float | None = None

    # What hands do.

    def press(self, x: float, y: float, *, tilting: bool = False) -> None:
        """Take hold of the world at a pixel, or of the point in view to tilt and turn."""
        self.stop()
        self._cursor.put(x, y)
        if tilting:
            width, height = self.lens.size_px
            pivot = self._touch(width / 2, height / 2)
            self._drag = look if pivot is None else tilt(self.pose, pivot)
            return
        point, away_m = self._touch(x, y), np.linalg.norm(eye_of(self.pose))
        is_below = point is not None and np.linalg.norm(point) < away_m
        self._drag = grab(self.pose, point) if point is not None and is_below else look

    def move(self, x: float, y: float) -> None:
        """Move the cursor."""
        self._cursor.move(x, y)

    def release(self) -> None:
        """Let go; what moved glides on."""
        self._cursor.let_go()

    def wheel(self, x: float, y: float, notches: float) -> None:
        """Zoom to a pixel; positive notches come nearer."""
        self._arc = None
        self._zoom_log += notches * math.log(NOTCH)
        if self._zoom[0] != (x, y) or self._zoom[1] is None:
            point = self._touch(x, y)
            self._zoom = (x, y), None if point is None else Grip(point, math.inf)

    def stop(self) -> None:
        """End every motion but that of held keys."""
        self._drag, self._arc, self._zoom_log = None, None, 0.0
        self._zoom = (0.0, 0.0), None
        self._cursor.stop()

    # Where to go by itself.

    def fly_to(self, pose: Pose) -> Pose:
        """Fly to a pose, and return it (above ground)."""
        self.stop()
        end = self._above_ground(pose)
        self._arc = Arc(self.pose, end, self._ground), 0.0
        return end

    def approach(self, x: float, y: float) -> Pose | None:
        """Fly to what is drawn at a pixel; returns where the flight ends."""
        point = self._touch(x, y)
        if point is None:
            return None
        now = orbit_of(self.pose, point)
        near_m = max(0.2 * distance_m(self.pose, point), 40.0)
        above = max(now.above_rad, math.radians(15.0))
        if near_m < 50_000.0:
            above = min(above, math.radians(60.0))
        return self.fly_to(Orbit(point, near_m, self.pose.heading_rad, above).pose())

    def face(self, heading_rad: float) -> None:
        """Turn to a heading around the point in view."""
        width, height = self.lens.size_px
        pivot = self._touch(width / 2, height / 2)
        end = replace(self.pose, heading_rad=heading_rad)
        if pivot is not None:
            end = replace(orbit_of(self.pose, pivot), heading_rad=heading_rad).pose()
        self.fly_to(replace(end, heading_rad=heading_rad))

    # Time.

    @property
    def moving(self) -> bool:
        """Whether the next step may change the pose."""
        moved = self._drag is not None and self._cursor.moving
        rolling = bool(self._speed.any() or self.held or self._zoom_log)
        return moved or rolling or self._arc is not None

    @property
    def destination(self) -> Pose | None:
        """Where a flight ends, None where there is none."""
        return self._arc[0].end if self._arc else None

    def step(self, now_s: float) -> Pose:
        """Return the pose at a time; time stands still between steps far apart."""
        last_s = now_s if self._now_s is None else self._now_s
        past_s = min(max(now_s - last_s, 0.0), LONGEST_STEP_S)
        self._now_s = now_s
        before = self.pose
        if self._arc is not None:
            self._fly(past_s)
        self._do_zoom(past_s)
        self._do_drag(past_s)
        self._do_keys(past_s)
        if self.pose is not before:
            self.pose = self._above_ground(self.pose)
        return self.pose

    def view(self, now_s: float) -> ViewState:
        """Return the view of the pose, on the clock of the caller."""
        return view_state(self.pose, self.lens.size_px, self.lens.fov_rad, now_s)

    def _fly(self, past_s: float) -> None:
        assert self._arc
        arc, t_s = self._arc[0], self._arc[1] + past_s
        self.pose = arc.pose_at(t_s)
        self._arc = None if t_s >= arc.duration_s or self.held else (arc, t_s)

    def _do_zoom(self, past_s: float) -> None:
        if not self._zoom_log:
            return
        part = self._zoom_log * (1 - math.exp(-past_s / ZOOM_S))
        rest = self._zoom_log - part
        if abs(rest) < 1e-3:
            part, rest = self._zoom_log, 0.0
        pixel, grip = self._zoom
        self.pose = self._zoomed(math.exp(part), pixel, grip)
        self._zoom_log = rest
        if not rest:
            self._zoom = (0.0, 0.0), None

    def _zoomed(self, factor: float, pixel: tuple[float, float], grip: Grip | None) -> Pose:
        """Return a pose at a factor of the distance to what is held."""
        pose = self.pose
        floor_m = self._ground(pose)
        if grip is None:
            floor_m = min(floor_m, pose.height_m - CLEAR_M)
            return self._at_height(floor_m + (pose.height_m - floor_m) * factor)
        base_m = float(geodesy.to_geodetic(grip.point)[2])
        away_m = distance_m(pose, grip.point)
        if away_m * factor < NEAREST_M:
            return pose
        if pose.height_m - base_m < 0.02 * away_m:  # beside or above the eye
            eye = grip.point + (eye_of(pose) - grip.point) * factor
            return pose_of(eye, rotation(pose))
        start = self._at_height(base_m + (pose.height_m - base_m) * factor)
        return self._keep(self._above_ground(start), pixel, grip) or start

    def _at_height(self, height_m: float) -> Pose:
        height_m = min(height_m, HIGHEST_M)
        pitch = min(self.pose.pitch_rad, steepest_up(height_m))
        return replace(self.pose, height_m=height_m, pitch_rad=pitch)

    def _keep(self, pose: Pose, pixel: tuple[float, float], grip: Grip) -> Pose | None:
        """Return a pose that holds a point at a pixel, where one sees so far."""
        eye, ray = eye_of(pose), self.lens.ray(pose, *pixel)
        away_m, along = float(np.linalg.norm(eye)), float(eye @ ray)
        if along >= 0 or away_m**2 - along**2 > float(grip.point @ grip.point):
            return None
        return hold(pose, self.lens, pixel, grip) or hold(
            pose, self.lens, pixel, replace(grip, turns=True)
        )

    def _do_drag(self, past_s: float) -> None:
        if self._drag is None:
            return
        x, y, dx, dy, done = self._cursor.step(past_s)
        if dx or dy:
            self.pose = self._drag(self.pose, self.lens, (x, y), (dx, dy))
            raised = self._above_ground(self.pose)
            if raised is not self.pose:
                self.pose = self._drag(raised, self.lens, (x, y), (0.0, 0.0))
        if done:
            self._drag = None

    def _do_keys(self, past_s: float) -> None:
        wanted = np.zeros(5)
        for way in self.held:
            axis, sign = WAYS[way]
            wanted[axis] += sign
        wanted *= FAST if self.fast else 1.0
        self._speed += (wanted - self._speed) * (1 - math.exp(-past_s / EASE_S))
        if not wanted.any() and np.abs(self._speed).max() < 0.01:
            self._speed[:] = 0.0
        if not self._speed.any() or not past_s:
            return
        ahead, aside, rise, turn, lift = (self._speed * past_s).tolist()
        pace = self.pace_m()
        heading = self.pose.heading_rad
        sine, cosine = math.sin(heading), math.cos(heading)
        east, north = ahead * sine + aside * cosine, ahead * cosine - aside * sine
        pose = glide(self.pose, pace * east, pace * north) if east or north else self.pose
        height = min(pose.height_m + pace * rise, HIGHEST_M)
        pitch = pose.pitch_rad + lift * TURN_RAD_S
        pitch = max(min(pitch, steepest_up(height)), -math.pi / 2)
        heading = (pose.heading_rad + turn * TURN_RAD_S) % (2 * math.pi)
        self.pose = replace(pose, height_m=height, pitch_rad=pitch, heading_rad=heading)

    def pace_m(self) -> float:
        """Return the speed of the keys at this height above ground, m/s."""
        pose = self.pose
        above_m = pose.height_m - self._ground(pose)
        return PACE * min(max(above_m, SLOWEST_M), FASTEST_M)

    def _above_ground(self, pose: Pose) -> Pose:
        least_m = self._ground(pose) + CLEAR_M
        return pose if pose.height_m >= least_m else replace(pose, height_m=least_m)
