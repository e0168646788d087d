# SPDX-License-Identifier: Apache-2.0
"""Greedy insertion: the fewest triangles within an error, judged in ECEF.

Starting from two triangles, the point that is worst represented is inserted and the
triangulation made Delaunay again, until no point is further than the bound from its
triangle: measured straight up, or to the triangle's plane. A point on the rim is compared
with the point of the rim that has its longitude and latitude. All in ECEF, so that the
planet's curvature counts. Every triangle keeps a list of the points over it, so that an
insertion looks only at those around it.

References
----------
Garland and Heckbert 1995, Fast Polygonal Approximation of Terrains and Height Fields
(CMU-CS-95-181), algorithm III.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.delaunay import Ints, Net, insert, turn, write_triangle
from ingest.peaks import CHUNK, first, raised
from ingest.upright import sag
from tiles.frames import Floats
from tiles.kernels import borrowing, inlined, kernel
from tiles.mesh import UV_ONE

ALWAYS = 1e12
"""Added to the squared distance of points that must be vertices, m2"""
CORNERS = 4
"""The first points are the square's corners, south-west first, counter-clockwise."""
MOST_TRIANGLES = 120_000
"""More would have more vertices than 16 bits can name."""
LONG_WALK = 1000
"""Triangles that a walk crosses before it goes on at random"""

Corners = tuple[int, int, int]
Weights = tuple[int, int, int]


class Lists(NamedTuple):
    """Which points lie over each triangle."""

    head: Ints
    """(m,) first point, -1 for none"""
    after: Ints
    """(n,) next point of the same triangle"""
    candidate: Ints
    """(m,) the worst of them"""
    worst: Floats
    """(m,) its squared distance, -1 for none"""
    weight: Floats
    """(n,) squared distance of each vertex when it was inserted"""
    normals: Floats
    """(m, 3) room for unit normals, or sags"""
    sides: Ints
    """(m, 9) room for what says on which side of its edges a triangle's inside is"""
    fresh: NDArray[np.bool_]
    """(m,) triangles written since somebody looked"""
    unseen: NDArray[np.bool_]
    """(m,) triangles written since somebody looked along their edges"""


@inlined
def slopes(points: Floats, corner: Ints, star: Ints, size: int, normals: Floats) -> None:
    """Write what a difference is multiplied by to give the distance from a plane."""
    for n in range(size):
        a, b, c = corner[star[n], 0], corner[star[n], 1], corner[star[n], 2]
        px, py, pz = points[a, 0], points[a, 1], points[a, 2]
        ux, uy, uz = points[b, 0] - px, points[b, 1] - py, points[b, 2] - pz
        vx, vy, vz = points[c, 0] - px, points[c, 1] - py, points[c, 2] - pz
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = max(np.sqrt(x * x + y * y + z * z), 1e-12)
        normals[n, 0], normals[n, 1], normals[n, 2] = x / length, y / length, z / length


@inlined
def off_plane(points: Floats, normals: Floats, n: int, a: int, q: int) -> float:
    """Squared distance of a point from the plane of a star's triangle."""
    off = normals[n, 0] * (points[q, 0] - points[a, 0])
    off += normals[n, 1] * (points[q, 1] - points[a, 1])
    off += normals[n, 2] * (points[q, 2] - points[a, 2])
    return float(off * off)


@inlined
def _sags(
    points: Floats,
    high_m: Floats,
    middle: Floats,
    corner: Ints,
    star: Ints,
    size: int,
    sags: Floats,
) -> None:
    """Write the sags of a star's edges."""
    twice_m = 2.0 * np.sqrt(middle[0] ** 2 + middle[1] ** 2 + middle[2] ** 2)
    for n in range(size):
        for k in range(3):
            p, q = corner[star[n], k], corner[star[n], (k + 1) % 3]
            sags[n, k] = sag(points, high_m, twice_m, p, q)


@inlined
def _sides(at: Ints, corner: Ints, star: Ints, size: int, sides: Ints) -> None:
    """Write what a place and 1 are multiplied by to give `turn` at a star's edges."""
    for n in range(size):
        for k in range(3):
            a, b = corner[star[n], (k + 1) % 3], corner[star[n], (k + 2) % 3]
            east, north = at[b, 0] - at[a, 0], at[b, 1] - at[a, 1]
            sides[n, 3 * k], sides[n, 3 * k + 1] = -north, east
            sides[n, 3 * k + 2] = north * at[a, 0] - east * at[a, 1]


@inlined
def _over(sides: Ints, size: int, x: int, y: int) -> tuple[int, Weights]:
    """Return which triangle of a star is over a place, or `size`; twice areas there."""
    for n in range(size):
        # One by one: most triangles are ruled out by the first.
        w0 = sides[n, 0] * x + sides[n, 1] * y + sides[n, 2]
        if w0 < 0:
            continue
        w1 = sides[n, 3] * x + sides[n, 4] * y + sides[n, 5]
        if w1 < 0:
            continue
        w2 = sides[n, 6] * x + sides[n, 7] * y + sides[n, 8]
        if w2 >= 0:
            return n, (w0, w1, w2)
    return size, (0, 0, 0)


@inlined
def off_upright(
    high_m: Floats, sags: Floats, n: int, corners: Corners, weights: Weights, q: int
) -> float:
    """Squared difference in height of a point and a star's triangle at the same place."""
    part = 1.0 / (weights[0] + weights[1] + weights[2])
    f0, f1, f2 = weights[0] * part, weights[1] * part, weights[2] * part
    there = f0 * high_m[corners[0]] + f1 * high_m[corners[1]] + f2 * high_m[corners[2]]
    there -= f0 * f1 * sags[n, 0] + f1 * f2 * sags[n, 1] + f2 * f0 * sags[n, 2]
    return float((there - high_m[q]) ** 2)


