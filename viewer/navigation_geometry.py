# SPDX-License-Identifier: Apache-2.0
"""Poses that keep a point of the world under a pixel, or in the middle of the picture.

All of it is float64 ECEF and holds over the poles and the antimeridian. A pose has no
roll: right is always level.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from tiles import geodesy
from tiles.frames import Ecef, Floats
from viewer.camera import FOV_RAD, Pose, focal_px, rotation

SECANTS = 24
FREE_TURNS = 12
CLOSE_RAD = 1e-13
POLAR_RAD = math.radians(80.0)
"""Beyond it, dragging lets the heading turn instead of spinning around the pole."""
FLATTEST = 0.3
"""So also where the eye would go much farther over the latitudes than what is held."""
STEEPEST_RAD = math.radians(89.999)
LEVEL_UP_TO_M = 10_000.0
"""Up to here one may look anywhere; far above, the globe stays in the picture."""
SPACE_M = 2e6


@dataclass(frozen=True, slots=True)
class Lens:
    """How a picture sees."""

    size_px: tuple[int, int]
    fov_rad: float = FOV_RAD

    def ray(self, pose: Pose, x: float, y: float) -> Floats:
        """Return the unit direction of a pixel (0, 0 is the top left corner), (3,) ECEF."""
        width, height = self.size_px
        focal = focal_px(height, self.fov_rad)
        camera = np.array(((x - width / 2) / focal, (height / 2 - y) / focal, -1.0))
        return np.asarray(camera / np.linalg.norm(camera) @ rotation(pose))


@dataclass(frozen=True, slots=True)
class Grip:
    """A point of the world that a person holds."""

    point: Ecef
    reach_m: float
    """No farther from the eye is the point taken"""
    turns: bool = False
    """whether the heading gives way, as it has to near the poles"""


def eye_of(pose: Pose) -> Ecef:
    """Return where the eye is, (3,) ECEF m."""
    return geodesy.to_ecef(pose.lon_rad, pose.lat_rad, pose.height_m)


def pose_of(eye: Floats, axes: Floats) -> Pose:
    """Return the pose of an eye and its rows right, up, backward; a roll is dropped."""
    lon, lat, height_m = (float(one) for one in geodesy.to_geodetic(Ecef(eye)))
    enu = geodesy.enu_axes(lon, lat)
    right, forward = enu @ axes[0], enu @ -axes[2]
    heading = math.atan2(-right[1], right[0]) % (2 * math.pi)
    return Pose(lon, lat, height_m, heading, math.asin(min(max(forward[2], -1.0), 1.0)))


def distance_m(pose: Pose, point: Floats) -> float:
    """Return how far a point is from the eye."""
    return float(np.linalg.norm(point - eye_of(pose)))


def meet(eye: Floats, ray: Floats, radius_m: float, reach_m: float = math.inf) -> Floats:
    """Return where a ray meets a sphere around the earth's centre, (3,) m.

    Where it misses the sphere, or meets it beyond `reach_m`, the point is the one in the
    same direction that is as far as one can see and reach.
    """
    away = float(np.linalg.norm(eye))
    up = eye / away
    along = float(eye @ ray)
    inside = along * along - (away * away - radius_m * radius_m)
    if inside >= 0.0 and along < 0.0:
        t = -along - math.sqrt(inside)
        if 0.0 <= t <= reach_m:
            return np.asarray(eye + t * ray)
    level = ray - (ray @ up) * up
    level /= max(float(np.linalg.norm(level)), 1e-12)
    most = math.acos(min(radius_m / away, 1.0))
    reach_m = max(reach_m, abs(away - radius_m))
    cosine = (away**2 + radius_m**2 - reach_m**2) / (2 * away * radius_m)
    angle = min(most, math.acos(max(cosine, -1.0)) if cosine < 1.0 else 0.0)
    return np.asarray(radius_m * (math.cos(angle) * up + math.sin(angle) * level))


def hold(pose: Pose, lens: Lens, pixel: tuple[float, float], grip: Grip) -> Pose | None:
    """Return a pose of the same height and pitch that sees a point at a pixel.

    Returns
    -------
    None where the heading can't be kept and `grip.turns` is False
    """
    if grip.turns:
        return _hold_free(pose, lens, pixel, grip)
    # The ellipsoid is the same all around its axis: only the latitude is to be found.
    x, y, z = grip.point
    radius_m = float(np.linalg.norm(grip.point))
    wanted, wanted_lon = math.asin(z / radius_m), math.atan2(y, x)

    def seen(lat: float) -> tuple[float, float]:
        at = replace(pose, lon_rad=0.0, lat_rad=lat)
        found = meet(eye_of(at), lens.ray(at, *pixel), radius_m, grip.reach_m)
        return math.asin(found[2] / radius_m) - wanted, math.atan2(found[1], found[0])

    lat, (off, east) = pose.lat_rad, seen(pose.lat_rad)
    step = -off
    for _ in range(SECANTS):
        if abs(off) < CLOSE_RAD or abs(step) < CLOSE_RAD / 4:
            lon = math.remainder(wanted_lon - east, 2 * math.pi)
            return replace(pose, lon_rad=lon, lat_rad=lat)
        if abs(lat + step) > POLAR_RAD:
            return None
        before, lat = off, lat + step
        off, east = seen(lat)
        slope = (off - before) / step if step else 1.0
        if slope < FLATTEST:
            return None
        step = -off / slope
    return None


def _hold_free(pose: Pose, lens: Lens, pixel: tuple[float, float], grip: Grip) -> Pose:
    """Turn the eye around the earth's centre by the shortest way, heading and all."""
    radius_m = float(np.linalg.norm(grip.point))
    held = pose
    for _ in range(FREE_TURNS):
        eye, axes = eye_of(held), rotation(held)
        found = meet(eye, lens.ray(held, *pixel), radius_m, grip.reach_m)
        turn = turn_between(found / radius_m, grip.point / radius_m)
        moved = pose_of(turn @ eye, axes @ turn.T)
        held = replace(moved, height_m=pose.height_m, pitch_rad=pose.pitch_rad)
        if float(np.linalg.norm(found - grip.point)) < CLOSE_RAD * radius_m:
            break
    return held


