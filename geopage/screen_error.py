# SPDX-License-Identifier: Apache-2.0
"""How many pixels a metre can take on the screen, anywhere in a bounding sphere.

At depth z on a ray at angle a from the axis that is focal / (z cos(a)): a length across
the ray is stretched by 1 / cos(a)**2. `px_per_m` is the most of it in a sphere and the
cone around the picture: a bound that holds anywhere on the screen, and for spheres on the
axis, from twice their radius on, focal / d, d being the distance to the near side, so that
an object of size s passes the threshold tau at d = s f / tau. Nearer ones, and those
off the axis, take most at a point further out than their centre. An eye inside the
sphere gives a huge number.

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
TOLERANCE = 1e-3
"""Share by which the bound may be too high; beside a large sphere 12 halvings leave 3 %."""
HALVINGS = 12
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
    rotation: NDArray[np.float64]
    """(3, 3) of the view"""
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
        np.array(view.rotation, np.float64),
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
    away = max(math.sqrt(x * x + y * y + z * z), NEAR_M)
    near = max(away - radius_m, NEAR_M)
    along = x * lens.forward[0] + y * lens.forward[1] + z * lens.forward[2]
    least = near * lens.corner_cos**2
    if along > away * lens.corner_cos and near > NEAR_M:
        least = near * nearest(radius_m / away, min(along / away, 1.0), lens.corner_cos)
    return float(lens.focal_px / least * weight_of(lens, x, y, z, radius_m))


@kernel
def nearest(size: float, cosine: float, corner_cos: float) -> float:
    """Return the least depth x cosine in a sphere in the picture, over its near distance.

    At an angle d further out than its centre, which lies at angle b, the sphere begins at
    distance cos(d) - sqrt(size**2 - sin(d)**2). That times cos(b + d)**2 is least where
    sin(d) = size sin(atan(2 tan(b + d))), or in the corner. The right side grows with d:
    from either side of the solution it leads closer. The result takes the distance from
    the inner end of what is left, and the cosine from the outer.

    Parameters
    ----------
    size : radius / distance of the centre, below 1
    cosine : of b, at least `corner_cos`
    """
    sine, corner_sin = math.sqrt(1.0 - cosine**2), math.sqrt(1.0 - corner_cos**2)
    outer = max(min(size, corner_sin * cosine - corner_cos * sine), 0.0)
    first = math.sqrt(1.0 + 3.0 * sine**2)
    if first > 2.0 * size:  # sin(b + d) is at most sin(b) + sin(d): 0 on the axis
        outer = min(outer, 2.0 * size * sine / (first - 2.0 * size))
    inner = min(2.0 * size * sine / first, outer)
    for _ in range(HALVINGS):
        level = math.sqrt(1.0 - outer**2)
        out_sin, out_cos = sine * level + cosine * outer, cosine * level - sine * outer
        if 2.0 * out_sin * (outer - inner) <= TOLERANCE * out_cos:
            break
        middle = (inner + outer) / 2.0
        out_sin = sine * math.sqrt(1.0 - middle**2) + cosine * middle
        better = 2.0 * size * out_sin / math.sqrt(1.0 + 3.0 * out_sin**2)
        if better > middle:
            inner = min(better, outer)
        else:
            outer = better
    out_cos = max(cosine * math.sqrt(1.0 - outer**2) - sine * outer, corner_cos)
    begins = math.sqrt(1.0 - inner**2) + math.sqrt(max(size**2 - inner**2, 0.0))
    return float((1.0 + size) / begins * out_cos**2)


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
