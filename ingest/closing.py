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

from ingest.delaunay import Ints, Net
from ingest.greedy import ALWAYS, Lists, over, refine
from ingest.posts import column_row, point_at
from ingest.upright import Ground, edge_gap, high_of, of_family, sag
from tiles.frames import Floats
from tiles.kernels import borrowing, inlined, kernel
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


@kernel
def close(
    net: Net,
    lists: Lists,
    under: Under,
    ground: Ground,
    count: int,
    size: int,
    bound: float,
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
        ids, places, gaps = _too_far(net, lists.unseen, under, ground, count, bound)
        for i in range(len(ids)):
            place = places[i, 0], places[i, 1]
            size = _give(net, lists, under, ids[i], place, gaps[i], size)
        if size == before:
            break
    return count, size, not lists.unseen[:count].any()


@kernel
def _too_far(
    net: Net,
    unseen: NDArray[np.bool_],
    under: Under,
    ground: Ground,
    count: int,
    bound: float,
) -> tuple[Ints, Floats, Floats]:
    """Look along the edges of triangles that nobody has looked at.

    Returns
    -------
    ids : (n,) those that are above the squared bound; they stay unseen
    places : (n, 2) fractions of the cell: where each is furthest off
    gaps : (n,) squared distance there
    """
    at, corner, opposite, points = net.at, net.corner, net.opposite, net.points
    high_m, middle = net.high_m, net.middle
    truth, sags, grid = ground.high_m, ground.sags, ground.grid
    posts, offset = under.posts, under.offset
    twice_m = 2.0 * np.sqrt(middle[0] ** 2 + middle[1] ** 2 + middle[2] ** 2)
    ids, places, gaps = np.empty(count, np.int64), np.empty((count, 2)), np.empty(count)
    found = 0
    for t in range(count):
        if not unseen[t]:
            continue
        most = bound
        for k in range(3):
            p, q = corner[t, k], corner[t, (k + 1) % 3]
            gap, f = 0.0, 0.0
            if opposite[3 * t + k] < 0:
                gap, f = _on_rim(at, points, posts, offset, grid, p, q)
            elif p < q:  # else looked at from the other side
                edge = p, q, sag(points, high_m, twice_m, p, q)
                far_m, f = edge_gap(at, high_m, truth, sags, grid, edge, np.inf)
                gap = far_m * far_m
            if gap > most:
                most = gaps[found] = gap
                for j in range(2):
                    places[found, j] = (at[p, j] + f * (at[q, j] - at[p, j])) / UV_ONE
        unseen[t] = most > bound
        ids[found] = t
        found += int(most > bound)
    return ids[:found], places[:found], gaps[:found]


@borrowing
def _on_rim(
    at: Ints,
    points: Floats,
    posts: NDArray[np.float32],
    offset: Floats,
    grid: Floats,
    p: int,
    q: int,
) -> tuple[float, float]:
    """Return the largest squared distance along an edge on the rim, and where it is."""
    most, where = 0.0, 0.0
    u, v = at[p, 0] / UV_ONE, at[p, 1] / UV_ONE
    du, dv = at[q, 0] / UV_ONE - u, at[q, 1] / UV_ONE - v
    x0, y0 = column_row(grid, u, v)
    x1, y1 = column_row(grid, u + du, v + dv)
    for family in range(3):
        start, end = of_family(family, x0, y0), of_family(family, x1, y1)
        if abs(end - start) < 1e-9:
            continue
        first, last = int(np.ceil(min(start, end))), int(np.floor(max(start, end)))
        for n in range(first, last + 1):
            f = (n - start) / (end - start)
            x, y = column_row(grid, u + f * du, v + f * dv)
            true, gap = point_at(posts, x, y), 0.0
            for k in range(3):
                there = points[p, k] + f * (points[q, k] - points[p, k])
                gap += (there - offset[k] - true[k]) ** 2
            if gap > most:
                most, where = gap, f
    return most, where


@borrowing
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


@borrowing
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
    net.high_m[q] = high_of(net.points, q, net.middle)
    for k in range(2):
        net.flat[q, k] = under.to_map[k, 0] * u + under.to_map[k, 1] * v
    net.must[q] = gap == ALWAYS
    lists.after[q] = lists.head[t]
    lists.head[t] = q
    if gap > lists.worst[t]:
        lists.candidate[t], lists.worst[t] = q, gap
    return q + 1
