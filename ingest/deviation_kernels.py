# SPDX-License-Identifier: Apache-2.0
"""Visit the places where a drawn surface and a true one differ most, triangle by triangle.

The helpers are inlined and take arrays, not the tuples that hold them: each time an array
is taken out of a tuple its references are counted, which took longer than the sums.
"""

import numpy as np
from numpy.typing import NDArray

from ingest.deviation_edges import along_edges
from ingest.distance import (
    Found,
    Mesh,
    Posts,
    squared_gap,
    to_mesh,
    upright_gap,
)
from ingest.posts import column_row
from tiles.frames import Floats
from tiles.kernels import inlined, kernel

Box = tuple[float, float, float, float]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]
Window = tuple[float, float, float]
OVER = -1e-9
"""Least weight of a corner at a place over a triangle"""
Drawn = tuple[Floats, Floats, Ints, Flags, Ints, Floats]
"""Of a surface: points, fractions of its cell, triangles, `rim`, `across`; its centre"""
Given = tuple[NDArray[np.float32], Floats, Floats, Floats, float]
"""Of a truth: points, fractions of its cell, `grid`; its centre, what it misses"""


@kernel
def add(
    known: tuple[Floats, Floats, Ints],
    fresh: Flags,
    drawn: Drawn,
    true: Given,
    window: Window,
    how: tuple[int, bool, bool],
) -> None:
    """Measure a surface's fresh triangles against a truth.

    Parameters
    ----------
    known : of `Gaps`
    window : of the truth in the surface
    how : number of the truth, whether to measure along the vertical, and along edges
    """
    far_m, uv, which = known
    points, at, triangles, rim, across, centre = drawn
    posts, places, grid, middle, slack_m = true
    number, upright, edges = how
    todo = fresh.copy()
    if not _only_in(todo, at, triangles, window):
        return
    there, inside_at, xy = _framed(
        (points, at, triangles), todo, centre - middle, window, grid
    )
    x, y, z = middle[0] * upright, middle[1] * upright, middle[2] * upright
    mesh = Mesh(there, inside_at, xy, triangles, rim, across, (x, y, z))
    bend = 0.05 + np.abs(grid[:, 3:]).sum()
    found = _beyond(far_m, todo, slack_m)
    _over_posts(mesh, Posts(posts, places, grid, bend), todo, found)
    if edges:
        along_edges(mesh, Posts(posts, places, grid, bend), todo, found)
    for t in range(len(far_m)):
        if not todo[t]:
            continue
        if found.squared[t] > max(far_m[t] - slack_m, 0.0) ** 2:
            which[t] = number
            far_m[t] = np.sqrt(found.squared[t]) + slack_m
            uv[t, 0] = window[0] + found.uv[t, 0] * window[2]
            uv[t, 1] = window[1] + found.uv[t, 1] * window[2]
        far_m[t] = max(far_m[t], slack_m)


