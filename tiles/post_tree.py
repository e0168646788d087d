# SPDX-License-Identifier: Apache-2.0
"""A quadtree of balls over each source's chunks of posts.

A node's ball holds its triangles, and so does the shell between its lowest and highest
height; together they are tight for flat land seen from far and for steep land near by.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats, Ints
from tiles.kernels import kernel
from tiles.points import Point, dot, less, span_below
from tiles.post_chunks import SIDE, load, new_room, squares
from tiles.source_posts import Rasters

LEVELS = 32
X, Y, Z, RADIUS, LOW, HIGH = range(6)
FIRST, ROWS, COLS = range(3)
ROUNDING_M = 0.1
SHORTEST_RADIUS_M = 6.33e6
"""Less than the earth's smallest radius of curvature, for how far a flat triangle sinks."""


class PostTree(NamedTuple):
    """All sources' posts, and what finds them."""

    rasters: Rasters
    node: Floats
    """(n, 6) centre (ECEF m), radius (-1: nothing inside), lowest and highest height"""
    level: Ints
    """(sources, LEVELS, 3) first node, rows and columns; level 0 holds the chunks"""
    top: Ints
    """(sources,) the level that is one node, -1 for a source without a square"""


def build_tree(rasters: Rasters) -> PostTree:
    """Find the balls of all chunks and of the nodes above them."""
    count = len(rasters.shape)
    level, top = np.zeros((count, LEVELS, 3), np.int64), np.full(count, -1, np.int64)
    total = 0
    for source in range(count):
        rows, cols = (-(-n // SIDE) for n in squares(rasters, source))
        while rows > 0 and cols > 0:
            top[source] += 1
            level[source, top[source]] = total, rows, cols
            total += rows * cols
            if rows == cols == 1:
                break
            rows, cols = -(-rows // 2), -(-cols // 2)
    tree = PostTree(rasters, np.zeros((total, 6)), level, top)
    tree.node[:, RADIUS] = -1.0
    for source in range(count):
        if top[source] >= 0:
            _measure_chunks(tree, source, new_room())
            for one in range(1, int(top[source]) + 1):
                _join(tree.node, level[source, one - 1], level[source, one])
    return tree


@kernel
def _measure_chunks(tree: PostTree, source: int, room: Floats) -> None:
    first, rows, cols = tree.level[source, 0]
    for row in range(rows):
        for col in range(cols):
            high, wide = load(tree.rasters, source, row, col, (0.0, 0.0, 0.0), room)
            _measure(room, high, wide, tree.node[first + row * cols + col])


@kernel
def _measure(room: Floats, high: int, wide: int, node: NDArray[np.float64]) -> None:
    """Find the ball and the shell of the triangles in one chunk."""
    used = np.zeros((SIDE + 1, SIDE + 1), np.bool_)
    edge = _mark(room, high, wide, used)
    count, low, top, reach = 0, np.inf, -np.inf, 0.0
    for r, c in np.argwhere(used):
        count += 1
        node[:3] += room[r, c, :3]
        low, top = min(low, room[r, c, 3]), max(top, room[r, c, 3])
    if not count:
        return
    node[:3] /= count
    for r, c in np.argwhere(used):
        reach = max(reach, _apart(room[r, c], node))
    node[RADIUS] = math.sqrt(reach) + ROUNDING_M
    node[LOW] = low - edge / (6.0 * SHORTEST_RADIUS_M) - ROUNDING_M
    node[HIGH] = top + ROUNDING_M


@kernel
def _mark(room: Floats, high: int, wide: int, used: NDArray[np.bool_]) -> float:
    """Mark the corners of triangles with data; returns their longest edge, squared."""
    edge = 0.0
    for r in range(high):
        for c in range(wide):
            for k in range(2):
                a, b, d = room[r, c], room[r + k, c + 1 - k], room[r + 1, c + 1]
                if not math.isnan(a[3] + b[3] + d[3]):
                    used[r, c] = used[r + k, c + 1 - k] = used[r + 1, c + 1] = True
                    edge = max(edge, _apart(a, b), _apart(b, d), _apart(a, d))
    return edge


@kernel
def _apart(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    x, y, z = float(a[0] - b[0]), float(a[1] - b[1]), float(a[2] - b[2])
    return x * x + y * y + z * z


@kernel
def _join(node: Floats, below: Ints, level: Ints) -> None:
    """Find the balls of a level from those of the level below."""
    for row in range(level[ROWS]):
        for col in range(level[COLS]):
            own = node[level[FIRST] + row * level[COLS] + col]
            rows = range(2 * row, min(2 * row + 2, below[ROWS]))
            cols = range(2 * col, min(2 * col + 2, below[COLS]))
            count, middle = 0, np.zeros(3)
            for r in rows:
                for c in cols:
                    child = node[below[FIRST] + r * below[COLS] + c]
                    if child[RADIUS] >= 0.0:
                        count += 1
                        middle += child[:3]
            if not count:
                continue
            own[:3] = middle / count
            own[LOW], own[HIGH] = np.inf, -np.inf
            for r in rows:
                for c in cols:
                    child = node[below[FIRST] + r * below[COLS] + c]
                    if child[RADIUS] >= 0.0:
                        reach = math.sqrt(_apart(child, own)) + child[RADIUS]
                        own[RADIUS] = max(own[RADIUS], reach)
                        own[LOW] = min(own[LOW], child[LOW])
                        own[HIGH] = max(own[HIGH], child[HIGH])


@kernel
def span_in_node(
    node: Floats, at: int, origin: Point, way: Point, low: float, high: float
) -> tuple[float, float]:
    """Return the part of a line's [low, high] that can meet the triangles of node `at`.

    Returns
    -------
    Empty (first > last) when no part can.
    """
    if node[at, RADIUS] < 0.0:
        return math.inf, -math.inf
    to = less((node[at, X], node[at, Y], node[at, Z]), origin)
    near = dot(to, way)
    beside = less(to, (near * way[0], near * way[1], near * way[2]))
    half = node[at, RADIUS] * node[at, RADIUS] - dot(beside, beside)
    if half < 0.0:
        return math.inf, -math.inf
    half = math.sqrt(half)
    low, high = max(low, near - half), min(high, near + half)
    if low > high:
        return low, high
    enter, leave = span_below(origin, way, node[at, HIGH])
    low, high = max(low, enter), min(high, leave)
    if low > high:
        return low, high
    enter, leave = span_below(origin, way, node[at, LOW])
    if enter < low < leave:
        low = leave
    if enter < high < leave:
        high = enter
    return low, high
