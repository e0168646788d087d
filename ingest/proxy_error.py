# SPDX-License-Identifier: Apache-2.0
"""How far boxes are from the buildings that they stand for, as compiled loops.

Both are sets that stand on the ground, and the ground belongs to both. A point of a
building is farthest from its box, a convex body, at a corner of the roof: that is exact.
A point of a box is farthest from its buildings somewhere on the box's roof, because
distances to what stands on the ground never shrink upwards; where, is found by cutting
the roof into ever smaller rectangles. The distance of a rectangle's middle and half of
its diagonal bound it, so the result is never too small, and less than a twentieth and
`_SLACK_M` too large.
"""

import math
from typing import NamedTuple

import numpy as np

from ingest.box_fit import (
    ANGLE,
    FOOT,
    GROUND,
    HIGH_U,
    HIGH_V,
    LEAN_U,
    LEAN_V,
    LOW_U,
    LOW_V,
    TOP,
    roof_m,
)
from ingest.proxy_solids import Frame, Solids, placed, turned
from tiles.frames import Floats, Ints
from tiles.kernels import inlined, kernel

_SLACK, _SLACK_M = 1.05, 0.2
_DEEPEST = 256


@kernel
def box_errors_m(
    solids: Solids, item: Ints, begin: Ints, groups: Ints, frames: Floats, box: Floats
) -> Floats:
    """Return the error of each group of boxes, (g,) m.

    Parameters
    ----------
    item, begin : box b stands for the buildings item[begin[b] : begin[b + 1]]
    groups : (g + 1,) where each group's boxes begin
    frames : (g, 4) rows of `Frame`
    box : (b, 10)
    """
    error = np.zeros(len(groups) - 1)
    for g in range(len(error)):
        frame = Frame(frames[g, 0], frames[g, 1], frames[g, 2], frames[g, 3])
        most = 0.0
        for b in range(groups[g], groups[g + 1]):
            here = item[begin[b] : begin[b + 1]]
            most = max(most, _real_to_box(solids, frame, here, box[b]))
        for b in range(groups[g], groups[g + 1]):
            here = item[begin[b] : begin[b + 1]]
            most = _box_to_real(solids, frame, here, box[b], most)
        error[g] = most
    return error


@kernel
def _real_to_box(solids: Solids, frame: Frame, item: Ints, box: Floats) -> float:
    """Return how far buildings are off their box, each by its largest side at most."""
    most = 0.0
    for i in item:
        height = max(solids.top_m[i] - solids.ground_m[i], 0.0)
        middle_u, middle_v = _centre(solids, frame, i, box[ANGLE])
        a, b = turned(solids.lean[i, 0], solids.lean[i, 1], box[ANGLE])
        far = 0.0
        low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
        for e in range(solids.start[i], solids.start[i + 1]):
            x, y = placed(frame, solids.edge_deg[e, 0], solids.edge_deg[e, 1])
            u, v = turned(x, y, box[ANGLE])
            low_u, high_u = min(low_u, u), max(high_u, u)
            low_v, high_v = min(low_v, v), max(high_v, v)
            top = solids.top_m[i] + a * (u - middle_u) + b * (v - middle_v)
            at_u = min(max(u, box[LOW_U]), box[HIGH_U])
            at_v = min(max(v, box[LOW_V]), box[HIGH_V])
            above = max(top - roof_m(box, at_u, at_v), 0.0)
            far = max(far, (u - at_u) ** 2 + (v - at_v) ** 2 + above * above)
        size = max(height, high_u - low_u, high_v - low_v)
        most = max(most, min(math.sqrt(far), size))
    return most


@inlined
def _centre(solids: Solids, frame: Frame, i: int, angle: float) -> tuple[float, float]:
    x, y = placed(frame, solids.centre_deg[i, 0], solids.centre_deg[i, 1])
    return turned(x, y, angle)


class _Near(NamedTuple):
    """The buildings of a box, along its axes."""

    edge: Floats
    """(e, 4) both ends, m"""
    start: Ints
    """(n + 1,) where each building's edges begin"""
    around: Floats
    """(n, 4) ends of each along both axes, m"""
    roof: Floats
    """(n, 3) plane of the lowest roof: rise along both axes, height in the origin"""