@kernel
def _framed(
    surface: tuple[Floats, Floats, Ints],
    todo: Flags,
    offset: Floats,
    window: Window,
    grid: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Return a surface's vertices as seen from a leaf: see `Mesh`.

    Parameters
    ----------
    surface : points, fractions of the cell, triangles
    todo : triangles whose places are asked for; of other vertices only points are written
    """
    points, uv, triangles = surface
    there, at, xy = np.empty_like(points), np.empty_like(uv), np.empty_like(uv)
    asked = np.zeros(len(uv), np.bool_)
    for t in range(len(triangles)):
        if todo[t]:
            asked[triangles[t, 0]] = asked[triangles[t, 1]] = True
            asked[triangles[t, 2]] = True
    for i in range(len(uv)):
        for k in range(3):
            there[i, k] = points[i, k] + offset[k]
        if not asked[i]:
            continue
        at[i, 0], at[i, 1] = (
            (uv[i, 0] - window[0]) / window[2],
            (uv[i, 1] - window[1]) / window[2],
        )
        xy[i, 0], xy[i, 1] = column_row(grid, at[i, 0], at[i, 1])
    return there, at, xy


@kernel
def _only_in(todo: Flags, uv: Floats, triangles: Ints, window: Window) -> bool:
    """Leave out triangles that do not reach into a window; says whether one is left."""
    u, v, size = window
    left = False
    for t in range(len(triangles)):
        if todo[t]:
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            todo[t] = (
                min(uv[a, 0], uv[b, 0], uv[c, 0]) <= u + size
                and max(uv[a, 0], uv[b, 0], uv[c, 0]) >= u
                and min(uv[a, 1], uv[b, 1], uv[c, 1]) <= v + size
                and max(uv[a, 1], uv[b, 1], uv[c, 1]) >= v
            )
            left = left or todo[t]
    return left


@kernel
def _beyond(far_m: Floats, todo: Flags, slack_m: float) -> Found:
    """Begin with what is left of distances without a slack."""
    left = np.empty_like(far_m)
    for t in range(len(far_m)):
        if todo[t]:
            left[t] = max(far_m[t] - slack_m, 0.0) ** 2
    return Found(left, np.empty((len(far_m), 2)))


@kernel
def _over_posts(mesh: Mesh, posts: Posts, todo: Flags, found: Found) -> None:
    """Compare with the posts over each triangle."""
    at, points, triangles, xy = mesh.at, mesh.points, mesh.triangles, mesh.xy
    across = mesh.across
    places, heights, grid, bend = posts.uv, posts.points, posts.grid, posts.bend
    squared, where, middle = found.squared, found.uv, mesh.middle
    last_row, last_col = heights.shape[0] - 1, heights.shape[1] - 1
    for t in range(len(triangles)):
        if not todo[t]:
            continue
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, bx, by = at[a, 0], at[a, 1], at[b, 0], at[b, 1]
        cx, cy = at[c, 0], at[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area <= 0.0:
            continue
        left, top, right, bottom = _window(at, xy, grid, (a, b, c))
        left = max(0, int(np.ceil(left - bend)))
        right = min(last_col, int(np.floor(right + bend)))
        part, most = 1.0 / area, squared[t]
        first, last = max(0, int(np.ceil(top - bend))), int(np.floor(bottom + bend))
        for r in range(first, min(last_row, last) + 1):
            for col in range(left, right + 1):
                u, v = places[r, col, 0], places[r, col, 1]
                w0 = ((bx - u) * (cy - v) - (by - v) * (cx - u)) * part
                w1 = ((cx - u) * (ay - v) - (cy - v) * (ax - u)) * part
                w2 = 1.0 - w0 - w1
                if min(w0, w1, w2) < OVER or min(u, v) < OVER or max(u, v) > 1.0 - OVER:
                    continue
                flat = (
                    w0 * points[a, 0] + w1 * points[b, 0] + w2 * points[c, 0],
                    w0 * points[a, 1] + w1 * points[b, 1] + w2 * points[c, 1],
                    w0 * points[a, 2] + w1 * points[b, 2] + w2 * points[c, 2],
                )
                true = (
                    float(heights[r, col, 0]),
                    float(heights[r, col, 1]),
                    float(heights[r, col, 2]),
                )
                if squared_gap(flat, true) > most:
                    gap = upright_gap(middle, flat, true)
                    if gap < 0.0:
                        gap = to_mesh(points, triangles, across, t, true)
                    if gap > most:
                        most, squared[t] = gap, gap
                        where[t, 0], where[t, 1] = u, v


@inlined
def _window(at: Floats, xy: Floats, grid: Floats, corners: tuple[int, int, int]) -> Box:
    """Return least and largest columns and rows over a triangle's part in the leaf."""
    a, b, c = corners
    low_u, high_u = min(at[a, 0], at[b, 0], at[c, 0]), max(at[a, 0], at[b, 0], at[c, 0])
    low_v, high_v = min(at[a, 1], at[b, 1], at[c, 1]), max(at[a, 1], at[b, 1], at[c, 1])
    left, right = min(xy[a, 0], xy[b, 0], xy[c, 0]), max(xy[a, 0], xy[b, 0], xy[c, 0])
    top, bottom = min(xy[a, 1], xy[b, 1], xy[c, 1]), max(xy[a, 1], xy[b, 1], xy[c, 1])
    if min(low_u, low_v) <= 0.0 or max(high_u, high_v) >= 1.0:
        # Beyond the leaf its columns and rows are not to be trusted.
        west, south, east, north = (
            max(low_u, 0.0),
            max(low_v, 0.0),
            min(high_u, 1.0),
            min(high_v, 1.0),
        )
        x0, y0 = column_row(grid, west, south)
        x1, y1 = column_row(grid, east, south)
        x2, y2 = column_row(grid, west, north)
        x3, y3 = column_row(grid, east, north)
        left, right = min(x0, x1, x2, x3), max(x0, x1, x2, x3)
        top, bottom = min(y0, y1, y2, y3), max(y0, y1, y2, y3)
    return left, top, right, bottom
