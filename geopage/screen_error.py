# SPDX-License-Identifier: Apache-2.0
"""How many pixels a metre can take on the screen, anywhere in a bounding sphere.

On the view axis this is exactly focal / d, d being the distance to the sphere's near
side, so that an object of size s passes the threshold tau at d = s f / tau. Elsewhere
it is a bound: a length across the ray at angle a from the axis is stretched by
1 / cos(a)**2, and no point of the sphere that the picture shows is nearer, along the
axis, than the depth used here. An eye inside the sphere gives a huge number.

What the picture does not show still counts, so that a turned head finds something:
1/8 outside a cone around the axis, 1/32 behind the planet.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.view import ViewState
from tiles.frames import WGS84_B_M
from tiles.kernels import kernel

NEAR_M = 1e-3
OUTSIDE = 1 / 8
HIDDEN = 1 / 32
CONE_MARGIN_RAD = 0.1
TURN_AHEAD_S = 0.5
LOWEST_M = 11_500.0
Xyz = tuple[float, float, float]


class Sweep(NamedTuple):
    """How a view moves, for detail by apparent speed."""

    velocity_m_s: Xyz
    """ECEF axes"""
    spin_rad_s: Xyz
    """rotation vector, ECEF axes"""
    shutter_s: float
    """what moves by more than its size in this time is not worth drawing; 0: all is"""


STILL = Sweep((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)


class Lens(NamedTuple):
    """A view as the kernels take it."""

    eye: NDArray[np.float64]
    """(3,) ECEF m"""
    forward: NDArray[np.float64]
    """(3,) unit"""
    focal_px: float
    corner_cos: float
    """cosine of the angle between the axis and the picture's corner"""
    cone_cos: float
    cone_sin: float
    """of half the angle of the cone outside of which detail counts 1/8"""
    occluder_m: float
    """radius of a sphere that lies inside the planet everywhere"""
    width_px: float
    height_px: float
    sweep: Sweep


def lens_of(
    view: ViewState,
    turn_rad_s: float = 0.0,
    lowest_m: float = -LOWEST_M,
    sweep: Sweep = STILL,
) -> Lens:
    """Return the lens of a view.

    Parameters
    ----------
    view : ViewState
    turn_rad_s : how fast the view turns; the cone widens by half a second of it
    lowest_m : no surface lies lower than this height above the ellipsoid
    sweep : with it, detail counts less where things move fast across the screen
    """
    corner = math.acos(min(1.0, view.corner_cos))
    half = min(corner + CONE_MARGIN_RAD + TURN_AHEAD_S * turn_rad_s, math.pi)
    return Lens(
        np.array(view.eye, np.float64),
        np.array(view.forward, np.float64),
        float(view.focal_px),
        float(view.corner_cos),
        math.cos(half),
        math.sin(half),
        WGS84_B_M + min(lowest_m, 0.0),
        float(view.width_px),
        float(view.height_px),
        sweep,
    )


@kernel
def px_per_m(lens: Lens, x: float, y: float, z: float, radius_m: float) -> float:
    """Return the most pixels that a metre takes in a sphere around (x, y, z)."""
    x, y, z = x - lens.eye[0], y - lens.eye[1], z - lens.eye[2]
    away = math.sqrt(x * x + y * y + z * z)
    near = max(away - radius_m, NEAR_M)
    along = x * lens.forward[0] + y * lens.forward[1] + z * lens.forward[2]
    cosine = min(1.0, max(along / max(away, NEAR_M), lens.corner_cos))
    depth = max(along - radius_m, near * lens.corner_cos)
    scale = lens.focal_px / min(near * cosine * cosine, depth)
    return float(scale * weight_of(lens, x, y, z, radius_m))


