# SPDX-License-Identifier: Apache-2.0
"""How far a drawn surface is from the surface that it stands for: measured, in ECEF.

The distance of a place is that between the two points with its longitude and latitude,
which is never less than the distance between the surfaces there.
"""

import numpy as np
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.terrain_mesh import Surface
from tiles.frames import Floats
from tiles.geodesy import ecef_of
from tiles.kernels import kernel


def deviation_m(
    surface: Surface, window: tuple[float, float, float], truth: Floats
) -> float:
    """Largest distance of a surface from true points on a lattice.

    Parameters
    ----------
    surface : of a cell that contains the lattice
    window : (u, v, size) of the lattice in that cell, fractions of it
    truth : (n, n, 3) float64, ECEF m, row 0 south; covers the window edge to edge
    """
    local = np.ascontiguousarray(truth - surface.mesh.centre)
    at = (surface.uv - np.array(window[:2])) / window[2] * (truth.shape[0] - 1)
    return float(np.sqrt(_lattice(surface.points, at, surface.triangles, local)))


@kernel
def _lattice(
    points: Floats, at: Floats, triangles: NDArray[np.int64], truth: Floats
) -> float:
    """Largest squared distance over the lattice posts that each triangle covers."""
    last, worst = truth.shape[0] - 1, 0.0
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        ax, ay, bx, by, cx, cy = at[a, 0], at[a, 1], at[b, 0], at[b, 1], at[c, 0], at[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        slack = -1e-9 * area
        for y in range(max(0, np.ceil(min(ay, by, cy))), min(last, max(ay, by, cy)) + 1):
            for x in range(
                max(0, np.ceil(min(ax, bx, cx))), min(last, max(ax, bx, cx)) + 1
            ):
                w0 = (bx - x) * (cy - y) - (by - y) * (cx - x)
                w1 = (cx - x) * (ay - y) - (cy - y) * (ax - x)
                w2 = area - w0 - w1
                if w0 < slack or w1 < slack or w2 < slack:
                    continue
                squared = 0.0
                for k in range(3):
                    flat = (
                        w0 * points[a, k] + w1 * points[b, k] + w2 * points[c, k]
                    ) / area
                    squared += (flat - truth[y, x, k]) ** 2
                worst = max(worst, squared)
    return worst


def overlay_deviation_m(surface: Surface, layer: Layer, lon_lat: Floats) -> float | None:
    """Largest distance of a surface from one source's own triangles, over all of it.

    Two piecewise linear surfaces differ most at a vertex of their overlay: at the
    mesh's vertices, at the source's posts, or where their edges cross. All are visited.

    Parameters
    ----------
    lon_lat : (v, 2) float64, rad, places of the surface's vertices

    Returns
    -------
    None where the source doesn't cover the whole surface.
    """
    col, row = layer.pixels(lon_lat[:, 0], lon_lat[:, 1])
    found = layer.post_heights(col, row)
    if found is None:
        return None
    window, left, top = found
    at = np.stack([col - left, row - top], axis=1)
    centre = surface.mesh.centre
    squared = _overlay(surface.points, at, lon_lat, surface.triangles, window, centre)
    sagitta = layer.spacing_m**2 / (4 * 6.3e6)
    return float(np.sqrt(squared)) + sagitta if np.isfinite(squared) else None


@kernel
def _height_at(window: Floats, x: float, y: float) -> float:
    """Height in the source's triangles; the diagonal runs to larger row and column."""
    c = min(max(int(np.floor(x)), 0), window.shape[1] - 2)
    r = min(max(int(np.floor(y)), 0), window.shape[0] - 2)
    fx, fy = x - c, y - r
    corner = window[r, c + 1] if fx > fy else window[r + 1, c]
    return float(
        (1.0 - max(fx, fy)) * window[r, c]
        + abs(fx - fy) * corner
        + min(fx, fy) * window[r + 1, c + 1]
    )


@kernel
def _gap(
    weights: tuple[float, float, float],
    ids: tuple[int, int, int],
    points: Floats,
    at: Floats,
    lon_lat: Floats,
    window: Floats,
    centre: Floats,
) -> float:
    """Squared distance between mesh and source at barycentric weights of a triangle."""
    x = y = lon = lat = 0.0
    for k in range(3):
        x += weights[k] * at[ids[k], 0]
        y += weights[k] * at[ids[k], 1]
        lon += weights[k] * lon_lat[ids[k], 0]
        lat += weights[k] * lon_lat[ids[k], 1]
    true = ecef_of(lon, lat, _height_at(window, x, y))
    squared = 0.0
    for axis in range(3):
        flat = centre[axis]
        for k in range(3):
            flat += weights[k] * points[ids[k], axis]
        squared += (flat - true[axis]) ** 2
    return squared


@kernel
def _overlay(
    points: Floats,
    at: Floats,
    lon_lat: Floats,
    triangles: NDArray[np.int64],
    window: Floats,
    centre: Floats,
) -> float:
    worst = 0.0
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        ids = (a, b, c)
        ax, ay, bx, by, cx, cy = at[a, 0], at[a, 1], at[b, 0], at[b, 1], at[c, 0], at[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        for y in range(np.ceil(min(ay, by, cy)), int(np.floor(max(ay, by, cy))) + 1):
            for x in range(np.ceil(min(ax, bx, cx)), int(np.floor(max(ax, bx, cx))) + 1):
                w0 = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                w1 = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                if w0 >= 0 and w1 >= 0 and w0 + w1 <= 1:
                    weights = (w0, w1, 1 - w0 - w1)
                    gap = _gap(weights, ids, points, at, lon_lat, window, centre)
                    worst = max(worst, gap)
        for k in range(3):
            p, q = ids[k], ids[(k + 1) % 3]
            for family in range(3):
                # Lines of the source's lattice: columns, rows, and diagonals x - y = n.
                s = (
                    at[p, 0]
                    if family == 0
                    else at[p, 1]
                    if family == 1
                    else at[p, 0] - at[p, 1]
                )
                e = (
                    at[q, 0]
                    if family == 0
                    else at[q, 1]
                    if family == 1
                    else at[q, 0] - at[q, 1]
                )
                for n in range(int(np.ceil(min(s, e))), int(np.floor(max(s, e))) + 1):
                    f = (n - s) / (e - s) if e != s else 0.0
                    along = (
                        (1 - f, f, 0.0)
                        if k == 0
                        else (0.0, 1 - f, f)
                        if k == 1
                        else (f, 0.0, 1 - f)
                    )
                    gap = _gap(along, ids, points, at, lon_lat, window, centre)
                    worst = max(worst, gap)
        for k in range(3):
            one = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
            worst = max(worst, _gap(one, ids, points, at, lon_lat, window, centre))
    return worst
