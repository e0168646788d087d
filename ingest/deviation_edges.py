# SPDX-License-Identifier: Apache-2.0
"""Visit the places where edges of a drawn surface cross the lines between posts."""

import numpy as np
from numpy.typing import NDArray

from ingest.crossings import crossed, inside
from ingest.distance import (
    Found,
    Mesh,
    Point,
    Posts,
    squared_gap,
    to_mesh,
    to_true_plane,
    to_true_surface,
    upright_gap,
)
from ingest.posts import column_row, point_at
from tiles.frames import Floats
from tiles.kernels import inlined, kernel

Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]


@kernel
def _edges(mesh: Mesh, grid: Floats, todo: Flags) -> tuple[Ints, Floats]:
    """List the edges to visit.

    Returns
    -------
    halves : (n,) half-edges, 3 t + k
    parts : (n, 6) the part of each in the leaf: its ends as fractions of the edge, column
        and row of the first, and of the other
    """
    at, xy, triangles, rim = mesh.at, mesh.xy, mesh.triangles, mesh.rim
    halves, parts = np.empty(triangles.size, np.int64), np.empty((triangles.size, 6))
    count = 0
    for half in range(triangles.size):
        t, k = half // 3, half % 3
        p, q = triangles[t, k], triangles[t, (k + 1) % 3]
        # Of two half-edges one is enough; those on the rim have no other.
        if not todo[t] or (p > q and not (rim[p] and rim[q])):
            continue
        u, v, du, dv = at[p, 0], at[p, 1], at[q, 0] - at[p, 0], at[q, 1] - at[p, 1]
        low, high = inside(u, v, at[q, 0], at[q, 1])
        if low > high:
            continue
        x0, y0, x1, y1 = xy[p, 0], xy[p, 1], xy[q, 0], xy[q, 1]
        if low > 0.0 or high < 1.0:
            x0, y0 = column_row(grid, u + low * du, v + low * dv)
            x1, y1 = column_row(grid, u + high * du, v + high * dv)
        halves[count] = half
        parts[count, 0], parts[count, 1], parts[count, 2] = low, high, x0
        parts[count, 3], parts[count, 4], parts[count, 5] = y0, x1, y1
        count += 1
    return halves[:count], parts[:count]


@kernel
def along_edges(mesh: Mesh, posts: Posts, todo: Flags, found: Found) -> None:
    """Compare where edges cross columns, rows and diagonals; on the rim, their ends too."""
    at, points, triangles, across = mesh.at, mesh.points, mesh.triangles, mesh.across
    heights, grid, middle = posts.points, posts.grid, mesh.middle
    squared, where = found.squared, found.uv
    halves, parts = _edges(mesh, grid, todo)
    rim, straight = mesh.rim, (grid[:, 3:] == 0.0).all()
    for i in range(len(halves)):
        t, k = halves[i] // 3, halves[i] % 3
        p, q = triangles[t, k], triangles[t, (k + 1) % 3]
        # A chord from one side to another is no part of the rim.
        beside = at[p, 0] == at[q, 0] or at[p, 1] == at[q, 1]
        on_rim = rim[p] and rim[q] and beside
        low, long = parts[i, 0], parts[i, 1] - parts[i, 0]
        for family in range(3 + int(on_rim)):
            start, end = crossed(family, parts, i)
            if abs(end - start) < 1e-9:
                continue
            first, last = int(np.ceil(min(start, end))), int(np.floor(max(start, end)))
            for n in range(first, last + 1):
                g = (n - start) / (end - start)
                f = low + g * long
                u, v = (
                    at[p, 0] + f * (at[q, 0] - at[p, 0]),
                    at[p, 1] + f * (at[q, 1] - at[p, 1]),
                )
                x = parts[i, 2] + g * (parts[i, 4] - parts[i, 2])
                y = parts[i, 3] + g * (parts[i, 5] - parts[i, 3])
                if not straight:
                    x, y = column_row(grid, u, v)
                true, flat = point_at(heights, x, y), _between(points, p, q, f)
                gap = squared_gap(flat, true)
                if gap > squared[t] and not on_rim:
                    upright = upright_gap(middle, flat, true)
                    if upright < 0.0:
                        upright = to_mesh(points, triangles, across, t, true)
                        if max(across[t, 0], across[t, 1], across[t, 2]) < 0:
                            off = to_true_plane(heights, x, y, flat, true)
                        else:
                            off = to_true_surface(heights, x, y, flat)
                        upright = max(upright, off)
                    gap = min(gap, upright)
                if gap > squared[t]:
                    squared[t], where[t, 0], where[t, 1] = gap, u, v


@inlined
def _between(points: Floats, p: int, q: int, f: float) -> Point:
    """Return the place on an edge."""
    return (
        points[p, 0] + f * (points[q, 0] - points[p, 0]),
        points[p, 1] + f * (points[q, 1] - points[p, 1]),
        points[p, 2] + f * (points[q, 2] - points[p, 2]),
    )
