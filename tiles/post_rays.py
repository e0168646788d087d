# SPDX-License-Identifier: Apache-2.0
"""Straight lines against a source's posts: float64, and none slips between triangles."""

import math

import numpy as np

from tiles.frames import Floats
from tiles.kernels import kernel
from tiles.points import Point, dot, height_and_up, less, span_below
from tiles.post_chunks import load
from tiles.post_tree import COLS, FIRST, RADIUS, ROWS, PostTree, X, Y, Z, span_in_node
from tiles.post_walk import Rooms, put

ACROSS_M = 2e4
"""Heights differ by less than this, so a plumb line of this length finds the surface."""


@kernel
def cast(
    tree: PostTree,
    source: int,
    origin: Point,
    way: Point,
    low: float,
    high: float,
    rooms: Rooms,
) -> float:
    """Return where a line, between two parameters, first meets a source; inf if nowhere."""
    posts, waiting, bound = rooms
    if tree.top[source] < 0:
        return math.inf
    best, count = math.inf, 1
    waiting[0, 0], waiting[0, 1], waiting[0, 2] = tree.top[source], 0, 0
    bound[0] = low
    while count:
        count -= 1
        if bound[count] >= min(best, high):
            continue
        one, row, col = waiting[count, 0], waiting[count, 1], waiting[count, 2]
        if one == 0:
            high_, wide = load(tree.rasters, source, row, col, origin, posts)
            best = min(best, _meet(posts, high_, wide, way, low, min(best, high)))
            continue
        below = tree.level[source, one - 1]
        start = count
        for r in range(2 * row, min(2 * row + 2, below[ROWS])):
            for c in range(2 * col, min(2 * col + 2, below[COLS])):
                at = below[FIRST] + r * below[COLS] + c
                enter, leave = span_in_node(
                    tree.node, at, origin, way, low, min(best, high)
                )
                if enter <= leave:
                    count = put(waiting, bound, start, count, (one - 1, r, c), enter)
    return best


@kernel
def _meet(
    posts: Floats, high: int, wide: int, way: Point, low: float, best: float
) -> float:
    """Return where a line through the origin first meets the triangles of a chunk.

    Posts are turned so that the line is an axis; neighbours then judge their common edge
    by the same numbers, and no line slips between them.
    """
    side = (0.0, way[2], -way[1]) if abs(way[0]) < 0.6 else (-way[2], 0.0, way[0])
    length = math.sqrt(dot(side, side))
    side = (side[0] / length, side[1] / length, side[2] / length)
    over = (
        way[1] * side[2] - way[2] * side[1],
        way[2] * side[0] - way[0] * side[2],
        way[0] * side[1] - way[1] * side[0],
    )
    for r in range(high + 1):
        for c in range(wide + 1):
            p = (posts[r, c, 0], posts[r, c, 1], posts[r, c, 2])
            posts[r, c, 0], posts[r, c, 1], posts[r, c, 2] = (
                dot(p, side),
                dot(p, over),
                dot(p, way),
            )
    found = math.inf
    for r in range(high):
        for c in range(wide):
            ax, ay = posts[r, c, 0], posts[r, c, 1]
            dx, dy = posts[r + 1, c + 1, 0], posts[r + 1, c + 1, 1]
            w1 = dx * ay - dy * ax
            for k in range(2):
                r1, c1 = r + k, c + 1 - k
                bx, by = posts[r1, c1, 0], posts[r1, c1, 1]
                w0, w2 = bx * dy - by * dx, ax * by - ay * bx
                total = w0 + w1 + w2
                inside = max(w0, w1, w2) <= 0.0 or min(w0, w1, w2) >= 0.0
                if inside and total != 0.0:
                    end = w1 * posts[r1, c1, 2] + w2 * posts[r + 1, c + 1, 2]
                    t = (w0 * posts[r, c, 2] + end) / total
                    if low <= t < best:
                        best = found = t
    return found


@kernel
def plumb(tree: PostTree, source: int, point: Point, rooms: Rooms) -> float:
    """Return how far above a point its source's surface is, m; inf without data there."""
    if tree.top[source] < 0:
        return math.inf
    at = tree.level[source, tree.top[source], FIRST]
    to = less((tree.node[at, X], tree.node[at, Y], tree.node[at, Z]), point)
    if dot(to, to) > (tree.node[at, RADIUS] + ACROSS_M) ** 2:
        return math.inf
    _, up = height_and_up(point)
    return cast(tree, source, point, up, -ACROSS_M, ACROSS_M, rooms)


@kernel
def ends_below(eye: Point, ways: Floats, height_m: float) -> Floats:
    """Return where rays go below a height, (n,) m; inf for those that never do."""
    out = np.empty(len(ways))
    for i in range(len(ways)):
        enter, _ = span_below(eye, (ways[i, 0], ways[i, 1], ways[i, 2]), height_m)
        out[i] = enter if enter >= 0.0 else math.inf
    return out
