# SPDX-License-Identifier: Apache-2.0
"""Sums over the lines of a rim: a tree of balls instead of all of them.

Rows of `lines`, (n, 8) float32, are both ends around the middle of the line's ball and
the deltas there; rows of `balls`, (b, 6) float64, are centre, radius, length of the lines
in it, and their mean delta; `below`, (b, 2), is the range of rows in a ball: of `lines`
for the first balls, of `balls` for the others. The last ball holds all.
"""

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import inlined, summing

REACH = 3.0
"""Lines count up to this many times the distance of the nearest one."""
GROUP_FROM, GROUP_TO = 2.0, 3.0
"""Distance in radii from where a ball's lines begin to count as one, and wholly do"""
STACK = 256
Lines = NDArray[np.float32]
Rows = NDArray[np.int32]


@summing
def deltas(
    lines: Lines,
    balls: Floats,
    below: Rows,
    places: Floats,
    feather_m: float,
    delta: Floats,
    near: Floats,
) -> None:
    """Fill in the delta surface and the rim's distance where that is below the feather."""
    stack, share = np.empty(STACK, np.int64), np.empty(STACK)
    last = feather_m
    for i in range(len(places)):
        limit = feather_m
        if i and last < feather_m:
            step = 0.0
            for k in range(3):
                step += (places[i, k] - places[i - 1, k]) ** 2
            limit = min(limit, last + np.sqrt(step) * 1.001 + 0.01)
        last = nearest(lines, balls, below, places[i], limit, stack)
        if last < feather_m:
            near[i] = last
            delta[i] = mean(lines, balls, below, places[i], max(last, 1e-3), stack, share)


@summing
def nearest(
    lines: Lines,
    balls: Floats,
    below: Rows,
    place: Floats,
    limit: float,
    stack: NDArray[np.int64],
) -> float:
    """Distance to the nearest line, `limit` when none is as near as that."""
    best, reach = limit * limit, limit
    first = below[0, 1] - below[0, 0]
    smallest = (len(lines) + first - 1) // first
    stack[0], count = len(balls) - 1, 1
    while count:
        count -= 1
        ball = stack[count]
        x, y, z = _from_ball(balls, ball, place)
        wide = reach + balls[ball, 3]
        if x * x + y * y + z * z > wide * wide:
            continue
        if ball >= smallest:
            for child in range(below[ball, 0], below[ball, 1]):
                stack[count] = child
                count += 1
            continue
        for j in range(below[ball, 0], below[ball, 1]):
            best = min(best, _to_line(lines, j, x, y, z))
        reach = np.sqrt(best)
    return reach


@summing
def mean(
    lines: Lines,
    balls: Floats,
    below: Rows,
    place: Floats,
    near: float,
    stack: NDArray[np.int64],
    share: Floats,
) -> float:
    """Mean of the lines' deltas, by the inverse cube of the distance, along each line."""
    total, weights = 0.0, 0.0
    reach = REACH * near
    per_reach = 1.0 / (reach * reach)
    first = below[0, 1] - below[0, 0]
    smallest = (len(lines) + first - 1) // first
    stack[0], share[0], count = len(balls) - 1, 1.0, 1
    while count:
        count -= 1
        ball, part = stack[count], share[count]
        x, y, z = _from_ball(balls, ball, place)
        squared = x * x + y * y + z * z
        wide = reach + balls[ball, 3]
        if squared > wide * wide:
            continue
        far = np.sqrt(squared)
        as_one = _as_one(far, balls[ball, 3])
        if as_one > 0.0:
            inside = max(1.0 - squared * per_reach, 0.0)
            weight = part * as_one * inside * inside * balls[ball, 4] / (squared * far)
            total += weight * balls[ball, 5]
            weights += weight
            part *= 1.0 - as_one
        if part <= 0.0:
            continue
        if ball >= smallest:
            for child in range(below[ball, 0], below[ball, 1]):
                stack[count], share[count] = child, part
                count += 1
            continue
        for j in range(below[ball, 0], below[ball, 1]):
            to_a, to_b = _along(lines, j, x, y, z, per_reach)
            total += part * (to_a * lines[j, 6] + to_b * lines[j, 7])
            weights += part * (to_a + to_b)
    return total / weights


@inlined
def _from_ball(balls: Floats, ball: int, place: Floats) -> tuple[float, float, float]:
    return place[0] - balls[ball, 0], place[1] - balls[ball, 1], place[2] - balls[ball, 2]


@inlined
def _as_one(far: float, radius: float) -> float:
    """Say how much a ball's lines count as one: 0 near it, 1 far away."""
    t = (far - GROUP_FROM * radius) / ((GROUP_TO - GROUP_FROM) * radius)
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@inlined
def _to_line(lines: Lines, j: int, x: float, y: float, z: float) -> float:
    """Squared distance of a place, relative to the lines' ball, to a line."""
    ax, ay, az = lines[j, 0] - x, lines[j, 1] - y, lines[j, 2] - z
    ux, uy, uz = lines[j, 3] - x - ax, lines[j, 4] - y - ay, lines[j, 5] - z - az
    t = -(ax * ux + ay * uy + az * uz) / (ux * ux + uy * uy + uz * uz + 1e-12)
    t = min(max(t, 0.0), 1.0)
    dx, dy, dz = ax + t * ux, ay + t * uy, az + t * uz
    return float(dx * dx + dy * dy + dz * dz)


@inlined
def _along(
    lines: Lines, j: int, x: float, y: float, z: float, per_reach: float
) -> tuple[float, float]:
    """Weights of a line's two ends: integrals along it, faded towards the reach."""
    ax, ay, az = lines[j, 0] - x, lines[j, 1] - y, lines[j, 2] - z
    bx, by, bz = lines[j, 3] - x, lines[j, 4] - y, lines[j, 5] - z
    ux, uy, uz = bx - ax, by - ay, bz - az
    squared = ux * ux + uy * uy + uz * uz + 1e-12
    along = ax * ux + ay * uy + az * uz
    t = min(max(-along / squared, 0.0), 1.0)
    dx, dy, dz = ax + t * ux, ay + t * uy, az + t * uz
    inside = 1.0 - (dx * dx + dy * dy + dz * dz) * per_reach
    if inside <= 0.0:
        return 0.0, 0.0
    r0 = np.sqrt(ax * ax + ay * ay + az * az) + 1e-6
    r1 = np.sqrt(bx * bx + by * by + bz * bz) + 1e-6
    both = r0 * r1
    turn = max(both + ax * bx + ay * by + az * bz, 1e-12 * both)
    length = np.sqrt(squared)
    whole = length * (r0 + r1) / (both * turn)
    # The second integral, of the place along the line, is 1 / r0 - 1 / r1.
    to_b = ((r1 - r0) / both * length - along * whole) / squared
    to_b = min(max(to_b, 0.0), whole)
    fade = inside * inside
    return (whole - to_b) * fade, to_b * fade
