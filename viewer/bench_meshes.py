# SPDX-License-Identifier: Apache-2.0
"""Terrain as other methods mesh it, made of the same ground while the bench runs.

Each tile of the store is meshed anew from a lattice of heights. They are taken from the
store's own tiles two levels finer, whose error is a quarter of the tile's, or from the
finest there are; the sources' posts themselves were only at hand when it was ingested.
Texture, cell and place in the forest stay.

A regular grid has all triangles of its lattice. A right-triangulated irregular network
(RTIN: Evans, Kirkpatrick, Townsend 2001; the errors go up as in Mapbox's martini) has
those that its error bound asks for; the bound counts at the lattice's posts alone.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiles import cells, geodesy, terrain
from tiles.frames import Ecef, Floats, Ints, Local
from tiles.mesh import SKIRT, UV_ONE, VERTEX, Mesh, quantise
from tiles.surface import Surface
from tiles.terrain import TerrainTile, in_pieces, no_rungs
from viewer.bench_choices import edges_m
from viewer.drawn_surface import boxes_of, distances_to, join
from viewer.rtin import rtin

FINER = 2
PER_EDGE, PER_LEAF_EDGE = 256, 6400
"""Edges of inner cells and of leaves in what their meshes may err, as an ingest does"""
SIDES = {"grid": 64, "rtin": 128}
"""Cells of the lattice along an edge: a leaf has 64 posts; martini's has a power of 2"""
PROBES = 64
"""Places along an edge, in the middle of the grid's squares"""


@dataclass(frozen=True, slots=True)
class Lattice:
    """Points of a cell on a lattice, row by row from the south."""

    at: Ints
    """(n, 2), 0..UV_ONE, east and north"""
    points: Ecef
    """(n, 3) m"""
    up: Floats
    """(n, 3)"""


def remeshed(surface: Surface, tile: TerrainTile, kind: str, *, leaf: bool) -> TerrainTile:
    """Return a tile with the mesh of another method.

    Parameters
    ----------
    kind : of `SIDES`
    leaf : nothing finer is below
    """
    side = SIDES[kind]
    lattice = lattice_of(surface, tile.cell, side)
    if kind == "grid":
        made = with_mesh(tile, lattice, grid(side))
        return replace(made, error_m=error_of(surface, made))
    bound_m = float(edges_m(np.array([tile.cell]))[0]) / (
        PER_LEAF_EDGE if leaf else PER_EDGE
    )
    return replace(
        with_mesh(tile, lattice, rtin(lattice.points, lattice.up, side, bound_m)),
        error_m=bound_m,
    )


def lattice_of(surface: Surface, cell: int, side: int) -> Lattice:
    """Return the points of the ground on a lattice with `side` cells along an edge."""
    steps = np.arange(side + 1) * (UV_ONE // side)
    u, v = (part.ravel() for part in np.meshgrid(steps, steps))
    lon, lat = place_of(cell, u / UV_ONE, v / UV_ONE)
    points = geodesy.to_ecef(lon, lat, heights(surface, cell, lon, lat))
    return Lattice(np.stack((u, v), axis=1), points, geodesy.up(lon, lat))


def place_of(cell: int, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes, rad, of shares of a cell."""
    west, south, east, north = (float(x) for x in cells.bounds_rad(cell))
    return west + u * (east - west), south + v * (north - south)


def heights(surface: Surface, cell: int, lon: Floats, lat: Floats) -> Floats:
    """Return heights of the ground, m, as fine as they matter to a cell."""
    level = int(cells.level(cell)) + FINER
    return surface.heights_at_level(lon, lat, level)[0]


def error_of(surface: Surface, tile: TerrainTile) -> float:
    """Return how far the ground is from a mesh at most, m, between the lattice's posts."""
    steps = (np.arange(PROBES) + 0.5) / PROBES
    u, v = (part.ravel() for part in np.meshgrid(steps, steps))
    lon, lat = place_of(tile.cell, u, v)
    points = geodesy.to_ecef(lon, lat, heights(surface, tile.cell, lon, lat))
    anywhere, no_limit = np.full(len(points), -1), np.full(len(points), np.inf)
    mesh = join([boxes_of(tile)])
    return float(
        distances_to(mesh, points, anywhere, no_limit, np.zeros(len(points))).max()
    )


def grid(side: int) -> Ints:
    """Return the triangles of a whole lattice, (2 side side, 3)."""
    i = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, :-1], i[1:, 1:]
    return np.stack((a, b, d, a, d, c), axis=-1).reshape(-1, 3)


def with_mesh(tile: TerrainTile, lattice: Lattice, triangles: Ints) -> TerrainTile:
    """Return a tile with some triangles of a lattice, and a skirt around them."""
    used, corners = np.unique(triangles, return_inverse=True)
    at, points = lattice.at[used], lattice.points[used]
    rim = ring(at)
    steps, scale_m = quantise(Local(points - tile.mesh.centre))
    vertices = np.zeros(len(used) + len(rim), VERTEX)
    vertices["position"] = np.concatenate((steps, steps[rim]))
    vertices["detail"] = np.concatenate((at, at[rim]))
    vertices["flags"][len(used) :] = SKIRT
    hang, after = len(used) + np.arange(len(rim)), np.roll(np.arange(len(rim)), -1)
    skirt = np.stack((rim, hang, rim[after], rim[after], hang, hang[after]), axis=-1)
    indices = np.concatenate((corners.ravel(), skirt.ravel())).astype(np.uint16)
    mesh = Mesh(tile.mesh.centre, scale_m, vertices, indices)
    made = replace(tile, mesh=mesh, surface_index_count=triangles.size, rungs=no_rungs())
    return in_pieces(made)


def ring(at: Ints) -> NDArray[np.int64]:
    """Return the vertices along the cell's edges, counter-clockwise, each once."""
    u, v = at[:, 0], at[:, 1]
    sides = (
        (v == 0, u),
        (u == UV_ONE, v),
        (v == UV_ONE, -u),
        (u == 0, -v),
    )
    found = []
    for mask, along in sides:
        side = np.flatnonzero(mask)
        found.append(side[np.argsort(along[side])][:-1])
    return np.concatenate(found)


def stored_bytes(tile: TerrainTile) -> int:
    """Return what a tile would take in a store."""
    return len(terrain.encode(tile))
