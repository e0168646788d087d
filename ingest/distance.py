# SPDX-License-Identifier: Apache-2.0
"""Distances between a drawn point, a true one, and the triangles that they belong to."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import inlined, kernel

Ints = NDArray[np.int64]
Point = tuple[float, float, float]
ASKED = 24
"""Triangles whose neighbours are looked at for the one under a point"""


class Mesh(NamedTuple):
    """A surface in the frame of a leaf."""

    points: Floats
    """(v, 3) m around the truth's centre"""
    at: Floats
    """(v, 2) fractions of the leaf's cell"""
    xy: Floats
    """(v, 2) columns and rows of the truth; only good inside the leaf"""
    triangles: Ints
    rim: NDArray[np.bool_]
    """(v,) on the edge of the surface's cell"""
    across: Ints
    """(t, 3) the triangle across from each edge, -1 for none or where it does not matter"""
    middle: Point
    """m from the earth's centre to the truth's, to measure along the vertical, or 0"""


class Posts(NamedTuple):
    """A truth, as the kernels take it."""

    points: NDArray[np.float32]
    uv: Floats
    grid: Floats
    bend: float
    """How far a straight line of the cell may be bent in columns and rows"""


class Found(NamedTuple):
    """The largest distances so far."""

    squared: Floats
    uv: Floats


@inlined
def squared_gap(a: Point, b: Point) -> float:
    """Return the squared distance of two points."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@inlined
def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def upright_gap(middle: Point, flat: Point, true: Point) -> float:
    """Squared difference in height of two points, -1 where that is not asked for."""
    if middle[0] == 0.0 and middle[1] == 0.0 and middle[2] == 0.0:
        return -1.0
    up = middle[0] + true[0], middle[1] + true[1], middle[2] + true[2]
    return float(_dot(_minus(flat, true), up) ** 2 / _dot(up, up))


@kernel
def to_mesh(points: Floats, triangles: Ints, across: Ints, t: int, point: Point) -> float:
    """Squared shortest distance of a point from triangle t, or from one near it.

    In a cell at a pole, what is straight in longitude and latitude is bent on the ground,
    and triangles may have no area: the point may lie over another triangle. On a cliff it
    may be nearer to another. Those nearest so far are asked for their neighbours.
    """
    best = _to_triangle(points, triangles, t, point)
    if max(across[t, 0], across[t, 1], across[t, 2]) < 0:
        return best
    ids, far, count = np.empty(3 * ASKED + 1, np.int64), np.empty(3 * ASKED + 1), 1
    ids[0], far[0] = t, best
    for n in range(ASKED):
        if n >= count:
            break
        nearest = n + int(np.argmin(far[n:count]))
        ids[n], ids[nearest] = ids[nearest], ids[n]
        far[n], far[nearest] = far[nearest], far[n]
        for k in range(3):
            other = across[ids[n], k]
            if other >= 0 and not (ids[:count] == other).any():
                ids[count] = other
                far[count] = _to_triangle(points, triangles, other, point)
                best = min(best, far[count])
                count += 1
    return best


@inlined
def _corner(points: Floats, p: int) -> Point:
    return points[p, 0], points[p, 1], points[p, 2]


@kernel
def _to_triangle(points: Floats, triangles: Ints, t: int, point: Point) -> float:
    """Squared distance of a point from a triangle."""
    a = _corner(points, triangles[t, 0])
    b, c = _corner(points, triangles[t, 1]), _corner(points, triangles[t, 2])
    return _to_corners(a, b, c, point)


@kernel
def _to_corners(a: Point, b: Point, c: Point, point: Point) -> float:
    along, across, off = _minus(b, a), _minus(c, a), _minus(point, a)
    uu, uv, vv = _dot(along, along), _dot(along, across), _dot(across, across)
    du, dv = _dot(along, off), _dot(across, off)
    area = uu * vv - uv * uv
    if area > 0.0:
        u, v = (vv * du - uv * dv) / area, (uu * dv - uv * du) / area
        if u >= 0.0 and v >= 0.0 and u + v <= 1.0:
            return max(_dot(off, off) - u * du - v * dv, 0.0)
    return min(_to_edge(a, b, point), _to_edge(b, c, point), _to_edge(c, a, point))


@kernel
def _to_edge(a: Point, b: Point, point: Point) -> float:
    """Squared shortest distance of a point from a line segment."""
    along, off = _minus(b, a), _minus(point, a)
    f = min(max(_dot(along, off) / max(_dot(along, along), 1e-12), 0.0), 1.0)
    rest = _minus(off, (f * along[0], f * along[1], f * along[2]))
    return float(_dot(rest, rest))


@kernel
def to_true_plane(
    posts: NDArray[np.float32], x: float, y: float, flat: Point, true: Point
) -> float:
    """Squared distance of a drawn point from the plane of the true triangle under it."""
    c = min(max(int(np.floor(x)), 0), posts.shape[1] - 2)
    r = min(max(int(np.floor(y)), 0), posts.shape[0] - 2)
    row, col = (r, c + 1) if x - c > y - r else (r + 1, c)
    ux = float(posts[row, col, 0] - posts[r, c, 0])
    uy = float(posts[row, col, 1] - posts[r, c, 1])
    uz = float(posts[row, col, 2] - posts[r, c, 2])
    vx = float(posts[r + 1, c + 1, 0] - posts[r, c, 0])
    vy = float(posts[r + 1, c + 1, 1] - posts[r, c, 1])
    vz = float(posts[r + 1, c + 1, 2] - posts[r, c, 2])
    normal = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return float(_dot(normal, _minus(flat, true)) ** 2 / max(_dot(normal, normal), 1e-12))


@kernel
def to_true_surface(posts: NDArray[np.float32], x: float, y: float, point: Point) -> float:
    """Squared distance of a point from the true triangles around the post nearest to it.

    That post is looked for from a column and row near it. Triangles further away can only
    be nearer.
    """
    rows, cols = posts.shape[0], posts.shape[1]
    r, c = min(max(int(y), 0), rows - 1), min(max(int(x), 0), cols - 1)
    best, moved = squared_gap(_post(posts, r, c), point), True
    while moved:
        moved = False
        middle_r, middle_c = r, c
        for i in range(max(middle_r - 1, 0), min(middle_r + 2, rows)):
            for j in range(max(middle_c - 1, 0), min(middle_c + 2, cols)):
                far = squared_gap(_post(posts, i, j), point)
                if far < best:
                    best, r, c, moved = far, i, j, True
    for i in range(max(r - 1, 0), min(r + 1, rows - 1)):
        for j in range(max(c - 1, 0), min(c + 1, cols - 1)):
            a, d = _post(posts, i, j), _post(posts, i + 1, j + 1)
            best = min(best, _to_corners(a, _post(posts, i, j + 1), d, point))
            best = min(best, _to_corners(a, _post(posts, i + 1, j), d, point))
    return best


@inlined
def _post(posts: NDArray[np.float32], r: int, c: int) -> Point:
    return float(posts[r, c, 0]), float(posts[r, c, 1]), float(posts[r, c, 2])