def turn_between(a: Floats, b: Floats) -> Floats:
    """Return the shortest rotation, (3, 3), that turns unit vector a into b."""
    axis = np.cross(a, b)
    return turn_about(axis, math.atan2(float(np.linalg.norm(axis)), float(a @ b)))


def turn_about(axis: Floats, angle_rad: float) -> Floats:
    """Return the rotation, (3, 3), around an axis of any length; none about no axis."""
    length = float(np.linalg.norm(axis))
    if length < 1e-300 or angle_rad == 0.0:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    return np.asarray(
        np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * cross @ cross
    )


def glide(pose: Pose, east_m: float, north_m: float) -> Pose:
    """Return a pose moved straight ahead over the globe, by metres at the eye.

    It keeps height and pitch; the heading stays relative to the way, so that the way is
    a great circle, also over a pole.
    """
    eye, axes = eye_of(pose), rotation(pose)
    enu = geodesy.enu_axes(pose.lon_rad, pose.lat_rad)
    way = east_m * enu[0] + north_m * enu[1]
    length_m = float(np.linalg.norm(way))
    angle = length_m / float(np.linalg.norm(eye))
    turn = turn_about(np.cross(eye, way), angle)
    moved = pose_of(turn @ eye, axes @ turn.T)
    return replace(moved, height_m=pose.height_m, pitch_rad=pose.pitch_rad)


@dataclass(frozen=True, slots=True)
class Orbit:
    """A view of a pivot from outside, in the pivot's own east, north, up."""

    pivot: Ecef
    distance_m: float
    heading_rad: float
    """in which one looks at it"""
    above_rad: float
    """by how much the eye stands above the pivot's level"""

    def pose(self) -> Pose:
        """Return the pose that has the pivot in the middle of the picture."""
        lon, lat, _ = (float(one) for one in geodesy.to_geodetic(self.pivot))
        seen = Pose(lon, lat, 0.0, self.heading_rad, -self.above_rad)
        axes = rotation(seen)
        return pose_of(self.pivot + self.distance_m * axes[2], axes)


def orbit_of(pose: Pose, pivot: Ecef) -> Orbit:
    """Return the orbit that a pose with a pivot in the middle of its picture is on."""
    axes = rotation(pose)
    lon, lat, _ = (float(one) for one in geodesy.to_geodetic(pivot))
    seen = pose_of(geodesy.to_ecef(lon, lat, 0.0), axes)
    return Orbit(pivot, distance_m(pose, pivot), seen.heading_rad, -seen.pitch_rad)


def steepest_up(height_m: float) -> float:
    """Return the highest pitch at a height that does not lose the globe, rad."""
    if height_m <= LEVEL_UP_TO_M:
        return STEEPEST_RAD
    share = math.log(height_m / LEVEL_UP_TO_M) / math.log(SPACE_M / LEVEL_UP_TO_M)
    radius_m = 6.371e6
    dip = math.acos(radius_m / (radius_m + height_m))
    above = (1 - min(share, 1.0)) * math.pi / 2 - math.radians(2.0)
    return min(above - dip, STEEPEST_RAD)
