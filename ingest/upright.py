# SPDX-License-Identifier: Apache-2.0
"""Differences along the vertical, in one number instead of three.

A point's height here is how much further from the earth's centre it is than the mesh's
origin. Between two points of a straight line the planet's curvature makes it less than
what their heights say: by the `sag` of the two times both shares.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.posts import column_row
from tiles.frames import Floats
from tiles.kernels import inlined, kernel
from tiles.mesh import UV_ONE

Ints = NDArray[np.int64]
NEAR = 0.01
"""Posts from an edge's ends within which nothing is off: they are true"""


class Ground(NamedTuple):
    """The posts that a mesh stands for, by their heights."""

    high_m: Floats
    """(h, w)"""
    sags: Floats
    """(3,) m, of two posts side by side in a row, in a column, and of a diagonal"""
    grid: Floats
    """(2, 6) as in `posts`"""


@inlined
def high_of(points: Floats, q: int, middle: Floats) -> float:
    """Return a point's height, m; `middle` is the origin's place on the earth."""
    far, there, more = 0.0, 0.0, 0.0
    for k in range(3):
        far += middle[k] ** 2
        there += (middle[k] + points[q, k]) ** 2
        more += points[q, k] * (2.0 * middle[k] + points[q, k])
    # Not the difference of two large numbers.
    return float(more / max(np.sqrt(there) + np.sqrt(far), 1e-12))


@kernel
def highs(points: Floats, middle: Floats) -> Floats:
    """Return the heights of points, (n,) m."""
    found = np.empty(len(points))
    for q in range(len(points)):
        found[q] = high_of(points, q, middle)
    return found


@inlined
def sag(points: Floats, high_m: Floats, twice_m: float, p: int, q: int) -> float:
    """Return the sag of two points, m; `twice_m` is the earth's diameter."""
    x, y = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1]
    z, up = points[q, 2] - points[p, 2], high_m[q] - high_m[p]
    return float((x * x + y * y + z * z - up * up) / twice_m)


def ground_of(
    posts: NDArray[np.float32], offset: Floats, grid: Floats, middle: Floats
) -> Ground:
    """Return what posts are, seen from a mesh's origin.

    Parameters
    ----------
    posts : (h, w, 3) m
    offset : (3,) m from the mesh's origin to the posts'
    """
    h, w = posts.shape[:2]
    points = posts.reshape(-1, 3) + offset
    high_m = highs(points, middle)
    first, twice_m = (h - 1) // 2 * w + (w - 1) // 2, 2 * float(np.linalg.norm(middle))
    others = first + 1, first + w, first + w + 1
    sags = np.array([sag(points, high_m, twice_m, first, one) for one in others])
    return Ground(high_m.reshape(h, w), sags, grid)


@inlined
def high_at(high_m: Floats, sags: Floats, x: float, y: float) -> float:
    """Return the height of the posts' triangles at a column and row."""
    c = min(max(int(np.floor(x)), 0), high_m.shape[1] - 2)
    r = min(max(int(np.floor(y)), 0), high_m.shape[0] - 2)
    fx, fy = x - c, y - r
    beside, far = abs(fx - fy), min(fx, fy)
    near = 1.0 - beside - far
    side, one, other = high_m[r + 1, c], sags[1], sags[0]
    if fx > fy:
        side, one, other = high_m[r, c + 1], sags[0], sags[1]
    high = near * high_m[r, c] + beside * side + far * high_m[r + 1, c + 1]
    return float(high - beside * (near * one + far * other) - near * far * sags[2])


@inlined
def edge_gap(
    at: Ints,
    high_m: Floats,
    truth: Floats,
    sags: Floats,
    grid: Floats,
    edge: tuple[int, int, float],
    limit_m: float,
) -> tuple[float, float]:
    """Return the largest difference in height where an edge crosses lines between posts.

    Parameters
    ----------
    at, high_m : of vertices
    truth, sags, grid : of `Ground`
    edge : the vertices at its ends, and their sag
    limit_m : a difference above it is returned at once

    Returns
    -------
    The difference, m, and at which part of the edge it is.
    """
    p, q, sag_m = edge
    most, where, straight = 0.0, 0.0, _is_linear(grid)
    u, v = at[p, 0] / UV_ONE, at[p, 1] / UV_ONE
    du, dv = at[q, 0] / UV_ONE - u, at[q, 1] / UV_ONE - v
    x0, y0 = column_row(grid, u, v)
    x1, y1 = column_row(grid, u + du, v + dv)
    up = high_m[q] - high_m[p]
    for family in range(3):
        start, end = of_family(family, x0, y0), of_family(family, x1, y1)
        if abs(end - start) < 1e-9:
            continue
        part = 1.0 / (end - start)
        first = int(np.ceil(min(start, end) + NEAR))
        last = int(np.floor(max(start, end) - NEAR))
        for n in range(first, last + 1):
            f = (n - start) * part
            x, y = x0 + f * (x1 - x0), y0 + f * (y1 - y0)
            if not straight:
                x, y = column_row(grid, u + f * du, v + f * dv)
            there = high_m[p] + f * (up - (1.0 - f) * sag_m)
            gap = abs(there - high_at(truth, sags, x, y))
            if gap > most:
                most, where = gap, f
                if most > limit_m:
                    break
    return most, where


@inlined
def _is_linear(grid: Floats) -> bool:
    bent = 0.0
    for k in range(3, 6):
        bent += abs(grid[0, k]) + abs(grid[1, k])
    return bent == 0.0


@inlined
def of_family(family: int, x: float, y: float) -> float:
    """Return a place's number among columns, rows or diagonals."""
    return x if family == 0 else y if family == 1 else x - y
