# SPDX-License-Identifier: Apache-2.0
"""The shortest distance from points to a source's triangles: exact, near side first."""

import math

import numpy as np

from tiles.frames import Floats, Ints
from tiles.kernels import kernel
from tiles.points import Point, dot, height_and_up, less, nearest_on_triangle
from tiles.post_chunks import load
from tiles.post_tree import COLS, FIRST, HIGH, LOW, RADIUS, ROWS, PostTree, X, Y, Z
from tiles.post_walk import Rooms, new_rooms, put


@kernel
def nearest(
    tree: PostTree,
    source: int,
    point: Point,
    limit_m: float,
    enough_m: float,
    rooms: Rooms,
) -> tuple[float, Point]:
    """Return the shortest distance from a point to a source's surface.

    Parameters
    ----------
    limit_m : the search begins with this; it comes back when nothing is nearer
    enough_m : the search may end with any distance up to this

    Returns
    -------
    Distance in m, and the nearest point as seen from the point.
    """
    posts, waiting, bound = rooms
    best, found = limit_m, (0.0, 0.0, 0.0)
    if tree.top[source] < 0:
        return best, found
    height_m, _ = height_and_up(point)
    waiting[0, 0], waiting[0, 1], waiting[0, 2] = tree.top[source], 0, 0
    bound[0], count = 0.0, 1
    while count and best > enough_m:
        count -= 1
        if bound[count] >= best:
            continue
        one, row, col = waiting[count, 0], waiting[count, 1], waiting[count, 2]
        if one == 0:
            high, wide = load(tree.rasters, source, row, col, point, posts)
            best, found = _nearest_in(posts, high, wide, best, found)
            continue
        below = tree.level[source, one - 1]
        start = count
        for r in range(2 * row, min(2 * row + 2, below[ROWS])):
            for c in range(2 * col, min(2 * col + 2, below[COLS])):
                at = below[FIRST] + r * below[COLS] + c
                if tree.node[at, RADIUS] < 0.0:
                    continue
                to = less((tree.node[at, X], tree.node[at, Y], tree.node[at, Z]), point)
                away = math.sqrt(dot(to, to)) - tree.node[at, RADIUS]
                above = height_m - tree.node[at, HIGH]
                away = max(away, above, tree.node[at, LOW] - height_m)
                if away < best:
                    count = put(waiting, bound, start, count, (one - 1, r, c), away)
    return best, found


@kernel
def _nearest_in(
    posts: Floats, high: int, wide: int, best: float, found: Point
) -> tuple[float, Point]:
    """Look for a point of a chunk's triangles that is nearer to the origin."""
    for r in range(high):
        for c in range(wide):
            a = (posts[r, c, 0], posts[r, c, 1], posts[r, c, 2])
            d = (posts[r + 1, c + 1, 0], posts[r + 1, c + 1, 1], posts[r + 1, c + 1, 2])
            across = less(d, a)
            middle = (a[0] + d[0], a[1] + d[1], a[2] + d[2])
            for k in range(2):
                r1, c1 = (r + 1, c) if k else (r, c + 1)
                b = (posts[r1, c1, 0], posts[r1, c1, 1], posts[r1, c1, 2])
                # Not nearer than the ball around the diagonal and this corner allows.
                off = less((2.0 * b[0], 2.0 * b[1], 2.0 * b[2]), middle)
                reach = math.sqrt(max(dot(across, across), dot(off, off)))
                if not math.sqrt(dot(middle, middle)) - reach < 2.0 * best:
                    continue
                q = nearest_on_triangle(a, b, d)
                square = dot(q, q)
                if square < best * best:
                    best, found = math.sqrt(square), q
    return best, found


@kernel
def distances(
    tree: PostTree, points: Floats, owner: Ints, limit_m: Floats, enough_m: Floats
) -> Floats:
    """Return the shortest distance of each point to its owner's surface, (n,) m.

    Parameters
    ----------
    points : (n, 3) ECEF m
    owner : (n,) source of each, none below 0
    limit_m : (n,) upper bounds that are known
    enough_m : (n,) the search may end with any distance up to this
    """
    rooms = new_rooms()
    out = np.empty(len(points))
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        out[i], _ = nearest(tree, owner[i], point, limit_m[i], enough_m[i], rooms)
    return out
