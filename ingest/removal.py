# SPDX-License-Identifier: Apache-2.0
"""Vertices that a mesh can do without: taken out, judged by their holes, or put back.

Greedy insertion never takes a vertex back, though what comes after may make it needless.
Here vertices are taken out that no two triangles of their stars share an edge, so that
whoever measures what fills their holes can judge each by itself.

References
----------
Schroeder, Zarge and Lorensen 1992, Decimation of Triangle Meshes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.delaunay import Ints, Net, turn, write_triangle
from ingest.greedy import (
    CORNERS,
    Lists,
    assign,
    off_plane,
    orphaned,
    slopes,
)
from ingest.holes import MOST, fill, walk
from ingest.stars import halves_from
from tiles.frames import Floats
from tiles.kernels import borrowing, inlined, kernel
from tiles.mesh import UV_ONE

UNKNOWN = -1.0


class Holes(NamedTuple):
    """Vertices that were taken out, and what was around them."""

    vertex: Ints
    """(h,)"""
    size: Ints
    """(h,) triangles around it"""
    star: Ints
    """(h, MOST) those triangles, counter-clockwise"""
    link: Ints
    """(h, MOST) where each one's outer edge starts"""
    outer: Ints
    """(h, MOST) the half-edge across from that edge, -1 on the rim"""


@kernel
def lift(
    net: Net, lists: Lists, count: int, size: int, bound: float, losses: Floats
) -> Holes:
    """Take out inner vertices whose loss moves no point further off than a squared bound.

    Those that matter least come first. The last two triangles of each star lie in the
    vertex taken out, without area, until `settle` is called.

    Parameters
    ----------
    net : that measures to planes
    count, size : of triangles and of points
    losses : (size,) for the calls to come with this bound, `UNKNOWN` before the first

    Returns
    -------
    None of those around triangles that nobody has looked at.
    """
    half_of = halves_from(net.corner, count, size)
    _judge(net, lists, half_of, bound, losses)
    lists.unseen[:count] = False
    holes = _chosen(net, half_of, bound, losses, count)
    for h in range(len(holes.vertex)):
        _open(net, lists, holes, h)
    return holes


@kernel
def _judge(net: Net, lists: Lists, half_of: Ints, bound: float, losses: Floats) -> None:
    """Find how far off points would be without each vertex, at most.

    Losses are squared; they stay where no triangle has changed. Above the bound any will
    do, and it is infinite where a vertex is not to be looked at again.
    """
    at, flat, corner, opposite = net.at, net.flat, net.corner, net.opposite
    fresh, unseen = lists.fresh, lists.unseen
    star, link, outer = _room(), _room(), _room()
    ring, made = _room(), np.empty((MOST, 3), np.int64)
    room = np.empty((MOST, 3)), np.arange(MOST)
    for v in range(CORNERS, len(losses)):
        if half_of[v] < 0 or losses[v] == np.inf:
            continue
        size = walk(corner, opposite, half_of[v], star, link, outer)
        old, new = losses[v] != UNKNOWN, False
        for t in star[:size]:
            old, new = old and not unseen[t], new or fresh[t]
        if _is_rim(at, v):
            losses[v] = np.inf
        elif new:
            losses[v] = UNKNOWN
        elif not old or size == 0:
            losses[v] = 2.0 * bound + 1.0
            if size > 0 and fill(at, flat, v, size, link, made, ring):
                losses[v] = _worst(net, lists, v, star[:size], made, room, bound)


@inlined
def _room() -> Ints:
    return np.empty(MOST, np.int64)


@inlined
def _is_rim(at: Ints, p: int) -> bool:
    return bool(at[p, 0] % UV_ONE == 0 or at[p, 1] % UV_ONE == 0)


@borrowing
def _worst(
    net: Net,
    lists: Lists,
    v: int,
    star: Ints,
    made: Ints,
    room: tuple[Floats, Ints],
    bound: float,
) -> float:
    """Squared distance of the worst point over a hole; any above the bound will do.

    Parameters
    ----------
    star, made : triangles around the vertex, and the points of those that fill the hole
    room : for normals, and numbers from 0 on
    """
    normals, numbers = room
    at, points, head, after = net.at, net.points, lists.head, lists.after
    count, most = len(star) - 2, 0.0
    slopes(points, made, numbers, count, normals)
    for k in range(-1, len(star)):
        q = v if k < 0 else head[star[k]]
        while q >= 0 and most <= bound:
            n = 0 if not _is_rim(at, q) else count
            while n < count and not _is_over(at, made, n, q):
                n += 1
            if n < count:
                most = max(most, off_plane(points, normals, n, made[n, 0], q))
            q = after[q] if k >= 0 else -1
    return most


@inlined
def _is_over(at: Ints, made: Ints, n: int, q: int) -> bool:
    a, b, c = made[n, 0], made[n, 1], made[n, 2]
    return turn(at, a, b, q) >= 0 and turn(at, b, c, q) >= 0 and turn(at, c, a, q) >= 0


