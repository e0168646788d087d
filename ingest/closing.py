# SPDX-License-Identifier: Apache-2.0
"""Greedy insertion that keeps its bound between posts too.

Two piecewise linear surfaces differ most at a vertex of one of them or where their edges
cross. Insertion sees the posts; here every new edge is followed across the lines between
posts, and where it is too far off, the true place is given to insertion as another point.
It becomes a vertex if it is still too far when its turn comes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.delaunay import Net
from ingest.greedy import ALWAYS, Lists, over, refine
from ingest.posts import column_row, point_at
from tiles.frames import Floats
from tiles.kernels import inlined, kernel
from tiles.mesh import UV_ONE

ROUNDS = 64
"""Most times that new edges are followed"""
BESIDE = UV_ONE // 64
"""Steps within which a place is beside the cell's edge"""


class Under(NamedTuple):
    """The posts that a mesh of their cell stands for."""

    posts: NDArray[np.float32]
    """(h, w, 3) m"""
    grid: Floats
    """(2, 6)"""
    offset: Floats
    """(3,) m from the mesh's centre to the posts' origin"""
    to_map: Floats
    """(2, 2) from fractions of the cell to the map where triangles are compact"""
    straight: bool
    """`grid` is linear"""


@kernel
def close(
    net: Net, lists: Lists, under: Under, count: int, size: int, bound: float
) -> tuple[int, int, bool]:
    """Insert until no point and no crossing is above the squared bound.

    Parameters
    ----------
    count, size : of triangles and of points

    Returns
    -------
    The same afterwards, and whether the bound is kept.
    """
    lists.unseen[:count] = True  # what was good enough for a larger bound
    for _ in range(ROUNDS):
        count = refine(net, lists, count, bound)
        before = size
        for t in range(count):
            if lists.unseen[t]:
                gap, u, v = _worst_crossing(net, under, t)
                lists.unseen[t] = gap > bound
                if gap > bound:
                    size = _give(net, lists, under, t, (u, v), gap, size)
        if size == before:
            break
    return count, size, not lists.unseen[:count].any()


@kernel
def _worst_crossing(net: Net, under: Under, t: int) -> tuple[float, float, float]:
    """Return the largest squared distance along a triangle's edges, and where it is."""
    at, corner, opposite, points = net.at, net.corner, net.opposite, net.points
    posts, grid, offset, middle = under.posts, under.grid, under.offset, net.middle
    most, most_u, most_v = 0.0, 0.0, 0.0
    for k in range(3):
        p, q = corner[t, k], corner[t, (k + 1) % 3]
        if p > q and opposite[3 * t + k] >= 0:
            continue  # looked at from the other side
        on_rim = _is_rim(at, p) and _is_rim(at, q)
        u0, v0 = at[p, 0] / UV_ONE, at[p, 1] / UV_ONE
        du, dv = at[q, 0] / UV_ONE - u0, at[q, 1] / UV_ONE - v0
        x0, y0 = column_row(grid, u0, v0)
        x1, y1 = column_row(grid, u0 + du, v0 + dv)
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        dx, dy, dz = points[q, 0] - px, points[q, 1] - py, points[q, 2] - pz
        px, py, pz = px - offset[0], py - offset[1], pz - offset[2]
        for family in range(3):
            start, end = _of_family(family, x0, y0), _of_family(family, x1, y1)
            if abs(end - start) < 1e-9:
                continue
            part = 1.0 / (end - start)
            first, last = int(np.ceil(min(start, end))), int(np.floor(max(start, end)))
            for n in range(first, last + 1):
                f = (n - start) * part
                x, y = x0 + f * (x1 - x0), y0 + f * (y1 - y0)
                if not under.straight:
                    x, y = column_row(grid, u0 + f * du, v0 + f * dv)
                tx, ty, tz = point_at(posts, x, y)
                ax, ay, az = px + f * dx - tx, py + f * dy - ty, pz + f * dz - tz
                gap = ax * ax + ay * ay + az * az
                if gap > most and not on_rim:
                    tx += middle[0] + offset[0]
                    ty += middle[1] + offset[1]
                    tz += middle[2] + offset[2]
                    up = ax * tx + ay * ty + az * tz
                    gap = min(gap, up * up / (tx * tx + ty * ty + tz * tz))
                if gap > most:
                    most, most_u, most_v = gap, u0 + f * du, v0 + f * dv
    return most, most_u, most_v


@inlined
def _of_family(family: int, x: float, y: float) -> float:
    """Return a place's number among columns, rows or diagonals."""
    return x if family == 0 else y if family == 1 else x - y


@inlined
def _is_rim(at: NDArray[np.int64], p: int) -> bool:
    return bool(at[p, 0] % UV_ONE == 0 or at[p, 1] % UV_ONE == 0)


@kernel
def _give(
    net: Net,
    lists: Lists,
    under: Under,
    t: int,
    place: tuple[float, float],
    gap: float,
    size: int,
) -> int:
    """Add the point at a place near triangle t; beside the rim the one on it too."""
    col, row = _step(place[0]), _step(place[1])
    size = _add(net, lists, under, t, (col, row), gap, size)
    to_col, to_row = _beside(col), _beside(row)
    if to_col != col or to_row != row:
        # Else ever thinner triangles would creep up to the rim.
        size = _add(net, lists, under, t, (to_col, to_row), ALWAYS, size)
    return size


@inlined
def _step(part: float) -> int:
    """Round a fraction to a step; only what lies on an edge may be rounded to it."""
    step = int(np.rint(part * UV_ONE))
    if 1e-9 < part < 1.0 - 1e-9:
        step = min(max(step, 1), UV_ONE - 1)
    return step


@inlined
def _beside(step: int) -> int:
    """Return the edge beside a step, or the step."""
    if step < BESIDE:
        return 0
    return UV_ONE if step > UV_ONE - BESIDE else step


@kernel
def _add(
    net: Net,
    lists: Lists,
    under: Under,
    t: int,
    place: tuple[int, int],
    gap: float,
    size: int,
) -> int:
    """Add a point unless there is a vertex or no room; returns how many there are."""
    at, q = net.at, size
    if q >= len(at):
        return size
    at[q, 0], at[q, 1] = place
    t = over(net, t, q)
    for k in range(3):
        p = net.corner[t, k]
        if at[p, 0] == at[q, 0] and at[p, 1] == at[q, 1]:
            return size
    u, v = at[q, 0] / UV_ONE, at[q, 1] / UV_ONE
    x, y = column_row(under.grid, u, v)
    true = point_at(under.posts, x, y)
    for k in range(3):
        net.points[q, k] = true[k] + under.offset[k]
    for k in range(2):
        net.flat[q, k] = under.to_map[k, 0] * u + under.to_map[k, 1] * v
    net.must[q] = gap == ALWAYS
    lists.after[q] = lists.head[t]
    lists.head[t] = q
    if gap > lists.worst[t]:
        lists.candidate[t], lists.worst[t] = q, gap
    return q + 1
