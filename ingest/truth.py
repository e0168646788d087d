# SPDX-License-Identifier: Apache-2.0
"""What a leaf's mesh is measured against: posts joined by triangles, placed in the cell.

A leaf that shows one source's posts takes those posts themselves; where the source has
none, the coarser sources fill in, post by post. A leaf much finer than its source (a
neighbour of a finer inset, or a cell at a pole) takes a lattice of its own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edge_m, edges_rad, grown, overlap
from ingest.filled import filled, missed_of
from ingest.lattice_gap import missed_between
from ingest.layer import Layer
from ingest.leaf_places import posts_inside, rim_crossings
from ingest.mosaic import Mosaic
from ingest.posts import column_row, point_at
from ingest.terrain_mesh import CORNERS, Places, snapped
from tiles import geodesy
from tiles.frames import Ecef, Floats
from tiles.kernels import kernel
from tiles.mesh import UV_ONE

FIT_SIDE = 5
OWN_LATTICE, SMOOTH_LATTICE, NEXT_TO_NONE = 128, 32, 1 / 64
"""Squares along an edge of a cell that takes a lattice of its own, at first; fewer if so
little of what may be missed is missed: at sea"""
FINEST_LATTICE, MOST_PARTS, MOST_MISSED = 512, 4, 1 / 1024
"""It is made finer, up to so many, until it misses at most this share of the edge: a
quarter of what the cells above may be off by. So are posts beside which others fill in."""
WORST_FIT_POSTS = 0.02
MOST_POSTS = 400_000


@dataclass(frozen=True, slots=True)
class Truth:
    """Posts over one cell and the triangles between them."""

    cell: int
    centre: Ecef
    points: NDArray[np.float32]
    """(h, w, 3) m around `centre`, ECEF axes"""
    uv: Floats
    """(h, w, 2) fractions of the cell, east and north; some lie outside"""
    grid: Floats
    """(2, 6) column and row as polynomials 1, u, v, uu, uv, vv"""
    slack_m: float
    """How far the surface that the posts stand for may be from their triangles"""
    missed_m: float
    """the part of it that a finer mesh of these posts can't cure"""
    low_m: float
    high_m: float


@dataclass(frozen=True, slots=True)
class Window:
    """Columns and rows of a source's posts around a cell."""

    layer: Layer
    left: int
    top: int
    right: int
    bottom: int
    fit: Floats
    """`grid` of `Truth`"""
    misfit_posts: float
    """Largest error of the fit"""


def truth_of(mosaic: Mosaic, cell: int, side: int, least: int = OWN_LATTICE) -> Truth:
    """Find what a leaf stands for.

    Parameters
    ----------
    side : posts that a leaf holds along an edge, about
    least : squares along an edge of its own lattice, where it is not smooth
    """
    window = _window(mosaic, cell, side)
    if window is None:
        return _own_lattice(mosaic, cell, max(least, OWN_LATTICE))
    box, parts = (window.left, window.top, window.right, window.bottom), 1
    while True:
        grid = filled(mosaic, window.layer, box, parts)
        lon, lat, heights, _ = grid
        missed_m = missed_of(mosaic, window.layer, *grid) if len(mosaic.layers) > 1 else 0.0
        over_pole = np.abs(lat).max() > np.pi / 2
        if missed_m <= edge_m(cell) * MOST_MISSED or parts == MOST_PARTS or over_pole:
            break
        parts *= 2
    spacing_m = window.layer.spacing_m
    slack_m = bulge_m(spacing_m) + window.misfit_posts * spacing_m
    ecef = geodesy.to_ecef(lon, lat, heights)
    if _close_over_poles(mosaic, lat, ecef):
        slack_m *= 2
    slack = slack_m + missed_m, missed_m
    return _placed(cell, (lon, lat, heights), ecef, window.fit * parts, slack)


def bulge_m(spacing_m: float) -> float:
    """Return how far the ellipsoid is from the triangles between posts on it."""
    return spacing_m**2 * 2.24 / (8 * 6.33e6)


def post_count(layer: Layer, cell: int) -> float:
    """Return about how many columns times rows of a source's posts a cell spans."""
    lon, lat = grid_places(cell, 8)
    col, row = layer.pixels(lon.ravel(), lat.ravel())
    return float(np.ptp(col) * np.ptp(row))


