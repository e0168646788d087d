# SPDX-License-Identifier: Apache-2.0
"""Make the tile of one terrain cell and say how far it is from the sources."""

from dataclasses import dataclass

import numpy as np

from ingest.boxes import grown, overlap
from ingest.deviation import deviation_m, overlay_deviation_m
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.surface_texture import colours
from ingest.terrain_mesh import Lattice, Surface, build_surface, lattice_of, lattice_places
from tiles import cells, geodesy
from tiles.terrain import TEXTURE_SIDE, TerrainTile

from . import bc1

INNER_SIDE = 128
LEAF_SIDE = 64
LARGEST_BOUND_M = 3000.0
"""Coarse tiles keep closer than edge / 256, so that the globe's rim is round."""
SEA_M = 0.2
"""Posts up to here count as sea: many elevation models say 0 there."""
CHECK_FACTOR = 4
CHECK_MARGIN = 1.25
"""Where several sources meet, the error is the largest on a lattice four times finer than
the posts, and a quarter more for what lies between."""


@dataclass(frozen=True, slots=True)
class Painted:
    """A cell's surface and texture before its error is known."""

    surface: Surface
    lattice: Lattice
    texture: np.ndarray[tuple[int], np.dtype[np.uint8]]
    bound_m: float


def step_m(cell: int, side: int) -> float:
    """Distance of a cell's posts."""
    return float(geodesy.cell_edge_m(cell)) / side


def leaf_lattice(mosaic: Mosaic, cell: int) -> Lattice:
    """Sample the mosaic at a leaf's posts."""
    lon, lat = lattice_places(cell, LEAF_SIDE)
    heights = mosaic.heights(lon.ravel(), lat.ravel(), step_m(cell, LEAF_SIDE))
    return lattice_of(cell, lon, lat, heights.reshape(lon.shape))


def paint(
    mosaic: Mosaic, pictures: list[Layer], cell: int, leaf_bound_m: float | None
) -> Painted:
    """Mesh and paint a cell.

    Parameters
    ----------
    leaf_bound_m : bound of a leaf; None for an inner cell, whose bound is edge / 256
    """
    side = INNER_SIDE if leaf_bound_m is None else LEAF_SIDE
    edge_m = float(geodesy.cell_edge_m(cell))
    lon, lat = lattice_places(cell, side, margin=1)
    found, sea = mosaic.heights_and_sea(lon.ravel(), lat.ravel(), edge_m / side)
    heights, zero = found.reshape(lon.shape), sea.reshape(lon.shape)
    inner = (slice(1, -1), slice(1, -1))
    lattice = lattice_of(cell, lon[inner], lat[inner], heights[inner])
    inner_m = min(edge_m / TEXTURE_SIDE, LARGEST_BOUND_M)
    bound_m = inner_m if leaf_bound_m is None else leaf_bound_m
    surface = build_surface(lattice, (heights < zero + SEA_M)[inner], 0.7 * bound_m)
    texture = bc1.encode(colours(cell, heights, heights - zero, pictures))
    return Painted(surface, lattice, texture, bound_m)


def leaf_error_m(mosaic: Mosaic, cell: int, surface: Surface) -> float:
    """Measure a leaf against its source's own triangles; where several meet, the mosaic."""
    west, south, east, north = cells.bounds_rad(cell)
    lon_lat = np.array([west, south]) + surface.uv * np.array([east - west, north - south])
    winner = _finest_source(mosaic, cell)
    measured = overlay_deviation_m(surface, winner, lon_lat) if winner else None
    if measured is not None:
        return measured
    lon, lat = lattice_places(cell, LEAF_SIDE * CHECK_FACTOR)
    heights = mosaic.heights(lon.ravel(), lat.ravel(), 0.0)
    truth = geodesy.to_ecef(lon, lat, heights.reshape(lon.shape))
    return CHECK_MARGIN * deviation_m(surface, (0.0, 0.0, 1.0), truth)


def _finest_source(mosaic: Mosaic, cell: int) -> Layer | None:
    """Return the finest source that changes the surface in a cell, if there is one."""
    for layer in reversed(mosaic.layers):
        if overlap(cell, grown(layer.bounds_deg, mosaic.reach_m(layer))):
            return layer
    return None


def error_under(surface: Surface, ancestor: int, lattice: Lattice) -> float:
    """Measure an inner cell's surface at the posts of one leaf below it."""
    u, v, size = window_in(ancestor, lattice.cell)
    return deviation_m(surface, (u, v, size), lattice.points)


def window_in(ancestor: int, cell: int) -> tuple[float, float, float]:
    """Return (u, v, size) of a cell in an ancestor, fractions, exact."""
    depth = int(cells.level(cell)) - int(cells.level(ancestor))
    row, col = cells.row_col(cell)
    top_row, top_col = cells.row_col(ancestor)
    scale = 2.0**-depth
    u = (int(col) - (int(top_col) << depth)) * scale
    return u, (int(row) - (int(top_row) << depth)) * scale, scale


def tile_of(cell: int, painted: Painted, error_m: float, *, leaf: bool) -> TerrainTile:
    """Put a tile together."""
    texel_m = 0.0 if leaf else float(geodesy.cell_edge_m(cell)) / TEXTURE_SIDE
    surface = painted.surface
    count = 3 * len(surface.triangles)
    return TerrainTile(cell, surface.mesh, count, error_m, texel_m, painted.texture)
