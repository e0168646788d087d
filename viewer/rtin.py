# SPDX-License-Identifier: Apache-2.0
"""Right-triangulated irregular networks of a square lattice, as the literature has them.

Evans, Kirkpatrick, Townsend, "Right-Triangulated Irregular Networks", Algorithmica 30,
2001. Errors go up from the smallest triangles to the two largest in one pass over all
triangles, as in Mapbox's martini (2019). The bound holds at the lattice's posts, edge
by edge; between posts, and summed over levels, nothing is promised.
"""

import numpy as np

from tiles.frames import Ecef, Floats, Ints
from tiles.kernels import inlined, kernel

DEEPEST = 64


def rtin(points: Ecef, up: Floats, side: int, bound_m: float) -> Ints:
    """Return the triangles of a lattice, counter-clockwise.

    Parameters
    ----------
    points : ((side + 1) squared, 3) row by row from the south, west to east
    up : of the same shape
    side : cells along an edge, a power of 2
    bound_m : how far a post may be from the middle of the edge that leaves it out

    Returns
    -------
    (t, 3) rows of `points`
    """
    return split(errors_of(points, up, side), side, bound_m)


@kernel
def errors_of(points: Ecef, up: Floats, side: int) -> Floats:
    """Return for each post what leaving it, and all below it, out costs, m."""
    n = side + 1
    errors = np.zeros(n * n)
    whole = 2 * side * side - 2
    parents = whole - side * side
    for i in range(whole - 1, -1, -1):
        ax, ay, bx, by, cx, cy = _corners(i + 2, side)
        a, b, m = ay * n + ax, by * n + bx, (ay + by) // 2 * n + (ax + bx) // 2
        away = 0.0
        for k in range(3):
            away += up[m, k] * (points[m, k] - (points[a, k] + points[b, k]) / 2)
        errors[m] = max(errors[m], abs(away))
        if i < parents:
            left = (ay + cy) // 2 * n + (ax + cx) // 2
            right = (by + cy) // 2 * n + (bx + cx) // 2
            errors[m] = max(errors[m], errors[left], errors[right])
    return errors


@inlined
def _corners(code: int, side: int) -> tuple[int, int, int, int, int, int]:
    """Return a triangle of the binary tree: its long edge from a to b, and c."""
    ax, ay, bx, by, cx, cy = 0, 0, 0, 0, 0, 0
    if code & 1:
        bx, by, cx = side, side, side
    else:
        ax, ay, cy = side, side, side
    code >>= 1
    while code > 1:
        mx, my = (ax + bx) // 2, (ay + by) // 2
        if code & 1:
            bx, by, ax, ay = ax, ay, cx, cy
        else:
            ax, ay, bx, by = bx, by, cx, cy
        cx, cy = mx, my
        code >>= 1
    return ax, ay, bx, by, cx, cy


@kernel
def split(errors: Floats, side: int, bound_m: float) -> Ints:
    """Halve triangles whose long edge's middle errs by more than the bound."""
    n = side + 1
    found, count = np.empty((2 * side * side, 3), np.int64), 0
    stack = np.empty((DEEPEST, 6), np.int64)
    stack[0], stack[1], top = (0, 0, side, side, side, 0), (side, side, 0, 0, 0, side), 2
    while top:
        top -= 1
        ax, ay, bx, by, cx, cy = stack[top]
        mx, my = (ax + bx) // 2, (ay + by) // 2
        if abs(ax - cx) + abs(ay - cy) > 1 and errors[my * n + mx] > bound_m:
            stack[top] = (cx, cy, ax, ay, mx, my)
            stack[top + 1] = (bx, by, cx, cy, mx, my)
            top += 2
        else:
            found[count] = (ay * n + ax, cy * n + cx, by * n + bx)
            count += 1
    return found[:count].copy()
