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
from geopage.screen_error import STILL, Sweep
from geopage.view import ViewState
from tiles import cells, geodesy
from tiles.forest import Forest
from tiles.frames import Ecef

AHEAD: tuple[tuple[float, float], ...] = ((0.5, 0.7), (1.0, 0.5))
"""Seconds ahead, and the weight of what is wanted then."""
WINDOW_S = 0.3
SWEEP_S = 0.02
LEAST_HEIGHT_M = 1.0
JUMP_HEIGHTS = 5.0
JUMP_M = 50.0
"""Between two views, more than this many heights and metres is a jump, not a motion."""
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
        return float(np.linalg.norm(self.spin_rad_s))


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
    lon, lat, height_m = geodesy.to_geodetic(Ecef(np.stack([view.eye for view in recent])))
    above_m = np.maximum(height_m - floor_m, LEAST_HEIGHT_M)
    steps_m = np.linalg.norm(np.diff([view.eye for view in recent], axis=0), axis=1)
    jumps = steps_m > JUMP_HEIGHTS * np.minimum(above_m[1:], above_m[:-1]) + JUMP_M
    start = int(np.flatnonzero(jumps)[-1]) + 1 if jumps.any() else 0
    span_s = newest.t_s - recent[start].t_s
    if span_s <= 0:
        return None
    climb = math.log(above_m[-1] / above_m[start]) / span_s
    return Motion(
        math.remainder(lon[-1] - lon[start], 2 * math.pi) / span_s,
        float(lat[-1] - lat[start]) / span_s,
        min(max(climb, -MOST_CLIMB), MOST_CLIMB),
        rotation_vector(newest.rotation.T @ recent[start].rotation) / span_s,
        floor_m,
    )


def sweep_of(view: ViewState, motion: Motion | None, shutter_s: float) -> Sweep:
    """Return how a view moves, as a lens takes it; at rest, or with no shutter, `STILL`."""
    if motion is None or not shutter_s:
        return STILL
    x, y, z = ((predict(view, motion, SWEEP_S).eye - view.eye) / SWEEP_S).tolist()
    spin_x, spin_y, spin_z = motion.spin_rad_s.tolist()
    return Sweep((x, y, z), (spin_x, spin_y, spin_z), shutter_s)


def predict(view: ViewState, motion: Motion, ahead_s: float) -> ViewState:
    """Return the view that the motion leads to."""
    lon, lat, height_m = (float(x) for x in geodesy.to_geodetic(view.eye))
    above_m = max(height_m - motion.floor_m, LEAST_HEIGHT_M)
    above_m = max(above_m * math.exp(motion.climb * ahead_s), LEAST_HEIGHT_M)
    lat = min(max(lat + motion.lat_rad_s * ahead_s, -math.pi / 2), math.pi / 2)
    eye = geodesy.to_ecef(
        lon + motion.lon_rad_s * ahead_s,
        lat,
        motion.floor_m + above_m,
    )
    turn = motion.spin_rad_s * ahead_s
    turn = turn * min(1.0, MOST_TURN_RAD / max(float(np.linalg.norm(turn)), _STILL))
    rotation = view.rotation @ rotation_of(turn).T
    size = view.width_px, view.height_px
    return ViewState(view.t_s + ahead_s, eye, rotation, view.focal_px, *size)


def rotation_vector(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3,) axis times angle of a (3, 3) rotation, up to half a turn."""
    skew = np.array(
        (
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        )
    )
    sine = float(np.linalg.norm(skew)) / 2
    angle = math.atan2(sine, (float(np.trace(rotation)) - 1) / 2)
    return skew * (angle / (2 * sine) if sine > _STILL else 0.0)


def rotation_of(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) rotation by a (3,) axis times angle (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < _STILL:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    turned = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)
    return np.asarray(turned, np.float64)


def ground_under(forest: Forest, eye: Ecef) -> float:
    """Return the least height of the deepest terrain cell under the eye, metres."""
    lon, lat, _ = geodesy.to_geodetic(eye)
    path = cells.cell_at(lon, lat, np.arange(cells.MAX_LEVEL + 1))
    row = int(path[0] >> 2 * cells.MAX_LEVEL + 1)  # the zones are the first rows
    for k in cells.child_position(path[1:]).tolist():
        below = int(forest.children[row, k])
        if below < 0:
            break
        row = below
    return float(forest.records["min_height_m"][row])
