# SPDX-License-Identifier: Apache-2.0
"""How far a drawn surface is from the posts that it stands for: measured, in ECEF.

Two piecewise linear surfaces differ most at a vertex of their overlay: at the mesh's
vertices, at the posts, or where an edge of the mesh crosses a line between posts. All are
visited. There a leaf's height is compared with the true one. Of an inner cell, the shortest
distance of the true point from the mesh counts, and where an edge crosses also that of the
drawn point from the plane of the true triangle. On the rim, where neighbours must meet, it
is the distance of the two points with the same longitude and latitude.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.distance import (
    Mesh,
    Posts,
    both_ways,
    squared_gap,
    to_mesh,
    upright_gap,
)
from ingest.terrain_mesh import Surface
from ingest.truth import Truth, column_row, point_at, terms
from tiles.frames import Floats
from tiles.kernels import inlined, kernel


class Found(NamedTuple):
    """The largest distances so far."""

    squared: Floats
    uv: Floats


@dataclass(frozen=True, slots=True)
class Deviation:
    """Of every triangle of a surface, from one truth."""

    squared: Floats
    """(t,) m2"""
    uv: Floats
    """(t, 2) where, in fractions of the surface's cell"""
    truth: Truth

    @property
    def largest_m(self) -> float:
        """Return the largest distance, with what lies between the truth's posts."""
        return float(np.sqrt(self.squared.max(initial=0.0))) + self.truth.slack_m


def deviation_of(
    surface: Surface,
    window: tuple[float, float, float],
    truth: Truth,
    before: "tuple[Deviation, NDArray[np.int64]] | None" = None,
    *,
    upright: bool = False,
) -> Deviation:
    """Measure a surface against the truth of a leaf in its cell.

    Parameters
    ----------
    window : (u, v, size) of the leaf in the surface's cell, fractions of it
    before : what was found for an earlier surface, and for each triangle of this one the
        same triangle there, -1 for none: those are not measured again
    upright : measure along the vertical instead of the shortest way
    """
    low, size = np.array(window[:2]), window[2]
    offset = truth.centre - surface.mesh.centre
    count = len(surface.triangles)
    found = Found(np.zeros(count), np.zeros((count, 2)))
    todo = np.ones(count, np.bool_)
    if before:
        todo = before[1] < 0
        found.squared[~todo] = before[0].squared[before[1][~todo]]
        found.uv[~todo] = (before[0].uv[before[1][~todo]] - low) / size
    at = (surface.uv - low) / size
    xy = np.ascontiguousarray((truth.grid @ terms(*at.T)).T)
    rim = ((surface.uv == 0.0) | (surface.uv == 1.0)).any(axis=1)
    x, y, z = (float(one) * upright for one in truth.centre)
    points, triangles = surface.points - offset, surface.triangles
    mesh = Mesh(points, at, xy, triangles, rim, surface.across, (x, y, z))
    bend = 0.05 + float(np.abs(truth.grid[:, 3:]).sum())
    _measure(mesh, Posts(truth.points, truth.uv, truth.grid, bend), todo, found)
    return Deviation(found.squared, low + found.uv * size, truth)


def same_triangles(surface: Surface, before: Surface) -> NDArray[np.int64]:
    """Find the triangles that a surface shares with an earlier one of fewer places.

    Returns
    -------
    (t,) for each triangle the same one in the earlier surface, -1 where there is none
    """
    if surface.mesh.scale_m != before.mesh.scale_m:
        # All positions were rounded anew.
        return np.full(len(surface.triangles), -1)
    keys = [np.sort(one.used[one.triangles], axis=1) for one in (before, surface)]
    width = int(max(key.max() for key in keys)) + 1
    old, new = (key[:, 0] * width**2 + key[:, 1] * width + key[:, 2] for key in keys)
    order = np.argsort(old)
    at = order[np.minimum(np.searchsorted(old, new, sorter=order), len(old) - 1)]
    return np.asarray(np.where(old[at] == new, at, -1))


@kernel
def _measure(mesh: Mesh, posts: Posts, todo: NDArray[np.bool_], found: Found) -> None:
    """Visit those triangles that meet the leaf."""
    at, triangles = mesh.at, mesh.triangles
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        low_u = max(min(at[a, 0], at[b, 0], at[c, 0]), 0.0)
        high_u = min(max(at[a, 0], at[b, 0], at[c, 0]), 1.0)
        low_v = max(min(at[a, 1], at[b, 1], at[c, 1]), 0.0)
        high_v = min(max(at[a, 1], at[b, 1], at[c, 1]), 1.0)
        if not todo[t] or low_u > high_u or low_v > high_v:
            continue
        _over_posts(mesh, posts, found, t, (low_u, low_v, high_u, high_v))
        for k in range(3):
            p, q = triangles[t, k], triangles[t, (k + 1) % 3]
            # Of two half-edges one is enough; those on the rim have no other.
            if p < q or at[p, 0] == at[q, 0] or at[p, 1] == at[q, 1]:
                _along_edge(mesh, posts, found, t, (p, q))


@kernel
def _note(found: Found, t: int, squared: float, u: float, v: float) -> None:
    """Keep the larger of a triangle's distances, and where it is."""
    if squared > found.squared[t]:
        found.squared[t], found.uv[t, 0], found.uv[t, 1] = squared, u, v


