# SPDX-License-Identifier: Apache-2.0
"""The surface of one terrain cell, within its bound of the sources, and its picture."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ingest import bc1
from ingest.boxes import Box, overlap
from ingest.deviation import Deviation, deviation_of, same_triangles
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.surface_texture import colours, texel_m_of
from ingest.terrain_mesh import (
    CORNERS,
    Meshing,
    Places,
    Surface,
    at_pole,
    lattice_places,
    snapped,
)
from ingest.truth import Truth, points_at
from tiles import cells, geodesy
from tiles.frames import Floats
from tiles.mesh import UV_ONE
from tiles.terrain import TEXTURE_SIDE

LEAF_SIDE = 90
"""Posts along an edge of the largest leaf; the smallest has half: about 64 x 64"""
RELIEF_SIDE = 128
"""Squares along an edge of the lattice that relief is shaded from"""
LEAST_RELIEF_SIDE = 2
INSET_SIDE = 48
"""Squares along an edge of the lattice over a source in a large cell"""
LARGEST_BOUND_M = 3000.0
"""Coarse tiles keep closer than edge / 256, so that the globe's rim is round."""
ROUNDS = 16
"""Most rounds of mending"""
MATTERS = 0.1
"""Share of a cell's bound; its children's vertices that matter less are no places of it"""
BESIDE = 1 / 64
"""Fraction of a cell within which a place is beside its edge"""
NEARLY_ALL = 0.75
"""A leaf that needs more of its posts than this takes all: then nothing is missed."""


def step_m(cell: int, side: int) -> float:
    """Distance of places that share a cell's edge."""
    return float(geodesy.cell_edge_m(cell)) / side


def inner_bound_m(cell: int) -> float:
    """Return the error that an inner cell may have: as large as its texels."""
    return min(step_m(cell, TEXTURE_SIDE), LARGEST_BOUND_M)


def fitted(
    cell: int, places: Places, bound_m: float, truths: Sequence[Truth], *, leaf: bool
) -> tuple[Surface, float]:
    """Mesh a cell so that all it stands for is within a bound, and measure it.

    Insertion sees the places only; what is found too far elsewhere (another post, or a
    line between posts) becomes a place, and the cell is meshed again.

    Parameters
    ----------
    truths : of all leaves in the cell
    leaf : every post of the truths is among the places; errors are measured along the
        vertical, so that a height read from the mesh is off by no more

    Returns
    -------
    surface : of the round that came closest
    error_m : its largest distance from the truths
    """
    slack_m = max(truth.slack_m for truth in truths)
    # Closer than half of what is not known is wasted.
    goal_m = max(bound_m - slack_m, bound_m / 2, slack_m / 2)
    meshing = Meshing(cell, places, upright=leaf)
    if leaf and _is_rough(truths, goal_m):
        meshing.refine_wholly()
    best = _refitted(cell, meshing, (bound_m, goal_m), truths, leaf=leaf)
    if leaf and best[1] > goal_m + slack_m and not at_pole(cell):
        whole = Meshing(cell, places, upright=leaf)
        whole.refine_wholly()
        best = min(
            best, _refitted(cell, whole, (bound_m, goal_m), truths, leaf=leaf), key=_error
        )
    return best


def _refitted(
    cell: int,
    meshing: Meshing,
    limits_m: tuple[float, float],
    truths: Sequence[Truth],
    *,
    leaf: bool,
) -> tuple[Surface, float]:
    """Mesh, measure and mend until the bound is kept, or after some rounds."""
    bound_m, goal_m = limits_m
    windows = [window_in(cell, one.cell) for one in truths]
    meshing.refine(goal_m)
    surface = meshing.surface()
    both = zip(windows, truths, strict=True)
    found = [deviation_of(surface, *one, upright=leaf) for one in both]
    best = surface, max(one.largest_m for one in found)
    for _ in range(ROUNDS):
        if best[1] <= bound_m or not _add_too_far(cell, meshing, found, goal_m):
            break
        meshing.refine(goal_m)
        before, surface = surface, meshing.surface()
        same = same_triangles(surface, before)
        found = [
            deviation_of(surface, window, one.truth, (one, same), upright=leaf)
            for window, one in zip(windows, found, strict=True)
        ]
        best = min(best, (surface, max(one.largest_m for one in found)), key=_error)
    return best


def _error(result: tuple[Surface, float]) -> float:
    return result[1]


def _is_rough(truths: Sequence[Truth], goal_m: float) -> bool:
    """Say whether nearly all posts of a leaf are too far from between their neighbours.

    Such a leaf takes all of its posts, with the source's own triangles.
    """
    if len(truths) > 1:
        return False
    posts = truths[0].points
    east = posts[1:-1, 1:-1] - (posts[1:-1, 2:] + posts[1:-1, :-2]) / 2
    north = posts[1:-1, 1:-1] - (posts[2:, 1:-1] + posts[:-2, 1:-1]) / 2
    far = np.maximum((east**2).sum(axis=-1), (north**2).sum(axis=-1)) > goal_m**2
    return bool(far.mean() > NEARLY_ALL)


