# SPDX-License-Identifier: Apache-2.0
"""Delaunay triangulation of a square by insertion, in arrays.

Places are whole numbers, so that what is straight is exactly straight.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import borrowing, inlined

Ints = NDArray[np.int64]


class Net(NamedTuple):
    """A triangulation while it grows."""

    at: Ints
    """(n, 2) places of the points, 0..UV_ONE"""
    flat: Floats
    """(n, 2) the same on a map where triangles are to be compact"""
    points: Floats
    """(n, 3) m"""
    must: NDArray[np.bool_]
    """(n,) points that become vertices however near their triangles are"""
    middle: Floats
    """(3,) m from the earth's centre to the points' origin; 0 to measure to planes"""
    high_m: Floats
    """(n,) heights of the points, as in `upright`"""
    corner: Ints
    """(m, 3) points of every triangle, counter-clockwise"""
    opposite: Ints
    """(3 m,) the half-edge across from each, -1 on the rim"""


@inlined
def write_triangle(
    corner: Ints,
    opposite: Ints,
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


@inlined
def turn(at: Ints, a: int, b: int, p: int) -> int:
    """Twice the signed area of places a, b, p; positive when counter-clockwise."""
    x, y = at[a, 0], at[a, 1]
    return int((at[b, 0] - x) * (at[p, 1] - y) - (at[b, 1] - y) * (at[p, 0] - x))


@inlined
def _in_circle(flat: Floats, a: int, b: int, c: int, p: int) -> bool:
    """Say whether p lies clearly inside the circle through counter-clockwise a, b, c."""
    px, py = flat[p, 0], flat[p, 1]
    ax, ay = flat[a, 0] - px, flat[a, 1] - py
    bx, by = flat[b, 0] - px, flat[b, 1] - py
    cx, cy = flat[c, 0] - px, flat[c, 1] - py
    aa, bb, cc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    det = ax * (by * cc - bb * cy) - ay * (bx * cc - bb * cx) + aa * (bx * cy - by * cx)
    return bool(det > 1e-12 * (aa + bb + cc) ** 2)


@borrowing
def _legalise(net: Net, stack: Ints, depth: int, star: Ints, size: int) -> int:
    """Flip edges until every stacked half-edge is Delaunay again.

    Every triangle that changes joins the star of the new point; returns its size.
    """
    at, flat, corner, opposite = net.at, net.flat, net.corner, net.opposite
    while depth > 0:
        depth -= 1
        a = stack[depth]
        b = opposite[a]
        if b < 0:
            continue
        ta, ka, tb, kb = a // 3, a % 3, b // 3, b % 3
        right, left = corner[ta, ka], corner[ta, (ka + 1) % 3]
        top, far = corner[ta, (ka + 2) % 3], corner[tb, (kb + 2) % 3]
        if not _in_circle(flat, right, left, top, far):
            continue
        # What is round on the ground may be bent inwards here.
        if turn(at, top, right, far) <= 0 or turn(at, far, left, top) <= 0:
            continue
        a1, a2 = opposite[3 * ta + (ka + 1) % 3], opposite[3 * ta + (ka + 2) % 3]
        b1, b2 = opposite[3 * tb + (kb + 1) % 3], opposite[3 * tb + (kb + 2) % 3]
        write_triangle(corner, opposite, ta, (top, right, far), (a2, b1, -1))
        write_triangle(corner, opposite, tb, (far, left, top), (b2, a1, 3 * ta + 2))
        star[size] = tb
        size += 1
        stack[depth] = 3 * ta + 1
        stack[depth + 1] = 3 * tb
        depth += 2
    return size


@borrowing
def _split_face(corner: Ints, opposite: Ints, count: int, t: int, p: int) -> int:
    """Put p into the inside of triangle t; returns the new count of triangles."""
    a, b, c = corner[t, 0], corner[t, 1], corner[t, 2]
    h0, h1, h2 = opposite[3 * t], opposite[3 * t + 1], opposite[3 * t + 2]
    u, v = count, count + 1
    write_triangle(corner, opposite, t, (a, b, p), (h0, -1, -1))
    write_triangle(corner, opposite, u, (b, c, p), (h1, -1, 3 * t + 1))
    write_triangle(corner, opposite, v, (c, a, p), (h2, 3 * t + 2, 3 * u + 1))
    return count + 2


@borrowing
def _split_edge(corner: Ints, opposite: Ints, count: int, e: int, p: int) -> int:
    """Put p on half-edge e of its triangle and of the one across; returns the new count."""
    t, k, f = e // 3, e % 3, opposite[e]
    a, b, c = corner[t, k], corner[t, (k + 1) % 3], corner[t, (k + 2) % 3]
    bc, ca = opposite[3 * t + (k + 1) % 3], opposite[3 * t + (k + 2) % 3]
    u = count
    if f < 0:
        write_triangle(corner, opposite, t, (a, p, c), (-1, -1, ca))
        write_triangle(corner, opposite, u, (p, b, c), (-1, bc, 3 * t + 1))
        return count + 1
    s, m, v = f // 3, f % 3, count + 1
    d = corner[s, (m + 2) % 3]
    ad, db = opposite[3 * s + (m + 1) % 3], opposite[3 * s + (m + 2) % 3]
    write_triangle(corner, opposite, t, (a, p, c), (-1, -1, ca))
    write_triangle(corner, opposite, u, (p, b, c), (-1, bc, 3 * t + 1))
    write_triangle(corner, opposite, s, (b, p, d), (3 * u, -1, db))
    write_triangle(corner, opposite, v, (p, a, d), (3 * t, ad, 3 * s + 1))
    return count + 2


@borrowing
def insert(
    net: Net, count: int, t: int, p: int, stack: Ints, star: Ints
) -> tuple[int, int]:
    """Put p into triangle t; returns the count of triangles and the size of p's star."""
    at, corner, opposite = net.at, net.corner, net.opposite
    edge = -1
    for k in range(3):
        if turn(at, corner[t, k], corner[t, (k + 1) % 3], p) == 0:
            edge = 3 * t + k
    before, size = count, 1
    star[0] = t
    if edge >= 0:
        if opposite[edge] >= 0:
            star[1], size = opposite[edge] // 3, 2
        count = _split_edge(corner, opposite, count, edge, p)
    else:
        count = _split_face(corner, opposite, count, t, p)
    for s in range(before, count):
        star[size] = s
        size += 1
    for n in range(size):
        for k in range(3):
            if corner[star[n], (k + 2) % 3] == p:
                stack[n] = 3 * star[n] + k
    return count, _legalise(net, stack, size, star, size)