@kernel
def _over_posts(
    mesh: Mesh,
    posts: Posts,
    found: Found,
    t: int,
    box: tuple[float, float, float, float],
) -> None:
    """Compare with the posts over one triangle."""
    at, points = mesh.at, mesh.points
    a, b, c = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
    ax, ay, bx, by, cx, cy = at[a, 0], at[a, 1], at[b, 0], at[b, 1], at[c, 0], at[c, 1]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area <= 0.0:
        return
    left, top, right, bottom = _window(mesh, posts, t, box)
    # Taken out of their tuples once: inside the loop each would be counted every time.
    places, heights, squared = posts.uv, posts.points, found.squared
    middle = mesh.middle
    for r in range(top, bottom + 1):
        for col in range(left, right + 1):
            u, v = places[r, col, 0], places[r, col, 1]
            if u < -1e-9 or u > 1.0 + 1e-9 or v < -1e-9 or v > 1.0 + 1e-9:
                continue
            w0 = ((bx - u) * (cy - v) - (by - v) * (cx - u)) / area
            w1 = ((cx - u) * (ay - v) - (cy - v) * (ax - u)) / area
            w2 = 1.0 - w0 - w1
            if w0 < -1e-9 or w1 < -1e-9 or w2 < -1e-9:
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
            if squared_gap(flat, true) > squared[t]:
                gap = upright_gap(middle, flat, true)
                if gap < 0.0:
                    gap = to_mesh(mesh, t, true)
                _note(found, t, gap, u, v)


@kernel
def _window(
    mesh: Mesh, posts: Posts, t: int, box: tuple[float, float, float, float]
) -> tuple[int, int, int, int]:
    """Return first and last columns and rows of the posts that may lie over a triangle."""
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    if box[0] > 0.0 and box[1] > 0.0 and box[2] < 1.0 and box[3] < 1.0:
        for k in range(3):
            p = mesh.triangles[t, k]
            x, y = mesh.xy[p, 0], mesh.xy[p, 1]
            left, right = min(left, x), max(right, x)
            top, bottom = min(top, y), max(bottom, y)
    else:
        for u in (box[0], box[2]):
            for v in (box[1], box[3]):
                x, y = column_row(posts.grid, u, v)
                left, right = min(left, x), max(right, x)
                top, bottom = min(top, y), max(bottom, y)
    rows, cols = posts.points.shape[0], posts.points.shape[1]
    return (
        max(0, int(np.ceil(left - posts.bend))),
        max(0, int(np.ceil(top - posts.bend))),
        min(cols - 1, int(np.floor(right + posts.bend))),
        min(rows - 1, int(np.floor(bottom + posts.bend))),
    )


@kernel
def _along_edge(
    mesh: Mesh, posts: Posts, found: Found, t: int, edge: tuple[int, int]
) -> None:
    """Compare where one edge crosses columns, rows and diagonals; on the rim, its ends."""
    at, xy, points, heights = mesh.at, mesh.xy, mesh.points, posts.points
    squared, grid, middle = found.squared, posts.grid, mesh.middle
    p, q = edge
    low, high = _inside(at[p, 0], at[p, 1], at[q, 0], at[q, 1])
    if low > high:
        return
    u0, v0, du, dv = at[p, 0], at[p, 1], at[q, 0] - at[p, 0], at[q, 1] - at[p, 1]
    x0, y0, x1, y1 = xy[p, 0], xy[p, 1], xy[q, 0], xy[q, 1]
    if low > 0.0 or high < 1.0:
        x0, y0 = column_row(grid, u0 + low * du, v0 + low * dv)
        x1, y1 = column_row(grid, u0 + high * du, v0 + high * dv)
    on_rim = mesh.rim[p] and mesh.rim[q]
    for start, end in ((x0, x1), (y0, y1), (x0 - y0, x1 - y1), (0.0, 1.0 * on_rim)):
        if abs(end - start) < 1e-9:
            continue
        first, last = int(np.ceil(min(start, end))), int(np.floor(max(start, end)))
        for n in range(first, last + 1):
            f = low + (n - start) / (end - start) * (high - low)
            u, v = u0 + f * du, v0 + f * dv
            x, y = column_row(grid, u, v)
            true = point_at(heights, x, y)
            flat = (
                points[p, 0] + f * (points[q, 0] - points[p, 0]),
                points[p, 1] + f * (points[q, 1] - points[p, 1]),
                points[p, 2] + f * (points[q, 2] - points[p, 2]),
            )
            gap = squared_gap(flat, true)
            if not on_rim and gap > squared[t]:
                upright = upright_gap(middle, flat, true)
                if upright < 0.0:
                    upright = both_ways(mesh, posts, t, (x, y), (flat, true))
                gap = min(gap, upright)
            if gap > squared[t]:
                squared[t], found.uv[t, 0], found.uv[t, 1] = gap, u, v


@inlined
def _inside(u0: float, v0: float, u1: float, v1: float) -> tuple[float, float]:
    """Return the part of an edge inside the leaf, fractions from start to end."""
    low, high = 0.0, 1.0
    if min(u0, v0, u1, v1) < 0.0 or max(u0, v0, u1, v1) > 1.0:
        for start, step in ((u0, u1 - u0), (v0, v1 - v0)):
            if step == 0.0:
                if start < 0.0 or start > 1.0:
                    high = -1.0
                continue
            one, other = -start / step, (1.0 - start) / step
            low, high = max(low, min(one, other)), min(high, max(one, other))
    return low, high