@kernel
def _box_to_real(
    solids: Solids, frame: Frame, item: Ints, box: Floats, most: float
) -> float:
    """Return the larger of `most` and the distance of a box to its buildings or ground."""
    height = max(box[TOP] - box[GROUND], 0.0)
    if height <= most:
        return most
    near = _near(solids, frame, item, box[ANGLE])
    lifted = _lifted(solids, near, item, box)
    stretch = math.sqrt(1.0 + box[LEAN_U] ** 2 + box[LEAN_V] ** 2) / 2
    stack = np.empty((_DEEPEST, 4))
    stack[0] = box[LOW_U], box[HIGH_U], box[LOW_V], box[HIGH_V]
    used, bound = 1, max(most - lifted, 0.0)
    found = bound
    while used:
        used -= 1
        u0, u1, v0, v1 = stack[used]
        u, v = (u0 + u1) / 2, (v0 + v1) / 2
        distance = min(_distance(near, u, v, roof_m(box, u, v)), height)
        found = max(found, distance)
        reach = min(distance + math.hypot(u1 - u0, v1 - v0) * stretch, height)
        if reach <= max(found * _SLACK + _SLACK_M, bound) or used + 2 > _DEEPEST:
            bound = max(bound, reach)
            continue
        if u1 - u0 > v1 - v0:
            stack[used], stack[used + 1] = (u0, u, v0, v1), (u, u1, v0, v1)
        else:
            stack[used], stack[used + 1] = (u0, u1, v0, v), (u0, u1, v, v1)
        used += 2
    return float(max(most, min(bound + lifted, height)))


@kernel
def _lifted(solids: Solids, near: _Near, item: Ints, box: Floats) -> float:
    """Return how far into the open below raised buildings a box reaches, m."""
    most = 0.0
    for n in range(len(item)):
        i = item[n]
        half = (solids.foot_m[i] - solids.ground_m[i]) / 2
        if half <= most:
            continue
        u0, u1, v0, v1 = near.around[n]
        u, v = (u0 + u1) / 2, (v0 + v1) / 2
        a, b, roof = near.roof[n]
        foot = roof + a * u + b * v + solids.foot_m[i] - solids.low_top_m[i]
        below = roof_m(box, u, v) + box[FOOT] - box[TOP]
        twist = abs(a - box[LEAN_U]) * (u1 - u0) + abs(b - box[LEAN_V]) * (v1 - v0)
        most = max(most, min(foot - below + twist / 2, half))
    return most


@kernel
def _near(solids: Solids, frame: Frame, item: Ints, angle: float) -> _Near:
    """Turn buildings into a box's axes."""
    start = np.zeros(len(item) + 1, np.int64)
    for n in range(len(item)):
        start[n + 1] = start[n] + solids.start[item[n] + 1] - solids.start[item[n]]
    edge, around = np.empty((start[-1], 4)), np.empty((len(item), 4))
    roof = np.empty((len(item), 3))
    for n in range(len(item)):
        i = item[n]
        for k in range(start[n + 1] - start[n]):
            one, to = solids.edge_deg[solids.start[i] + k], edge[start[n] + k]
            x, y = placed(frame, one[0], one[1])
            to[0], to[1] = turned(x, y, angle)
            x, y = placed(frame, one[2], one[3])
            to[2], to[3] = turned(x, y, angle)
        here = edge[start[n] : start[n + 1]]
        around[n] = here[:, 0].min(), here[:, 0].max(), here[:, 1].min(), here[:, 1].max()
        u, v = _centre(solids, frame, i, angle)
        a, b = turned(solids.lean[i, 0], solids.lean[i, 1], angle)
        roof[n] = a, b, solids.low_top_m[i] - a * u - b * v
    return _Near(edge, start, around, roof)


@kernel
def _distance(near: _Near, u: float, v: float, top: float) -> float:
    """Return a distance from a point of a box's roof to the nearest building."""
    nearest = np.inf
    for n in range(len(near.roof)):
        a = max(near.around[n, 0] - u, 0.0, u - near.around[n, 1])
        b = max(near.around[n, 2] - v, 0.0, v - near.around[n, 3])
        if a * a + b * b < nearest:
            edge = near.edge[near.start[n] : near.start[n + 1]]
            flat, x, y = to_polygon(edge, u, v)
            a, b, level = near.roof[n]
            above = max(top - level - a * (u + x) - b * (v + y), 0.0)
            nearest = min(nearest, flat + above * above)
    return math.sqrt(nearest)


@kernel
def to_polygon(edge: Floats, u: float, v: float) -> tuple[float, float, float]:
    """Return the squared distance of a point to a polygon, and the way there."""
    nearest, inside = np.inf, False
    way_x = way_y = 0.0
    for e in range(len(edge)):
        a, b, c, d = edge[e, 0] - u, edge[e, 1] - v, edge[e, 2] - u, edge[e, 3] - v
        if (b > 0) != (d > 0) and (a * d - b * c > 0) == (d > b):
            inside = not inside
        p, q = c - a, d - b
        length = p * p + q * q
        t = 0.0
        if length > 0:
            t = min(max(-(a * p + b * q) / length, 0.0), 1.0)
        x, y = a + t * p, b + t * q
        if x * x + y * y < nearest:
            nearest, way_x, way_y = x * x + y * y, x, y
    if inside:
        return 0.0, 0.0, 0.0
    return nearest, way_x, way_y