@kernel
def error_px_per_m(
    lens: Lens, centre: NDArray[np.float64], radius_m: float, half_m: NDArray[np.float32]
) -> float:
    """Return the most pixels that a metre of error takes in a cell of terrain.

    That is focal / view depth (design: an error is a distance x focal / view depth), for
    the least depth that a point of the picture can have in the cell's box: a sphere
    around a wide flat cell reaches far above the ground, to where the eye is.

    Parameters
    ----------
    centre, radius_m : of the bounding sphere
    half_m : (3,) half the sides of the box: east, north, up at the centre
    """
    cx, cy, cz = centre[0], centre[1], centre[2]
    x, y, z = cx - lens.eye[0], cy - lens.eye[1], cz - lens.eye[2]
    fx, fy, fz = lens.forward[0], lens.forward[1], lens.forward[2]
    level = max(math.sqrt(cx * cx + cy * cy), NEAR_M)
    height = max(math.sqrt(cx * cx + cy * cy + cz * cz), NEAR_M)
    ux, uy, uz = cx / height, cy / height, cz / height
    ex, ey = -cy / level, cx / level
    nx, ny, nz = -uz * ey, uz * ex, ux * ey - uy * ex
    away = math.sqrt(x * x + y * y + z * z)
    along = x * fx + y * fy + z * fz
    reach = (
        abs(fx * ex + fy * ey) * half_m[0] + abs(fx * ux + fy * uy + fz * uz) * half_m[2]
    )
    reach += abs(fx * nx + fy * ny + fz * nz) * half_m[1]
    east = max(abs(x * ex + y * ey) - half_m[0], 0.0)
    north = max(abs(x * nx + y * ny + z * nz) - half_m[1], 0.0)
    up = max(abs(x * ux + y * uy + z * uz) - half_m[2], 0.0)
    near = math.sqrt(east * east + north * north + up * up)
    near = max(near, away - radius_m, NEAR_M)
    depth = max(along - min(reach, radius_m), near * lens.corner_cos)
    return float(lens.focal_px / depth * weight_of(lens, x, y, z, radius_m))


@kernel
def weight_of(lens: Lens, x: float, y: float, z: float, radius_m: float) -> float:
    """Return how much detail in a sphere counts; x, y, z are relative to the eye."""
    if is_hidden(lens, x, y, z, radius_m):
        return HIDDEN
    along = x * lens.forward[0] + y * lens.forward[1] + z * lens.forward[2]
    aside = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    if aside * lens.cone_cos - along * lens.cone_sin > radius_m:
        return OUTSIDE
    return 1.0


@kernel
def blur_px(lens: Lens, x: float, y: float, z: float, radius_m: float) -> float:
    """Return how far all in a sphere around (x, y, z) moves on the screen, at least.

    In the shutter's time. Details smaller than this are passed by before they are seen:
    the Berkeley walkthrough held the size of a face over its speed against a threshold
    (Funkhouser, Sequin, Teller 1992, section 5.1); here it is one shutter's time, and
    the screen error takes the place of the face.
    """
    v, w = lens.sweep.velocity_m_s, lens.sweep.spin_rad_s
    x, y, z = x - lens.eye[0], y - lens.eye[1], z - lens.eye[2]
    away = length((x, y, z))
    near = away - radius_m
    if lens.sweep.shutter_s == 0.0 or near <= NEAR_M:
        return 0.0
    x, y, z = x / away, y / away, z / away
    along = v[0] * x + v[1] * y + v[2] * z
    flow = v[0] - along * x, v[1] - along * y, v[2] - along * z
    turn = w[1] * z - w[2] * y, w[2] * x - w[0] * z, w[0] * y - w[1] * x
    speed_m_s, spin_rad_s = length(v), length(w)
    wide = math.asin(radius_m / away)
    slow, fast = between(length(flow), speed_m_s, wide)
    least, most = between(length(turn), spin_rad_s, wide)
    # Motion and turn may cancel: both in the middle, less what may change on the way out.
    x, y, z = flow[0] / away + turn[0], flow[1] / away + turn[1], flow[2] / away + turn[2]
    change = radius_m / near * (2.0 * speed_m_s / near + spin_rad_s)
    parts = slow / (away + radius_m) - most, least - fast / near
    rad_s = max(parts[0], parts[1], length((x, y, z)) - change, 0.0)
    return float(rad_s * lens.focal_px * lens.sweep.shutter_s)


