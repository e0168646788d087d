# SPDX-License-Identifier: Apache-2.0
"""Where the eye will be: the last views' motion, continued.

Longitude, latitude and orientation go on at their rates. Height goes on by its
logarithm, above the ground: a fly-in from 10,000 km to 10 m falls by the same factor
each second, not by the same distance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.handoff import same_pose
from geopage.motion import eye_ahead, rates, rotation_of, rotation_vector, row_under
from geopage.screen_error import STILL, Sweep
from geopage.view import ViewState
from tiles.forest import Forest
from tiles.frames import Ecef
from tiles.geodesy import geodetic_of

AHEAD: tuple[tuple[float, float], ...] = ((0.25, 1.0), (0.5, 0.7), (1.0, 0.5))
"""Seconds ahead, and the weight of what is wanted then."""
WINDOW_S = 0.3
SWEEP_S = 0.02
LEAST_HEIGHT_M = 1.0
JUMP = 5.0, 50.0, 2 * math.pi
"""Between two views, more than this many heights and metres is a jump, not a motion; so
is a turn by more radians a second."""
MOST_CLIMB = 3.0
"""Natural logarithms of height a second."""
MOST_TURN_RAD = math.pi / 2
_STILL = 1e-12
_TWO = 2
"""Views that a motion takes."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Rates of the last moments."""

    lon_rad_s: float
    lat_rad_s: float
    climb: float
    """change of the natural logarithm of the height above `floor_m`, 1/s"""
    spin_rad_s: NDArray[np.float64]
    """(3,) rotation vector, ECEF axes"""
    floor_m: float
    """height above the ellipsoid that the eye stays above"""

    @property
    def turn_rad_s(self) -> float:
        """How fast the view turns."""
        return math.hypot(*self.spin_rad_s.tolist())


def motion_of(views: Sequence[ViewState], floor_m: float) -> Motion | None:
    """Return the motion that the last views show, None at rest or after a jump.

    Parameters
    ----------
    views : oldest first
    floor_m : the lowest that the eye can get, metres above the ellipsoid
    """
    newest = views[-1]
    recent = [view for view in views if 0 <= newest.t_s - view.t_s <= WINDOW_S]
    if len(recent) < _TWO or same_pose(recent[-2], newest):
        return None
    eyes = np.concatenate([view.eye for view in recent]).reshape(-1, 3)
    turns = np.concatenate([view.rotation for view in recent]).reshape(-1, 3, 3)
    times_s = np.array([view.t_s for view in recent])
    start, span_s, lon, lat, climb = rates(
        eyes, turns, times_s, floor_m, LEAST_HEIGHT_M, JUMP
    )
    if span_s <= 0:
        return None
    turn = rotation_vector(newest.rotation.T @ recent[start].rotation)
    climb = min(max(climb / span_s, -MOST_CLIMB), MOST_CLIMB)
    return Motion(lon / span_s, lat / span_s, climb, turn / span_s, floor_m)


def sweep_of(view: ViewState, motion: Motion | None, shutter_s: float) -> Sweep:
    """Return how a view moves, as a lens takes it; at rest, or with no shutter, `STILL`."""
    if motion is None or not shutter_s:
        return STILL
    x, y, z = ((predict(view, motion, SWEEP_S).eye - view.eye) / SWEEP_S).tolist()
    spin_x, spin_y, spin_z = motion.spin_rad_s.tolist()
    return Sweep((x, y, z), (spin_x, spin_y, spin_z), shutter_s)


def predict(view: ViewState, motion: Motion, ahead_s: float) -> ViewState:
    """Return the view that the motion leads to."""
    rates = motion.lon_rad_s, motion.lat_rad_s, motion.climb
    way = rates[0] * ahead_s, rates[1] * ahead_s, rates[2] * ahead_s
    eye = np.array(eye_ahead(view.eye, way, motion.floor_m, LEAST_HEIGHT_M))
    turn = motion.spin_rad_s * ahead_s
    turn *= min(1.0, MOST_TURN_RAD / max(motion.turn_rad_s * ahead_s, _STILL))
    rotation = view.rotation @ rotation_of(turn).T
    size = view.width_px, view.height_px
    return ViewState(view.t_s + ahead_s, Ecef(eye), rotation, view.focal_px, *size)


def ground_under(forest: Forest, eye: Ecef) -> float:
    """Return the least height of the deepest terrain cell under the eye, metres."""
    row = row_under(forest.children, eye)
    return float(forest.records["min_height_m"][row])


def height_of(view: ViewState, floor_m: float) -> float:
    """Return how high the eye is above the ground, metres."""
    return max(geodetic_of(*view.eye.tolist())[2] - floor_m, LEAST_HEIGHT_M)


def warm_up(forest: Forest) -> None:
    """Compile what runs for each list, or load it from the cache."""
    views = [
        ViewState(t_s, Ecef(np.array((x, 0.0, 0.0))), np.eye(3), 500.0, 640, 480)
        for t_s, x in ((0.0, 8e6), (0.1, 7.9e6))
    ]
    if motion := motion_of(views, ground_under(forest, views[0].eye)):
        predict(views[1], motion, 1.0)
        height_of(views[1], motion.floor_m)