def _close_over_poles(mosaic: Mosaic, lat: Floats, ecef: Ecef) -> bool:
    """Put a row of posts beyond a pole where the surface goes through the pole itself.

    The pole lies half a post beyond the last row, so such a post is the last row's,
    mirrored at the pole. Says whether there is such a row.
    """
    closed = False
    for row, beside in ((0, 1), (-1, -2)):
        if abs(lat[row, 0]) > np.pi / 2:
            pole = np.array([np.copysign(np.pi / 2, lat[row, 0])])
            height_m = mosaic.heights(np.zeros(1), pole, 0.0)
            ecef[row] = 2 * geodesy.to_ecef(np.zeros(1), pole, height_m) - ecef[beside]
            closed = True
    return closed


def _window(mosaic: Mosaic, cell: int, side: int) -> Window | None:
    """Choose the finest source with posts in a cell, if the cell is made of its posts."""
    step_m = edge_m(cell) / side
    for layer in reversed(mosaic.layers):
        if layer.holds(list(edges_rad(cell))):
            return _posts_around(layer, cell) if layer.spacing_m < 3 * step_m else None
        if overlap(cell, grown(layer.bounds_deg, mosaic.reach_m(layer))):
            # Here a finer source bends the coarser ones between their posts.
            return None
    return None


def _posts_around(layer: Layer, cell: int) -> Window | None:
    lon, lat = grid_places(cell, 8)
    col, row = layer.pixels(lon.ravel(), lat.ravel())
    if not (np.isfinite(col).all() and np.isfinite(row).all()):
        return None
    left, top = int(np.floor(col.min())), int(np.floor(row.min()))
    right, bottom = int(np.floor(col.max())) + 2, int(np.floor(row.max())) + 2
    if (right - left) * (bottom - top) > MOST_POSTS:
        return None
    if layer.is_projected:
        fit = _fit(layer, left, top, cell)
        misfit_posts = _misfit_posts(layer, fit, (left, top), cell)
    else:
        fit, misfit_posts = _straight(np.stack([col - left, row - top]).reshape(2, 9, 9))
    if misfit_posts >= WORST_FIT_POSTS:
        return None
    return Window(layer, left, top, right, bottom, fit, misfit_posts)