@kernel
def between(across: float, whole: float, wide: float) -> tuple[float, float]:
    """Return the least and most of `whole` across any way up to `wide` rad from one.

    Parameters
    ----------
    across : the part of it across the way in the middle
    """
    if whole == 0.0:
        return 0.0, 0.0
    angle = math.asin(min(across / whole, 1.0))
    low, high = max(angle - wide, 0.0), min(angle + wide, math.pi / 2)
    return whole * math.sin(low), whole * math.sin(high)


@kernel
def length(v: Xyz) -> float:
    """Return the length of a vector."""
    return math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)


@kernel
def is_hidden(lens: Lens, x: float, y: float, z: float, radius_m: float) -> bool:
    """Say whether the planet hides a whole sphere; x, y, z are relative to the eye."""
    ex, ey, ez = lens.eye[0], lens.eye[1], lens.eye[2]
    up = math.sqrt(ex * ex + ey * ey + ez * ez)
    if up <= lens.occluder_m:
        return False
    along = -(x * ex + y * ey + z * ez) / up
    sine = lens.occluder_m / up
    if along - radius_m <= up * (1.0 - sine * sine):
        return False
    aside = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    return bool(along * sine - aside * math.sqrt(1.0 - sine * sine) > radius_m)


def px_per_m_of(
    lens: Lens, centre: NDArray[np.float64], radius_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Do the same for (n, 3) centres and (n,) radii, in numpy: the kernels' oracle."""
    offset = centre - lens.eye
    away = np.linalg.norm(offset, axis=1)
    near = np.maximum(away - radius_m, NEAR_M)
    along = offset @ lens.forward
    cosine = np.clip(along / np.maximum(away, NEAR_M), lens.corner_cos, 1.0)
    depth = np.maximum(along - radius_m, near * lens.corner_cos)
    scale = lens.focal_px / np.minimum(near * cosine**2, depth)
    return np.asarray(scale * _weights(lens, offset, radius_m))


def error_px_per_m_of(
    lens: Lens,
    centre: NDArray[np.float64],
    radius_m: NDArray[np.float64],
    half_m: NDArray[np.float32],
) -> NDArray[np.float64]:
    """Do the same as `error_px_per_m` for n cells, in numpy: the kernels' oracle."""
    offset = centre - lens.eye
    up = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    east = np.cross((0.0, 0.0, 1.0), centre)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    axes = np.stack((east, np.cross(up, east), up), axis=1)
    beside = np.maximum(np.abs(np.einsum("nij,nj->ni", axes, offset)) - half_m, 0.0)
    near = np.linalg.norm(beside, axis=1)
    near = np.maximum(near, np.linalg.norm(offset, axis=1) - radius_m)
    reach = (np.abs(axes @ lens.forward) * half_m).sum(axis=1)
    depth = offset @ lens.forward - np.minimum(reach, radius_m)
    depth = np.maximum(depth, np.maximum(near, NEAR_M) * lens.corner_cos)
    return np.asarray(lens.focal_px / depth * _weights(lens, offset, radius_m))


def _weights(
    lens: Lens, offset: NDArray[np.float64], radius_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    along = offset @ lens.forward
    aside = np.sqrt(np.maximum((offset**2).sum(axis=1) - along**2, 0.0))
    outside = aside * lens.cone_cos - along * lens.cone_sin > radius_m
    return np.where(
        _hidden(lens, offset, radius_m), HIDDEN, np.where(outside, OUTSIDE, 1.0)
    )


def _hidden(
    lens: Lens, offset: NDArray[np.float64], radius_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    up = float(np.linalg.norm(lens.eye))
    if up <= lens.occluder_m:
        return np.zeros(len(offset), np.bool_)
    along = offset @ (-lens.eye / up)
    sine = lens.occluder_m / up
    aside = np.sqrt(np.maximum((offset**2).sum(axis=1) - along**2, 0.0))
    beyond = along - radius_m > up * (1.0 - sine**2)
    return np.asarray(beyond & (along * sine - aside * math.sqrt(1.0 - sine**2) > radius_m))
