# SPDX-License-Identifier: Apache-2.0
"""One box around some buildings, as compiled loops.

Its rectangle lies along their walls, and its foot and roof lean as their ground does.
"""

import math

import numpy as np

from ingest.proxy_solids import Frame, Solids, placed, turned
from tiles.frames import Floats, Ints
from tiles.kernels import inlined, kernel

ANGLE, LOW_U, HIGH_U, LOW_V, HIGH_V, LEAN_U, LEAN_V, FOOT, GROUND, TOP = range(10)
"""Columns of a box: direction of the first axis (rad), ends along both axes (m in the
group's frame), rise along both (m/m), heights in the rectangle's middle (m)."""
COLUMNS = 10
_STEEPEST = 0.7
_STEADY_M2 = 9.0
"""Buildings as near as this, squared, say little about how the ground leans."""


@kernel
def fit(solids: Solids, frame: Frame, item: Ints, ends: Floats, box: Floats) -> float:
    """Put a box around n buildings; return how wrong it is, 0 around a single one.

    Wrong is the volume of air in it and of what it misses, times the largest miss.

    Parameters
    ----------
    ends : (n, 4) is filled with the least and largest of each along the axes, m
    """
    x = y = 0.0
    for i in item:
        x += solids.moment[i, 0]
        y += solids.moment[i, 1]
    box[ANGLE] = math.atan2(y, x) / 4
    _span(solids, frame, item, box[ANGLE], ends)
    box[LOW_U], box[HIGH_U] = np.min(ends[:, 0]), np.max(ends[:, 1])
    box[LOW_V], box[HIGH_V] = np.min(ends[:, 2]), np.max(ends[:, 3])
    _lean(solids, item, ends, box)
    _stand(solids, item, ends, box)
    if len(item) == 1:
        return 0.0
    wrong = area = height = most = 0.0
    for k in range(len(item)):
        i = item[k]
        u, v = (ends[k, 0] + ends[k, 1]) / 2, (ends[k, 2] + ends[k, 3]) / 2
        miss = abs(solids.top_m[i] - roof_m(box, u, v))
        most = max(most, miss)
        wrong += solids.area_m2[i] * miss
        area += solids.area_m2[i]
        height += solids.area_m2[i] * (solids.top_m[i] - solids.ground_m[i])
    air = (box[HIGH_U] - box[LOW_U]) * (box[HIGH_V] - box[LOW_V]) - area
    return float(max((wrong + max(air, 0.0) * height / area) * most, 1e-9))


@kernel
def _span(solids: Solids, frame: Frame, item: Ints, angle: float, ends: Floats) -> None:
    cos, sin = math.cos(angle), math.sin(angle)
    for k in range(len(item)):
        low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
        for e in range(solids.start[item[k]], solids.start[item[k] + 1]):
            x, y = placed(frame, solids.edge_deg[e, 0], solids.edge_deg[e, 1])
            u, v = x * cos + y * sin, y * cos - x * sin
            low_u, high_u = min(low_u, u), max(high_u, u)
            low_v, high_v = min(low_v, v), max(high_v, v)
        ends[k] = low_u, high_u, low_v, high_v


@kernel
def _lean(solids: Solids, item: Ints, ends: Floats, box: Floats) -> None:
    """Fit a plane to the ground of buildings; a single one keeps its own lean."""
    n = len(item)
    if n == 1:
        own = solids.lean[item[0]]
        box[LEAN_U], box[LEAN_V] = turned(own[0], own[1], box[ANGLE])
        return
    su = sv = sz = 0.0
    for k in range(n):
        su, sv = su + ends[k, 0] + ends[k, 1], sv + ends[k, 2] + ends[k, 3]
        sz += solids.ground_m[item[k]]
    su, sv, sz = su / n / 2, sv / n / 2, sz / n
    uu, vv, uv, uz, vz = _STEADY_M2 * n, _STEADY_M2 * n, 0.0, 0.0, 0.0
    for k in range(n):
        u, v = (ends[k, 0] + ends[k, 1]) / 2 - su, (ends[k, 2] + ends[k, 3]) / 2 - sv
        z = solids.ground_m[item[k]] - sz
        uu, vv, uv, uz, vz = uu + u * u, vv + v * v, uv + u * v, uz + u * z, vz + v * z
    det = uu * vv - uv * uv
    lean_u, lean_v = (uz * vv - vz * uv) / det, (vz * uu - uz * uv) / det
    less = min(1.0, _STEEPEST / max(math.hypot(lean_u, lean_v), 1e-9))
    box[LEAN_U], box[LEAN_V] = lean_u * less, lean_v * less


@kernel
def _stand(solids: Solids, item: Ints, ends: Floats, box: Floats) -> None:
    """Fill in the heights: below every foot and ground, the mean of the roofs."""
    middle_u, middle_v = (box[LOW_U] + box[HIGH_U]) / 2, (box[LOW_V] + box[HIGH_V]) / 2
    cos, sin = math.cos(box[ANGLE]), math.sin(box[ANGLE])
    area = top = 0.0
    foot = ground = np.inf
    for k in range(len(item)):
        i = item[k]
        east, north = solids.lean[i, 0], solids.lean[i, 1]
        a = east * cos + north * sin - box[LEAN_U]
        b = north * cos - east * sin - box[LEAN_V]
        # How far the building's plane is below the box's at the worst of its corners.
        fall = abs(a) * (ends[k, 1] - ends[k, 0]) + abs(b) * (ends[k, 3] - ends[k, 2])
        u, v = (ends[k, 0] + ends[k, 1]) / 2, (ends[k, 2] + ends[k, 3]) / 2
        rise = box[LEAN_U] * (u - middle_u) + box[LEAN_V] * (v - middle_v)
        foot = min(foot, solids.foot_m[i] - rise - fall / 2)
        ground = min(ground, solids.ground_m[i] - rise - fall / 2)
        area += solids.area_m2[i]
        top += solids.area_m2[i] * ((solids.top_m[i] + solids.low_top_m[i]) / 2 - rise)
    box[FOOT], box[GROUND], box[TOP] = foot, ground, top / area


@inlined
def roof_m(box: Floats, u: float, v: float) -> float:
    """Return the height of a box's roof, or of its plane around it."""
    u, v = u - (box[LOW_U] + box[HIGH_U]) / 2, v - (box[LOW_V] + box[HIGH_V]) / 2
    return float(box[TOP] + box[LEAN_U] * u + box[LEAN_V] * v)