@kernel
def _chosen(net: Net, half_of: Ints, bound: float, losses: Floats, count: int) -> Holes:
    """Choose vertices within a bound, those that matter least first, stars apart."""
    may = (half_of >= 0) & (losses >= 0.0) & (losses <= bound)
    may[:CORNERS] = False
    ids = np.flatnonzero(may)
    ids = ids[np.argsort(losses[ids], kind="mergesort")]
    taken = np.zeros(count, np.bool_)
    vertex, sizes = np.empty(len(ids), np.int64), np.empty(len(ids), np.int64)
    shape = len(ids), MOST
    star, link = np.empty(shape, np.int64), np.empty(shape, np.int64)
    outer = np.empty(shape, np.int64)
    made = 0
    for n in range(len(ids)):
        half, mine, beside = half_of[ids[n]], star[made], outer[made]
        size = walk(net.corner, net.opposite, half, mine, link[made], beside)
        apart = True
        for k in range(size):
            apart = apart and not taken[mine[k]]
            apart = apart and (beside[k] < 0 or not taken[beside[k] // 3])
        if apart:
            taken[mine[:size]] = True
            losses[ids[n]] = np.inf
            vertex[made], sizes[made] = ids[n], size
            made += 1
    return Holes(vertex[:made], sizes[:made], star[:made], link[:made], outer[:made])


@kernel
def _open(net: Net, lists: Lists, holes: Holes, h: int) -> None:
    """Fill a hole."""
    corner, opposite = net.corner, net.opposite
    v, size, star, outer = holes.vertex[h], holes.size[h], holes.star[h], holes.outer[h]
    link, made, ring = (
        holes.link[h],
        np.empty((MOST, 3), np.int64),
        np.empty(MOST, np.int64),
    )
    fill(net.at, net.flat, v, size, link, made, ring)
    for n in range(size - 2):
        corners, t = (made[n, 0], made[n, 1], made[n, 2]), star[n]
        write_triangle(corner, opposite, t, corners, (-1, -1, -1))
        for k in range(3):
            a, b, across = made[n, k], made[n, (k + 1) % 3], -1
            for i in range(size):
                if link[i] == a and link[(i + 1) % size] == b:
                    across = outer[i]
            for half in range(3 * n):
                i, j = half // 3, half % 3
                if made[i, j] == b and made[i, (j + 1) % 3] == a:
                    across = 3 * star[i] + j
            opposite[3 * t + k] = across
            if across >= 0:
                opposite[across] = 3 * t + k
        lists.fresh[t] = lists.unseen[t] = True
    for t in star[size - 2 : size]:
        write_triangle(corner, opposite, t, (v, v, v), (-1, -1, -1))


@kernel
def settle(
    net: Net, lists: Lists, holes: Holes, count: int, bad: NDArray[np.bool_]
) -> tuple[int, Ints, NDArray[np.bool_]]:
    """Put back what was in holes with a bad triangle; close the ranks behind the others.

    Parameters
    ----------
    bad : (count,) triangles that must not stay

    Returns
    -------
    count : of triangles
    order : (count,) the number that each had
    back : (old count,) triangles put back
    """
    back, dead = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    for h in range(len(holes.vertex)):
        size = holes.size[h]
        star = holes.star[h, :size]
        if bad[star[: size - 2]].any():
            _put_back(net, lists, holes, h)
            back[star] = True
            continue
        v = holes.vertex[h]
        lists.weight[v], net.must[v] = np.inf, False
        lists.after[v] = orphaned(lists.head, lists.after, star, size)
        assign(net, lists, v, star, size - 2, -1)
        dead[star[size - 2]] = dead[star[size - 1]] = True
    order = np.arange(count)
    t = 0
    while t < count:
        if dead[t]:
            count -= 1
            dead[t], order[t] = dead[count], order[count]
            _move(net, lists, count, t)
        else:
            t += 1
    return count, order[:count], back


@kernel
def _put_back(net: Net, lists: Lists, holes: Holes, h: int) -> None:
    """Write a vertex's triangles as they were."""
    v, size = holes.vertex[h], holes.size[h]
    star, link, outer = holes.star[h], holes.link[h], holes.outer[h]
    for n in range(size):
        before, after = star[n - 1 if n else size - 1], star[(n + 1) % size]
        corners = v, link[n], link[(n + 1) % size]
        across = 3 * before + 2, outer[n], 3 * after
        write_triangle(net.corner, net.opposite, star[n], corners, across)
        lists.fresh[star[n]] = lists.unseen[star[n]] = False


@inlined
def _move(net: Net, lists: Lists, last: int, t: int) -> None:
    """Give the last triangle the number of one that is no more."""
    corner, opposite = net.corner, net.opposite
    for k in range(3):
        corner[t, k], opposite[3 * t + k] = corner[last, k], opposite[3 * last + k]
        if opposite[3 * t + k] >= 0:
            opposite[opposite[3 * t + k]] = 3 * t + k
    lists.head[t], lists.candidate[t] = lists.head[last], lists.candidate[last]
    lists.worst[t] = lists.worst[last]
    lists.fresh[t], lists.unseen[t] = lists.fresh[last], lists.unseen[last]
    lists.head[last], lists.candidate[last], lists.worst[last] = -1, -1, -1.0
    lists.fresh[last] = lists.unseen[last] = True