def grid_places(cell: int, side: int) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes of a lattice over a cell, (side + 1, side + 1)."""
    west, south, east, north = edges_rad(cell)
    steps = np.arange(side + 1) / side
    lon, lat = np.meshgrid(west + steps * (east - west), south + steps * (north - south))
    return lon, lat


def terms(u: Floats, v: Floats) -> Floats:
    """Return 1, u, v, uu, uv, vv: (6, n)."""
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v])


def _straight(known: Floats) -> tuple[Floats, float]:
    """Return a linear fit through three corners of a lattice, and its largest error.

    Parameters
    ----------
    known : (2, n, n) columns and rows, of a source in longitude and latitude
    """
    fit = np.zeros((2, 6))
    fit[:, 0] = known[:, 0, 0]
    fit[:, 1:3] = np.stack([known[:, 0, -1], known[:, -1, 0]], axis=1) - fit[:, :1]
    # Rounding must not bend it.
    fit[np.abs(fit) < 1e-9] = 0.0
    steps = np.linspace(0.0, 1.0, known.shape[1])
    start, east, north = fit[:, :3].T[:, :, None, None]
    found = start + east * steps + north * steps[:, None]
    return fit, float(np.abs(found - known).max())


def _fit(layer: Layer, left: int, top: int, cell: int) -> Floats:
    """Fit columns and rows from the first ones on to fractions of the cell, (2, 6)."""
    lon, lat = grid_places(cell, FIT_SIDE - 1)
    col, row = layer.pixels(lon.ravel(), lat.ravel())
    known = np.stack([col - left, row - top])
    u, v = np.meshgrid(*[np.linspace(0, 1, FIT_SIDE)] * 2)
    found = np.linalg.lstsq(terms(u.ravel(), v.ravel()).T, known.T, rcond=None)[0].T
    return np.ascontiguousarray(found)


def _misfit_posts(layer: Layer, fit: Floats, first: tuple[int, int], cell: int) -> float:
    """Largest error of a fit, in posts."""
    side = 2 * FIT_SIDE
    lon, lat = grid_places(cell, side)
    col, row = layer.pixels(lon.ravel(), lat.ravel())
    u, v = np.meshgrid(*[np.linspace(0, 1, side + 1)] * 2)
    found = fit @ terms(u.ravel(), v.ravel())
    return float(np.abs(found - np.stack([col - first[0], row - first[1]])).max())


def _own_lattice(mosaic: Mosaic, cell: int, least: int) -> Truth:
    """Sample a cell on a lattice that misses little; between its posts to know how much."""

    def surface(lon: Floats, lat: Floats) -> Floats:
        return mosaic.heights(lon, lat, 0.0)

    side, most_m = SMOOTH_LATTICE, edge_m(cell) * MOST_MISSED
    lon, lat = grid_places(cell, side)
    heights = surface(lon.ravel(), lat.ravel()).reshape(lon.shape)
    while True:
        missed_m = missed_between(surface, lon, lat, heights)
        slack_m = missed_m + bulge_m(edge_m(cell) / side)
        enough = slack_m <= NEXT_TO_NONE * most_m
        if enough or side == FINEST_LATTICE or (side >= least and missed_m <= most_m):
            break
        side *= 2
        lon, lat = grid_places(cell, side)
        known, heights = heights, np.full(lon.shape, np.nan)
        heights[::2, ::2] = known
        new = np.isnan(heights)
        heights[new] = surface(lon[new], lat[new])
    grid = np.zeros((2, 6))
    grid[0, 1] = grid[1, 2] = side
    ecef = geodesy.to_ecef(lon, lat, heights)
    return _placed(cell, (lon, lat, heights), ecef, grid, (slack_m, 0.0))


def _placed(
    cell: int,
    places: tuple[Floats, Floats, Floats],
    ecef: Ecef,
    grid: Floats,
    slack_m: tuple[float, float],
) -> Truth:
    lon, lat, height_m = places
    west, south, east, north = edges_rad(cell)
    middle = (west + east) / 2
    turned = middle + (lon - middle + np.pi) % (2 * np.pi) - np.pi
    uv = np.stack([(turned - west) / (east - west), (lat - south) / (north - south)], -1)
    centre = ecef[ecef.shape[0] // 2, ecef.shape[1] // 2].copy()
    # On the cell's edges the surface is between posts inside and outside.
    pad = 1e-9 + np.maximum(*(np.abs(np.diff(uv, axis=k)).max(axis=(0, 1)) for k in (0, 1)))
    inside = height_m[((uv >= -pad) & (uv <= 1 + pad)).all(axis=-1)]
    low_m, high_m = (inside.min(), inside.max()) if inside.size else (np.inf, -np.inf)
    points = np.ascontiguousarray(ecef - centre, np.float32)
    return Truth(
        cell, Ecef(centre), points, uv, grid, *slack_m, float(low_m), float(high_m)
    )


@kernel
def _points_at(points: NDArray[np.float32], grid: Floats, uv: Floats) -> Floats:
    out = np.empty((len(uv), 3))
    for i in range(len(uv)):
        x, y = column_row(grid, uv[i, 0], uv[i, 1])
        out[i] = point_at(points, x, y)
    return out


def points_at(truth: Truth, uv: Floats) -> Floats:
    """Return the surface at fractions (n, 2) of the cell, (n, 3) m around its centre."""
    return _points_at(truth.points, truth.grid, np.ascontiguousarray(uv))


def places_of(truth: Truth) -> Places:
    """Return what a mesh of the cell may use as vertices.

    These are the cell's corners, the places where its edges cross lines between posts, and
    the posts inside.
    """
    inside = posts_inside(truth.uv)
    at = snapped(np.concatenate([CORNERS, rim_crossings(truth.grid), inside]))
    points = points_at(truth, at / UV_ONE) + truth.centre
    (x_u, x_v), (y_u, y_v) = truth.grid[:, 1:3].tolist()
    # A step along a diagonal of posts is y_v - x_v to the east and x_u - y_u to the north.
    lean = 1 if (y_v - x_v) * (x_u - y_u) < 0 else -1
    return Places.of(at, points, lean)
