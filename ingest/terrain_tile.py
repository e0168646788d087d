# SPDX-License-Identifier: Apache-2.0
"""The surface of one terrain cell, within its bound of the sources, and its picture."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ingest import bc1
from ingest.boxes import Box, edge_m, edges_rad, overlap, window_in
from ingest.coast import coast_of, fine_beside
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.polar import texel_lattice
from ingest.relief import slopes_of
from ingest.surface_texture import colours, texel_m_of
from ingest.terrain_mesh import (
    CORNERS,
    Places,
    Surface,
    snapped,
)
from tiles import geodesy
from tiles.frames import Floats
from tiles.mesh import UV_ONE
from tiles.terrain import TEXTURE_SIDE

LEAF_SIDE = 45
"""Posts along an edge of the largest leaf; the smallest has half: about 64 x 64"""
RELIEF_SIDE = 128
"""Squares along an edge of the lattice that relief is shaded from"""
LEAST_RELIEF_SIDE = 32
INSET_SIDE = 48
"""Squares along an edge of the lattice over a source in a large cell"""
LARGEST_BOUND_M = 3000.0
"""Coarse tiles keep closer than edge / 256, so that the globe's rim is round."""
MATTERS = 0.1
"""Share of a cell's bound; its children's vertices that matter less are no places of it"""


def step_m(cell: int, side: int) -> float:
    """Distance of places that share a cell's edge."""
    return edge_m(cell) / side


def inner_bound_m(cell: int) -> float:
    """Return the error that an inner cell may have: as large as its texels."""
    return min(step_m(cell, TEXTURE_SIDE), LARGEST_BOUND_M)


def joined(cell: int, children: Sequence[tuple[int, Surface]], bound_m: float) -> Places:
    """Return those vertices of a cell's children that may matter at its bound."""
    at, points = [], []
    for child, surface in children:
        u, v, size = window_in(cell, child)
        on_edge = ((surface.uv == 0) | (surface.uv == 1)).any(axis=1)
        matter = np.flatnonzero((surface.weight_m > MATTERS * bound_m) | on_edge)
        at.append(snapped(np.array([u, v]) + size * surface.uv[matter]))
        points.append(surface.points[matter] + surface.centre)
    places, there = np.concatenate(at), np.concatenate(points)
    corner = [np.flatnonzero((places == one).all(axis=1))[0] for one in CORNERS * UV_ONE]
    order = np.concatenate([corner, np.arange(len(places))])
    return Places.of(places[order], there[order])


def lattice_of(mosaic: Mosaic, cell: int) -> Places:
    """Return places of a large inner cell: a lattice, and one on each source in it.

    Posts between those of a lattice are averaged.
    """
    west, south, east, north = edges_rad(cell)
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
    side = int(np.clip(edge_m(cell) / finest_m, LEAST_RELIEF_SIDE, RELIEF_SIDE))
    lon, lat = texel_lattice(cell, side)
    step = step_m(cell, side)
    found, sea = mosaic.heights_and_sea(lon.ravel(), lat.ravel(), step)
    heights, zero = found.reshape(lon.shape), sea.reshape(lon.shape)
    elevation = heights - zero
    slopes = slopes_of(mosaic, lon, lat, heights, (step, step_m(cell, TEXTURE_SIDE)))
    places, beside = (lon, lat, zero, elevation), fine_beside(mosaic, cell)
    inner, knows = coast_of(cell, held, places, step, beside)
    texture = bc1.encode(colours(cell, slopes, inner, pictures, knows))
    return texture, texel_m_of(cell, elevation, held, pictures)