def _add_too_far(
    cell: int, meshing: Meshing, found: list[Deviation], goal_m: float
) -> bool:
    """Add the place where each triangle is furthest from the truths, if it is too far.

    Beside the cell's edge the place on the edge becomes a vertex too, or ever thinner
    triangles would creep up to it. False when there is no room for more.
    """
    squared = np.stack([one.squared for one in found])
    which = squared.argmax(axis=0)
    far = squared.max(axis=0) > goal_m**2
    at, points, near = [], [], []
    for k in np.unique(which[far]):
        one, mine = found[k], np.flatnonzero(far & (which == k))
        uv, beside = one.uv[mine], np.flatnonzero(is_beside_rim(one.uv[mine]))
        at.append(snapped(np.concatenate([uv, on_rim(uv[beside])])))
        near.append(np.concatenate([mine, mine[beside]]))
        window = window_in(cell, one.truth.cell)
        there = points_at(one.truth, (at[-1] / UV_ONE - window[:2]) / window[2])
        points.append(there + one.truth.centre)
    if not at:
        return False
    return meshing.add(np.concatenate(at), np.concatenate(points), np.concatenate(near))


def is_beside_rim(uv: Floats) -> NDArray[np.bool_]:
    """Say which places, (n, 2), are near the cell's edge."""
    return np.asarray(((uv < BESIDE) | (uv > 1 - BESIDE)).any(axis=1))


def on_rim(uv: Floats) -> Floats:
    """Return the places on the cell's edges beside places near them, (n, 2)."""
    return np.asarray(np.where((uv < BESIDE) | (uv > 1 - BESIDE), np.round(uv), uv))


def joined(cell: int, children: Sequence[tuple[int, Surface]], bound_m: float) -> Places:
    """Return those vertices of a cell's children that may matter at its bound."""
    at, points = [], []
    for child, surface in children:
        u, v, size = window_in(cell, child)
        on_edge = ((surface.uv == 0) | (surface.uv == 1)).any(axis=1)
        matter = np.flatnonzero((surface.weight_m > MATTERS * bound_m) | on_edge)
        at.append(snapped(np.array([u, v]) + size * surface.uv[matter]))
        points.append(surface.points[matter] + surface.mesh.centre)
    places, there = np.concatenate(at), np.concatenate(points)
    corner = [np.flatnonzero((places == one).all(axis=1))[0] for one in CORNERS * UV_ONE]
    order = np.concatenate([corner, np.arange(len(places))])
    return Places.of(places[order], there[order])


def lattice_of(mosaic: Mosaic, cell: int) -> Places:
    """Return places of a large inner cell: a lattice, and one on each source in it.

    Posts between those of a lattice are averaged.
    """
    west, south, east, north = (float(edge) for edge in cells.bounds_rad(cell))
    box = west, south, east, north
    lattices = [_lattice(box, RELIEF_SIDE)]
    for layer in mosaic.layers:
        common = overlap(cell, layer.bounds_deg)
        if common is not None and common != box:
            lattices.append(_lattice(common, INSET_SIDE))
    lon, lat = np.concatenate(lattices, axis=1)
    heights = mosaic.heights(lon, lat, step_m(cell, RELIEF_SIDE))
    uv = np.stack([(lon - west) / (east - west), (lat - south) / (north - south)], axis=1)
    points = geodesy.to_ecef(lon, lat, heights)
    corners = np.array([0, RELIEF_SIDE, -1, -1 - RELIEF_SIDE]) % (RELIEF_SIDE + 1) ** 2
    order = np.concatenate([corners, np.setdiff1d(np.arange(len(uv)), corners)])
    return Places.of(snapped(uv[order]), points[order])


def _lattice(box_rad: Box, side: int) -> Floats:
    """Return longitudes and latitudes in a box, (2, (side + 1)**2), row by row."""
    west, south, east, north = box_rad
    lon, lat = np.meshgrid(
        np.linspace(west, east, side + 1), np.linspace(south, north, side + 1)
    )
    return np.stack([lon.ravel(), lat.ravel()])


def painted(
    mosaic: Mosaic, held: list[Layer], pictures: list[Layer], cell: int
) -> tuple[NDArray[np.uint8], float]:
    """Return the texture of a cell, relief included, and `texel_m` if it is no leaf.

    Parameters
    ----------
    held : elevation models with posts in the cell
    """
    # Between its posts a source has no relief: on a finer lattice its triangles would show.
    finest_m = held[-1].spacing_m if held else step_m(cell, RELIEF_SIDE)
    side = int(
        np.clip(geodesy.cell_edge_m(cell) / finest_m, LEAST_RELIEF_SIDE, RELIEF_SIDE)
    )
    lon, lat = lattice_places(cell, side, margin=1)
    step = step_m(cell, side)
    found, sea = mosaic.heights_and_sea(lon.ravel(), lat.ravel(), step)
    heights, zero = found.reshape(lon.shape), sea.reshape(lon.shape)
    texture = bc1.encode(colours(cell, heights, heights - zero, pictures))
    return texture, texel_m_of(cell, heights - zero, held, pictures)


def window_in(ancestor: int, cell: int) -> tuple[float, float, float]:
    """Return (u, v, size) of a cell in an ancestor, fractions, exact."""
    depth = int(cells.level(cell)) - int(cells.level(ancestor))
    row, col = cells.row_col(cell)
    top_row, top_col = cells.row_col(ancestor)
    scale = 2.0**-depth
    u = (int(col) - (int(top_col) << depth)) * scale
    return u, (int(row) - (int(top_row) << depth)) * scale, scale
