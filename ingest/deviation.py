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
    """Largest distance of a surface from a lattice of true points joined by triangles.

    Both are piecewise linear in longitude and latitude, so they differ most at a post
    or where an edge of the surface crosses a line of the lattice; both are visited.

    Parameters
    ----------
    surface : of a cell that contains the lattice
    window : (u, v, size) of the lattice in that cell, fractions of it
    truth : (n, n, 3) float64, ECEF m, row 0 south; covers the window edge to edge
    """
    local = np.ascontiguousarray(truth - surface.mesh.centre)
    at = (surface.uv - np.array(window[:2])) / window[2] * (truth.shape[0] - 1)
    at_posts = _at_posts(surface.points, at, surface.triangles, local)
    at_crossings = _at_crossings(surface.points, at, surface.triangles, local)
    return float(np.sqrt(max(at_posts, at_crossings)))


@kernel
def _at_posts(
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


@kernel
def _line(family: int, at: Floats) -> float:
    """Return the column, row or diagonal x - y of a lattice at a place, not rounded."""
    if family == 0:
        return float(at[0])
    return float(at[1]) if family == 1 else float(at[0] - at[1])


@kernel
def _at_crossings(
    points: Floats, at: Floats, triangles: NDArray[np.int64], truth: Floats
) -> float:
    """Largest squared distance where edges cross lattice columns, rows and diagonals."""
    worst, last = 0.0, truth.shape[0] - 1
    for t in range(len(triangles)):
        for k in range(3):
            p, q = triangles[t, k], triangles[t, (k + 1) % 3]
            for family in range(3):
                s, e = _line(family, at[p]), _line(family, at[q])
                low = max(-last if family == 2 else 0, int(np.ceil(min(s, e))))
                for n in range(low, min(last, int(np.floor(max(s, e)))) + 1):
                    f = (n - s) / (e - s) if e != s else 0.0
                    x = at[p, 0] + f * (at[q, 0] - at[p, 0])
                    y = at[p, 1] + f * (at[q, 1] - at[p, 1])
                    if 0.0 <= x <= last and 0.0 <= y <= last:
                        worst = max(worst, _gap_at(points, p, q, f, truth, x, y))
    return worst


@kernel
def _gap_at(
    points: Floats, p: int, q: int, f: float, truth: Floats, x: float, y: float
) -> float:
    """Squared distance of the point a fraction f from p to q from the lattice at x, y."""
    c, r = min(int(x), truth.shape[1] - 2), min(int(y), truth.shape[0] - 2)
    fx, fy = x - c, y - r
    squared = 0.0
    for k in range(3):
        corner = truth[r, c + 1, k] if fx > fy else truth[r + 1, c, k]
        true = (
            (1.0 - max(fx, fy)) * truth[r, c, k]
            + abs(fx - fy) * corner
            + min(fx, fy) * truth[r + 1, c + 1, k]
        )
        squared += (points[p, k] + f * (points[q, k] - points[p, k]) - true) ** 2
    return squared


def overlay_deviation_m(surface: Surface, layer: Layer, lon_lat: Floats) -> float | None:
    """Largest distance of a surface from one source's own triangles, over all of it.

    Two piecewise linear surfaces differ most at a vertex of their overlay: at the
    mesh's vertices, at the source's posts, or where their edges cross. All are visited.
    Added is what is not linear: the bulge of the ellipsoid between posts, and the bend
    of the mesh's edges in the source's projection.

    Parameters
    ----------
    lon_lat : (v, 2) float64, rad, places of the surface's vertices

    Returns
    -------
    None where the source doesn't cover the whole surface.
    """
    own = layer.own_surface(lon_lat[:, 0], lon_lat[:, 1])
    if own is None:
        return None
    mesh = surface.points, own.at, lon_lat, surface.triangles
    squared = _overlay(*mesh, own.height_m, surface.mesh.centre)
    bulge_m = layer.spacing_m**2 / (4 * 6.3e6)
    bend_m = _bend_posts(surface, layer, lon_lat, own.at) * _steepest_m(own.height_m)
    return float(np.sqrt(squared)) + bulge_m + bend_m


def _bend_posts(surface: Surface, layer: Layer, lon_lat: Floats, at: Floats) -> float:
    """How far edges of the mesh bend in the source's lattice, in posts."""
    if not layer.is_projected:
        return 0.0
    ends = surface.triangles[:, [0, 1, 2, 1, 2, 0]].reshape(-1, 2, 3)
    a, b = ends[:, 0].ravel(), ends[:, 1].ravel()
    origin = np.stack(layer.pixels(*lon_lat[:1].T), axis=1)[0] - at[0]
    middle = np.stack(layer.pixels(*((lon_lat[a] + lon_lat[b]) / 2).T), axis=1) - origin
    off = np.hypot(*(middle - (at[a] + at[b]) / 2).T)
    # Inside a triangle a quadratic is off by up to 4/3 of that on its edges.
    return float(off.max() * 4 / 3)


def _steepest_m(height_m: Floats) -> float:
    """Largest change of height over one post's distance."""
    east, north = np.abs(np.diff(height_m, axis=1)), np.abs(np.diff(height_m, axis=0))
    return float(np.hypot(east.max(initial=0.0), north.max(initial=0.0)))


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
    """Largest squared distance over all vertices of the overlay."""
    worst = 0.0
    for t in range(len(triangles)):
        ids = (triangles[t, 0], triangles[t, 1], triangles[t, 2])
        worst = max(
            worst,
            _own_posts(ids, points, at, lon_lat, window, centre),
            _own_crossings(ids, points, at, lon_lat, window, centre),
        )
    return worst


@kernel
def _own_posts(
    ids: tuple[int, int, int],
    points: Floats,
    at: Floats,
    lon_lat: Floats,
    window: Floats,
    centre: Floats,
) -> float:
    """Largest squared distance over the source's posts in one triangle."""
    a, b, c = ids
    ax, ay, bx, by, cx, cy = at[a, 0], at[a, 1], at[b, 0], at[b, 1], at[c, 0], at[c, 1]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    worst = 0.0
    for y in range(np.ceil(min(ay, by, cy)), int(np.floor(max(ay, by, cy))) + 1):
        for x in range(np.ceil(min(ax, bx, cx)), int(np.floor(max(ax, bx, cx))) + 1):
            w0 = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
            w1 = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
            if w0 >= 0 and w1 >= 0 and w0 + w1 <= 1:
                weights = (w0, w1, 1 - w0 - w1)
                gap = _gap(weights, ids, points, at, lon_lat, window, centre)
                worst = max(worst, gap)
    return worst


@kernel
def _own_crossings(
    ids: tuple[int, int, int],
    points: Floats,
    at: Floats,
    lon_lat: Floats,
    window: Floats,
    centre: Floats,
) -> float:
    """Largest squared distance at a triangle's corners and where its edges cross lines."""
    worst = 0.0
    for k in range(3):
        p, q = ids[k], ids[(k + 1) % 3]
        for family in range(3):
            s, e = _line(family, at[p]), _line(family, at[q])
            # One step before the first line: the corner itself.
            for n in range(int(np.ceil(min(s, e))) - 1, int(np.floor(max(s, e))) + 1):
                f = (n - s) / (e - s) if e != s and n >= min(s, e) else 0.0
                weights = (1 - f, f, 0.0)
                if k == 1:
                    weights = (0.0, 1 - f, f)
                elif k == 2:
                    weights = (f, 0.0, 1 - f)
                gap = _gap(weights, ids, points, at, lon_lat, window, centre)
                worst = max(worst, gap)
    return worst
