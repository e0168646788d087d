# SPDX-License-Identifier: Apache-2.0
"""Greedy insertion: the fewest triangles within an error, judged in ECEF.

Starting from two triangles, the post that is worst represented is inserted and the
triangulation made Delaunay again, until no post is further than the bound from the
point of its triangle with the same longitude and latitude. Because posts and triangles
are compared as points in ECEF, the planet's curvature counts.

References
----------
Garland and Heckbert 1995, Fast Polygonal Approximation of Terrains and Height Fields
(CMU-CS-95-181), algorithm III.
"""

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import kernel

CHUNK = 64
"""Triangles whose largest error is kept together, so that few are looked at again."""


def simplify(
    posts: Floats, bound_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Triangulate a lattice of posts within a bound.

    Parameters
    ----------
    posts : (n + 1, n + 1, 3) float64, m, any Cartesian frame; row 0 south, column 0 west
    bound_m : largest allowed distance of a post

    Returns
    -------
    used : (v,) int64, positions of the vertices in the flattened lattice
    triangles : (t, 3) int64 into `used`, counter-clockwise with x east and y north
    border : (b, 2) int64 into `used`, the directed edges on the lattice's rim
    """
    side = posts.shape[0]
    capacity = 2 * (side - 1) * (side - 1) + 2
    corner = np.zeros((capacity, 3), np.int64)
    opposite = np.full(3 * capacity, -1, np.int64)
    count = _refine(posts.reshape(-1, 3), side, bound_m, corner, opposite)
    corner, opposite = corner[:count], opposite[: 3 * count].reshape(-1, 3)
    used, triangles = np.unique(corner, return_inverse=True)
    triangles = triangles.reshape(-1, 3).astype(np.int64)
    at, edge = np.nonzero(opposite < 0)
    border = np.stack([triangles[at, edge], triangles[at, (edge + 1) % 3]], axis=1)
    return used.astype(np.int64), triangles, border


@kernel
def _set(
    corner: NDArray[np.int64],
    opposite: NDArray[np.int64],
    t: int,
    points: tuple[int, int, int],
    across: tuple[int, int, int],
) -> None:
    """Write triangle t and tell the half-edges across from it."""
    for k in range(3):
        corner[t, k] = points[k]
        opposite[3 * t + k] = across[k]
        if across[k] >= 0:
            opposite[across[k]] = 3 * t + k


@kernel
def _turn(side: int, a: int, b: int, c: int) -> int:
    """Twice the signed area of lattice points a, b, c; positive when counter-clockwise."""
    ax, ay, bx, by = a % side, a // side, b % side, b // side
    return (bx - ax) * (c // side - ay) - (by - ay) * (c % side - ax)


@kernel
def _in_circle(side: int, a: int, b: int, c: int, p: int) -> bool:
    """Say whether p lies inside the circle through counter-clockwise a, b, c (exact)."""
    px, py = p % side, p // side
    ax, ay = a % side - px, a // side - py
    bx, by = b % side - px, b // side - py
    cx, cy = c % side - px, c // side - py
    aa, bb, cc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    return (
        ax * (by * cc - bb * cy) - ay * (bx * cc - bb * cx) + aa * (bx * cy - by * cx) > 0
    )


@kernel
def _worst(posts: Floats, side: int, a: int, b: int, c: int) -> tuple[int, float]:
    """Find the post in triangle a, b, c that is furthest from it, and that distance."""
    ax, ay, bx, by, cx, cy = a % side, a // side, b % side, b // side, c % side, c // side
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    worst, found = 0.0, -1
    for y in range(min(ay, by, cy), max(ay, by, cy) + 1):
        for x in range(min(ax, bx, cx), max(ax, bx, cx) + 1):
            w0 = (bx - x) * (cy - y) - (by - y) * (cx - x)
            w1 = (cx - x) * (ay - y) - (cy - y) * (ax - x)
            w2 = area - w0 - w1
            if w0 < 0 or w1 < 0 or w2 < 0:
                continue
            p, squared = y * side + x, 0.0
            for k in range(3):
                flat = (w0 * posts[a, k] + w1 * posts[b, k] + w2 * posts[c, k]) / area
                squared += (flat - posts[p, k]) ** 2
            if squared > worst and p not in (a, b, c):
                worst, found = squared, p
    return found, np.sqrt(worst)


@kernel
def _mark(dirty: NDArray[np.bool_], capacity: int, t: int) -> None:
    """Note that triangle t, and so its chunk, must be measured again."""
    dirty[t] = True
    dirty[capacity + t // CHUNK] = True


@kernel
def _legalise(
    corner: NDArray[np.int64],
    opposite: NDArray[np.int64],
    side: int,
    stack: NDArray[np.int64],
    depth: int,
    dirty: NDArray[np.bool_],
) -> None:
    """Flip edges until every stacked half-edge is Delaunay again."""
    while depth > 0:
        depth -= 1
        a = stack[depth]
        b = opposite[a]
        if b < 0:
            continue
        ta, ka, tb, kb = a // 3, a % 3, b // 3, b % 3
        right, left, top = (
            corner[ta, ka],
            corner[ta, (ka + 1) % 3],
            corner[ta, (ka + 2) % 3],
        )
        far = corner[tb, (kb + 2) % 3]
        if not _in_circle(side, right, left, top, far):
            continue
        a1, a2 = opposite[3 * ta + (ka + 1) % 3], opposite[3 * ta + (ka + 2) % 3]
        b1, b2 = opposite[3 * tb + (kb + 1) % 3], opposite[3 * tb + (kb + 2) % 3]
        _set(corner, opposite, ta, (top, right, far), (a2, b1, -1))
        _set(corner, opposite, tb, (far, left, top), (b2, a1, 3 * ta + 2))
        _mark(dirty, len(corner), ta)
        _mark(dirty, len(corner), tb)
        stack[depth] = 3 * ta + 1
        stack[depth + 1] = 3 * tb
        depth += 2


@kernel
def _split_face(
    corner: NDArray[np.int64], opposite: NDArray[np.int64], count: int, t: int, p: int
) -> int:
    """Put p into the inside of triangle t; returns the new count of triangles."""
    a, b, c = corner[t]
    h0, h1, h2 = opposite[3 * t], opposite[3 * t + 1], opposite[3 * t + 2]
    u, v = count, count + 1
    _set(corner, opposite, t, (a, b, p), (h0, -1, -1))
    _set(corner, opposite, u, (b, c, p), (h1, -1, 3 * t + 1))
    _set(corner, opposite, v, (c, a, p), (h2, 3 * t + 2, 3 * u + 1))
    return count + 2


@kernel
def _split_edge(
    corner: NDArray[np.int64], opposite: NDArray[np.int64], count: int, e: int, p: int
) -> int:
    """Put p on half-edge e of its triangle and of the one across; returns the new count."""
    t, k, f = e // 3, e % 3, opposite[e]
    a, b, c = corner[t, k], corner[t, (k + 1) % 3], corner[t, (k + 2) % 3]
    bc, ca = opposite[3 * t + (k + 1) % 3], opposite[3 * t + (k + 2) % 3]
    u = count
    if f < 0:
        _set(corner, opposite, t, (a, p, c), (-1, -1, ca))
        _set(corner, opposite, u, (p, b, c), (-1, bc, 3 * t + 1))
        return count + 1
    s, m, v = f // 3, f % 3, count + 1
    d = corner[s, (m + 2) % 3]
    ad, db = opposite[3 * s + (m + 1) % 3], opposite[3 * s + (m + 2) % 3]
    _set(corner, opposite, t, (a, p, c), (-1, -1, ca))
    _set(corner, opposite, u, (p, b, c), (-1, bc, 3 * t + 1))
    _set(corner, opposite, s, (b, p, d), (3 * u, -1, db))
    _set(corner, opposite, v, (p, a, d), (3 * t, ad, 3 * s + 1))
    return count + 2


@kernel
def _edge_under(corner: NDArray[np.int64], side: int, t: int, p: int) -> int:
    """Return the half-edge of triangle t that p lies on, -1 when it lies inside."""
    edge = -1
    for k in range(3):
        if _turn(side, corner[t, k], corner[t, (k + 1) % 3], p) == 0:
            edge = 3 * t + k
    return edge


@kernel
def _measure(
    posts: Floats,
    side: int,
    corner: NDArray[np.int64],
    dirty: NDArray[np.bool_],
    candidate: NDArray[np.int64],
    worst: Floats,
    peak: Floats,
) -> None:
    """Find the worst post of every triangle that changed, and the worst of its chunk."""
    capacity = len(corner)
    for chunk in range(len(peak)):
        if not dirty[capacity + chunk]:
            continue
        dirty[capacity + chunk] = False
        peak[chunk] = 0.0
        for t in range(chunk * CHUNK, min((chunk + 1) * CHUNK, capacity)):
            if dirty[t]:
                a, b, c = corner[t]
                candidate[t], worst[t] = _worst(posts, side, a, b, c)
                dirty[t] = False
            peak[chunk] = max(peak[chunk], worst[t])


@kernel
def _refine(
    posts: Floats,
    side: int,
    bound_m: float,
    corner: NDArray[np.int64],
    opposite: NDArray[np.int64],
) -> int:
    """Insert worst posts until none is above the bound; returns the count of triangles."""
    last = side * side - 1
    _set(corner, opposite, 0, (0, side - 1, last), (-1, -1, -1))
    _set(corner, opposite, 1, (0, last, last - side + 1), (2, -1, -1))
    count = 2
    capacity = len(corner)
    worst = np.zeros(capacity)
    peak = np.zeros(capacity // CHUNK + 1)
    candidate = np.zeros(capacity, np.int64)
    dirty = np.zeros(capacity + len(peak), np.bool_)
    _mark(dirty, capacity, 0)
    _mark(dirty, capacity, 1)
    stack = np.zeros(3 * capacity + 8, np.int64)
    while True:
        _measure(posts, side, corner, dirty, candidate, worst, peak)
        chunk = int(np.argmax(peak)) * CHUNK
        t = chunk + int(np.argmax(worst[chunk : chunk + CHUNK]))
        if worst[t] <= bound_m:
            return count
        p = candidate[t]
        edge = _edge_under(corner, side, t, p)
        before, other = count, -1
        if edge >= 0:
            other = opposite[edge] // 3 if opposite[edge] >= 0 else -1
            count = _split_edge(corner, opposite, count, edge, p)
        else:
            count = _split_face(corner, opposite, count, t, p)
        depth = 0
        for n in range(-2, count - before):
            s = before + n if n >= 0 else (t if n == -2 else other)
            if s < 0:
                continue
            _mark(dirty, capacity, s)
            for k in range(3):
                if corner[s, (k + 2) % 3] == p:
                    stack[depth] = 3 * s + k
                    depth += 1
        _legalise(corner, opposite, side, stack, depth, dirty)
