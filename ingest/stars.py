# SPDX-License-Identifier: Apache-2.0
"""Take a vertex out of a triangulation: its star becomes a fan around another vertex."""

import numpy as np

from ingest.delaunay import Ints, write_triangle
from ingest.greedy import Lists
from tiles.kernels import borrowing, inlined, kernel

MOST = 32
"""Triangles of the largest star that is looked at"""


@kernel
def halves_from(corner: Ints, count: int, size: int) -> Ints:
    """Return for each point a half-edge that begins there, -1 for none."""
    out = np.full(size, -1)
    for t in range(count):
        for k in range(3):
            out[corner[t, k]] = 3 * t + k
    return out


@inlined
def _twice(ring: Ints, outer: Ints, n: int) -> int:
    """Go round once more, so that nobody has to divide."""
    for i in range(n):
        ring[n + i], outer[n + i] = ring[i], outer[i]
    return n


@borrowing
def star_of(
    corner: Ints, opposite: Ints, e: int, ring: Ints, outer: Ints, star: Ints
) -> tuple[int, int]:
    """List what is around the vertex that half-edge e begins at, counter-clockwise.

    Parameters
    ----------
    ring : vertices are written here, twice round, (2 MOST + 2,)
    outer : and the half-edge across from each edge to the next, -1 on the rim, as often
    star : and triangles, (MOST,)

    Returns
    -------
    How many vertices and triangles there are; 0, 0 for too many. On the rim there is a
    vertex more: there the last edge goes straight through the vertex itself.
    """
    start, across = e, opposite[e]
    while across >= 0:  # on the rim, begin at the first
        e = across - 2 if across % 3 == 2 else across + 1
        across = opposite[e] if e != start else -1
    start = e
    for m in range(MOST):
        t, k = e // 3, e % 3
        star[m], ring[m] = t, corner[t, (k + 1) % 3]
        outer[m] = opposite[3 * t + (k + 1) % 3]
        e = opposite[3 * t + (k + 2) % 3]
        if e < 0:
            ring[m + 1], outer[m + 1] = corner[t, (k + 2) % 3], -1
            return _twice(ring, outer, m + 2), m + 1
        if e == start:
            return _twice(ring, outer, m + 1), m + 1
    return 0, 0


@borrowing
def write_fan(
    corner: Ints, opposite: Ints, ring: Ints, outer: Ints, star: Ints, n: int, j: int
) -> None:
    """Write the n - 2 triangles between n vertices of a ring, all with the one at j."""
    for i in range(1, n - 1):
        before = outer[j] if i == 1 else 3 * star[i - 2] + 2
        last = outer[j + n - 1] if i == n - 2 else -1
        points = ring[j], ring[j + i], ring[j + i + 1]
        write_triangle(corner, opposite, star[i - 1], points, (before, outer[j + i], last))


@borrowing
def drop(
    corner: Ints, opposite: Ints, lists: Lists, out: Ints, hole: int, count: int
) -> int:
    """Put the last triangle where one is not needed; returns how many are left."""
    t = count - 1
    if hole != t:
        points = corner[t, 0], corner[t, 1], corner[t, 2]
        across = opposite[3 * t], opposite[3 * t + 1], opposite[3 * t + 2]
        write_triangle(corner, opposite, hole, points, across)
        lists.head[hole], lists.candidate[hole] = lists.head[t], lists.candidate[t]
        lists.worst[hole], lists.unseen[hole] = lists.worst[t], lists.unseen[t]
        lists.fresh[hole] = True
        for k in range(3):
            out[corner[hole, k]] = 3 * hole + k
    lists.head[t], lists.candidate[t], lists.worst[t] = -1, -1, -1.0
    lists.fresh[t] = lists.unseen[t] = True
    return t