@inlined
def off_rim(points: Floats, corners: Corners, weights: Weights, q: int) -> float:
    """Squared distance of a point on the rim from the triangle at the same place."""
    a, b, c = corners
    w0, w1, w2 = weights
    squared = 0.0
    for k in range(3):
        there = w0 * points[a, k] + w1 * points[b, k] + w2 * points[c, k]
        squared += (there / (w0 + w1 + w2) - points[q, k]) ** 2
    return float(squared)


@inlined
def _is_at(at: Ints, weight: Floats, q: int, p: int) -> bool:
    """Say whether a point is p, or lies where p is and so is not needed any more."""
    same = p >= 0 and at[q, 0] == at[p, 0] and at[q, 1] == at[p, 1]
    if same and q != p:
        weight[q] = 0.0
    return same


@borrowing
def assign(net: Net, lists: Lists, orphans: int, star: Ints, size: int, p: int) -> None:
    """Give orphans but p to the triangle of a star that they lie over; note the worst."""
    at, corner, points, must = net.at, net.corner, net.points, net.must
    head, after, candidate, worst = lists.head, lists.after, lists.candidate, lists.worst
    normals, sides = lists.normals, lists.sides
    high_m, middle = net.high_m, net.middle
    upright = middle[0] != 0.0 or middle[1] != 0.0 or middle[2] != 0.0
    if upright:
        _sags(points, high_m, middle, corner, star, size, normals)
    else:
        slopes(points, corner, star, size, normals)
    _sides(at, corner, star, size, sides)
    for n in range(size):
        t = star[n]
        head[t], candidate[t], worst[t] = -1, -1, -1.0
    while orphans >= 0:
        q = orphans
        orphans = after[q]
        x, y = at[q, 0], at[q, 1]
        if _is_at(at, lists.weight, q, p):
            continue
        n, weights = _over(sides, size, x, y)
        if n == size:
            continue
        t = star[n]
        corners = corner[t, 0], corner[t, 1], corner[t, 2]
        after[q] = head[t]
        head[t] = q
        if x % UV_ONE == 0 or y % UV_ONE == 0:
            squared = off_rim(points, corners, weights, q)
        elif upright:
            squared = off_upright(high_m, normals, n, corners, weights, q)
        else:
            squared = off_plane(points, normals, n, corners[0], q)
        if must[q]:
            squared += ALWAYS
        if squared > worst[t]:
            worst[t], candidate[t] = squared, q


@inlined
def orphaned(head: Ints, after: Ints, star: Ints, size: int) -> int:
    """Join the lists of a star's triangles to one; returns its first point."""
    first = -1
    for n in range(size):
        q = head[star[n]]
        head[star[n]] = -1
        while q >= 0:
            following = after[q]
            after[q] = first
            first, q = q, following
    return first


@kernel
def begin(net: Net, lists: Lists, points: int) -> int:
    """Make the first two triangles and give all points to them; returns their count."""
    write_triangle(net.corner, net.opposite, 0, (0, 1, 2), (-1, -1, -1))
    write_triangle(net.corner, net.opposite, 1, (0, 2, 3), (2, -1, -1))
    assign(net, lists, CORNERS if points > CORNERS else -1, np.arange(2), 2, -1)
    return 2


@borrowing
def over(net: Net, t: int, q: int) -> int:
    """Walk from triangle t to the one that q lies over.

    At a pole, where triangles are Delaunay on another map, always trying edges in the same
    order may go round in circles: a long walk tries them at random.
    """
    at, corner, opposite = net.at, net.corner, net.opposite
    first, k, steps, drawn = 0, 0, 0, 1
    while k < 3:
        e = (first + k) % 3
        across = opposite[3 * t + e]
        if across >= 0 and turn(at, corner[t, e], corner[t, (e + 1) % 3], q) < 0:
            t, k, steps = across // 3, 0, steps + 1
            if steps > LONG_WALK:
                drawn = (drawn * 1103515245 + 12345) & 0x7FFFFFFF
                first = (drawn >> 16) % 3
        else:
            k += 1
    return t


@kernel
def refine(net: Net, lists: Lists, count: int, bound: float) -> int:
    """Insert worst points until none is above the bound; returns the count of triangles."""
    head, after, worst = lists.head, lists.after, lists.worst
    fresh, unseen = lists.fresh, lists.unseen
    capacity = len(net.corner)
    star, stack = np.empty(capacity, np.int64), np.empty(3 * capacity + 8, np.int64)
    half = 1
    while half * CHUNK < capacity:
        half *= 2
    peak = np.full(2 * half, -1.0)
    for chunk in range((count + CHUNK - 1) // CHUNK):
        raised(peak, half, worst, chunk)
    while True:
        t = first(peak, half, worst)
        p = lists.candidate[t]
        if worst[t] <= bound or p < 0 or count > MOST_TRIANGLES:
            return count
        lists.weight[p] = worst[t]
        count, size = insert(net, count, t, p, stack, star)
        assign(net, lists, orphaned(head, after, star, size), star, size, p)
        for n in range(size):
            fresh[star[n]] = unseen[star[n]] = True
            raised(peak, half, worst, star[n] // CHUNK)
