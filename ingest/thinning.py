# SPDX-License-Identifier: Apache-2.0
"""Take out vertices that a bound does not need.

Insertion never looks back: many a vertex is not needed any more once its neighbours are
there. Each is taken out if between its neighbours there is a fan of triangles that keeps
the bound at all points, and where its edges cross lines between posts.
"""

import numpy as np

from ingest.delaunay import Ints, Net, turn
from ingest.greedy import CORNERS, Lists, assign, off_rim, orphaned
from ingest.stars import MOST, drop, halves_from, star_of, write_fan
from ingest.upright import Ground, edge_gap, sag
from tiles.frames import Floats
from tiles.kernels import borrowing, inlined, kernel
from tiles.mesh import UV_ONE


@kernel
def thin(
    net: Net, lists: Lists, ground: Ground, count: int, size: int, bound_m: float
) -> int:
    """Take out vertices around fresh triangles; returns the count of triangles.

    Parameters
    ----------
    net : that measures along the vertical
    count, size : of triangles and of points
    """
    corner, opposite, fresh = net.corner, net.opposite, lists.fresh
    out = halves_from(corner, count, size)
    ring, outer = np.empty(2 * MOST + 2, np.int64), np.empty(2 * MOST + 2, np.int64)
    star = np.empty(MOST, np.int64)
    for p in range(size - 1, CORNERS - 1, -1):  # places between posts first
        if out[p] < 0 or net.must[p]:
            continue
        n, m = star_of(corner, opposite, out[p], ring, outer, star)
        new = False
        for s in range(m):
            new = new or fresh[star[s]]
        j = _best_fan(net, lists, ground, (ring, n), (star, m), p, bound_m) if new else -1
        if j < 0:
            continue
        count = _take_out(net, lists, out, (ring, outer, star), (n, m), (p, j), count)
    return count


@borrowing
def _take_out(
    net: Net,
    lists: Lists,
    out: Ints,
    around: tuple[Ints, Ints, Ints],
    sizes: tuple[int, int],
    chosen: tuple[int, int],
    count: int,
) -> int:
    """Put a fan in the place of a vertex's star; returns the count of triangles.

    Parameters
    ----------
    out : of `halves_from`
    around, sizes : of `star_of`
    chosen : the vertex, and the one of the ring that the fan is around
    """
    corner, opposite = net.corner, net.opposite
    ring, outer, star = around
    (n, m), (p, j) = sizes, chosen
    orphans = orphaned(lists.head, lists.after, star, m)
    lists.after[p], lists.weight[p], out[p] = orphans, np.inf, -1
    write_fan(corner, opposite, ring, outer, star, n, j)
    assign(net, lists, p, star, n - 2, -1)
    for s in range(n - 2):
        lists.fresh[star[s]] = lists.unseen[star[s]] = True
        for k in range(3):
            out[corner[star[s], k]] = 3 * star[s] + k
    one, other = star[n - 2], star[m - 1]  # the same one on the rim
    count = drop(corner, opposite, lists, out, max(one, other), count)
    if one != other:
        count = drop(corner, opposite, lists, out, min(one, other), count)
    return count


@inlined
def _turns_left(at: Ints, ring: Ints, n: int, j: int) -> bool:
    """Say whether all triangles of a fan have an area."""
    left = True
    for i in range(1, n - 1):
        left = left and turn(at, ring[j], ring[j + i], ring[j + i + 1]) > 0
    return left


@inlined
def _gap_over(
    at: Ints,
    points: Floats,
    high_m: Floats,
    twice_m: float,
    ring: Ints,
    fan: tuple[int, int],
    q: int,
) -> float:
    """Return how far a point in a ring is from a fan around vertex j of n, m.

    Of a fan with a triangle without area the answer means nothing.
    """
    j, n = fan
    a = ring[j]
    x, y = at[a, 0], at[a, 1]
    east, north = at[q, 0] - x, at[q, 1] - y
    # Which triangle of the fan a point lies in, the edges from its middle say alone.
    w1 = (at[ring[j + 1], 1] - y) * east - (at[ring[j + 1], 0] - x) * north
    for i in range(1, n - 1):
        b, c = ring[j + i], ring[j + i + 1]
        w2, w1 = -w1, (at[c, 1] - y) * east - (at[c, 0] - x) * north
        if w1 < 0 or w2 < 0:
            continue
        w0 = turn(at, b, c, q)
        if at[q, 0] % UV_ONE == 0 or at[q, 1] % UV_ONE == 0:
            return float(np.sqrt(off_rim(points, (a, b, c), (w0, w1, w2), q)))
        part = 1.0 / (w0 + w1 + w2)
        f0, f1, f2 = w0 * part, w1 * part, w2 * part
        there = f0 * high_m[a] + f1 * high_m[b] + f2 * high_m[c]
        there -= f0 * f1 * sag(points, high_m, twice_m, a, b)
        there -= f1 * f2 * sag(points, high_m, twice_m, b, c)
        there -= f2 * f0 * sag(points, high_m, twice_m, c, a)
        return float(abs(there - high_m[q]))
    return np.inf


@borrowing
def _best_fan(
    net: Net,
    lists: Lists,
    ground: Ground,
    around: tuple[Ints, int],
    inside: tuple[Ints, int],
    p: int,
    bound_m: float,
) -> int:
    """Return around which vertex of a ring a fan is nearest to the truth, -1 for none."""
    at, points, high_m, middle = net.at, net.points, net.high_m, net.middle
    head, after = lists.head, lists.after
    truth, sags, grid = ground.high_m, ground.sags, ground.grid
    ring, n = around
    star, m = inside
    twice_m = 2.0 * np.sqrt(middle[0] ** 2 + middle[1] ** 2 + middle[2] ** 2)
    best_m, chosen = bound_m, -1
    for j in range(n):
        most = _gap_over(at, points, high_m, twice_m, ring, (j, n), p)
        if most > best_m or not _turns_left(at, ring, n, j):
            continue
        for i in range(2, n - 1):
            if most > best_m:
                break
            a, b = ring[j], ring[j + i]
            edge = a, b, sag(points, high_m, twice_m, a, b)
            most = max(most, edge_gap(at, high_m, truth, sags, grid, edge, best_m)[0])
        for s in range(m):
            q = head[star[s]]
            while q >= 0 and most <= best_m:
                most = max(most, _gap_over(at, points, high_m, twice_m, ring, (j, n), q))
                q = after[q]
        if most < best_m:
            best_m, chosen = most, j
    return chosen
