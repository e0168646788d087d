# SPDX-License-Identifier: Apache-2.0
"""The triangles around a vertex, and those that fill the hole which it leaves."""

import numpy as np

from ingest.delaunay import Ints, turn
from tiles.frames import Floats
from tiles.kernels import inlined

MOST = 10
"""Triangles around a vertex that may be taken out"""


@inlined
def walk(
    corner: Ints, opposite: Ints, half: int, star: Ints, link: Ints, outer: Ints
) -> int:
    """Walk around the vertex where a half-edge starts.

    Returns how many triangles there are, 0 where it is on the rim or has too many.
    """
    e, size, closed = half, 0, False
    while size < MOST and e >= 0 and not closed:
        t, k = e // 3, e % 3
        star[size], link[size] = t, corner[t, (k + 1) % 3]
        outer[size] = opposite[3 * t + (k + 1) % 3]
        e = opposite[3 * t + (k + 2) % 3]
        size, closed = size + 1, e == half
    return size if closed else 0


@inlined
def _power(flat: Floats, a: int, b: int, c: int, p: int) -> float:
    """Squared distance of p inside the circle through counter-clockwise a, b, c."""
    px, py = flat[p, 0], flat[p, 1]
    ax, ay = flat[a, 0] - px, flat[a, 1] - py
    bx, by = flat[b, 0] - px, flat[b, 1] - py
    cx, cy = flat[c, 0] - px, flat[c, 1] - py
    bc, ca, ab = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    lifted = (ax * ax + ay * ay) * bc + (bx * bx + by * by) * ca + (cx * cx + cy * cy) * ab
    return float(lifted / (bc + ca + ab))


@inlined
def fill(
    at: Ints, flat: Floats, v: int, size: int, link: Ints, made: Ints, ring: Ints
) -> bool:
    """Find triangles for the hole that a vertex leaves, as Delaunay as it goes.

    Ears are cut off: first those whose circle has the vertex furthest outside.
    """
    for k in range(size):
        ring[k] = link[k]
    left = size
    while left > 2:
        best, least = -1, np.inf
        a, b = ring[left - 1], ring[0]
        for i in range(left):
            c = ring[i + 1 if i + 1 < left else 0]
            if turn(at, a, b, c) > 0 and (left == 3 or turn(at, a, c, v) > 0):
                power = _power(flat, a, b, c, v)
                if power < least:
                    best, least = i, power
            a, b = b, c
        if best < 0:
            break
        n = size - left
        made[n, 0], made[n, 1] = ring[best - 1 if best else left - 1], ring[best]
        made[n, 2] = ring[best + 1 if best + 1 < left else 0]
        left -= 1
        for i in range(best, left):
            ring[i] = ring[i + 1]
    return left == 2
