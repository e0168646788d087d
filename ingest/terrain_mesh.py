# SPDX-License-Identifier: Apache-2.0
"""The mesh of one terrain cell: greedy surface, skirt, 16-byte vertices."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ingest.greedy import simplify
from tiles import cells, geodesy
from tiles.frames import Ecef, Floats, Local
from tiles.mesh import SEA, SKIRT, UV_ONE, VERTEX, Mesh, quantise


@dataclass(frozen=True, slots=True)
class Lattice:
    """Posts of one cell on a regular grid of longitude and latitude."""

    cell: int
    lon_rad: Floats
    """(n + 1, n + 1), row 0 south, column 0 west"""
    lat_rad: Floats
    height_m: Floats
    points: Ecef
    """(n + 1, n + 1, 3) float64"""


def lattice_places(cell: int, side: int, margin: int = 0) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes, (side + 1 + 2 margin) squared, clamped at poles."""
    west, south, east, north = cells.bounds_rad(cell)
    steps = np.arange(-margin, side + 1 + margin) / side
    lon, lat = np.meshgrid(west + steps * (east - west), south + steps * (north - south))
    return lon, np.clip(lat, -np.pi / 2, np.pi / 2)


def lattice_of(cell: int, lon_rad: Floats, lat_rad: Floats, height_m: Floats) -> Lattice:
    """Place posts in ECEF."""
    points = geodesy.to_ecef(lon_rad, lat_rad, height_m)
    return Lattice(cell, lon_rad, lat_rad, height_m, points)


@dataclass(frozen=True, slots=True)
class Surface:
    """A cell's triangles, as they will be drawn (positions already rounded)."""

    mesh: Mesh
    triangles: NDArray[np.int64]
    """(t, 3) vertices of the surface, skirts apart"""
    uv: Floats
    """(v, 2) fractions of the cell, east and north"""
    points: Floats
    """(v, 3) float64 m around mesh.centre"""


def build_surface(lattice: Lattice, sea: NDArray[np.bool_], bound_m: float) -> Surface:
    """Triangulate a lattice within a bound and add the skirt.

    Parameters
    ----------
    sea : (n + 1, n + 1) bool, posts below sea level
    bound_m : largest distance of a post from its triangle, rounding apart
    """
    side = lattice.points.shape[0]
    centre = lattice.points[side // 2, side // 2].copy()
    local = np.ascontiguousarray(lattice.points - centre)
    used, triangles, border = simplify(local, bound_m)
    steps, scale_m = quantise(Local(local.reshape(-1, 3)[used]))
    vertices = np.zeros(len(used), VERTEX)
    vertices["position"] = steps
    vertices["flags"] = np.where(sea.ravel()[used], SEA, 0)
    uv = np.stack([used % side, used // side], axis=1) / (side - 1)
    vertices["detail"] = np.rint(uv * UV_ONE)
    up = geodesy.up(lattice.lon_rad.ravel()[used], lattice.lat_rad.ravel()[used])
    vertices["normal"][:, :3] = np.rint(up * 127)
    skirt, skirt_triangles = _skirt(vertices, border)
    indices = np.concatenate([triangles, skirt_triangles]).astype("<u2").ravel()
    mesh = Mesh(Ecef(centre), scale_m, np.concatenate([vertices, skirt]), indices)
    return Surface(mesh, triangles, uv, mesh.local[: len(used)])


def _skirt(
    vertices: NDArray[np.void], border: NDArray[np.int64]
) -> tuple[NDArray[np.void], NDArray[np.int64]]:
    """Hang a wall under each directed rim edge; the renderer chooses its depth."""
    rim, edges = np.unique(border, return_inverse=True)
    hem = vertices[rim].copy()
    hem["flags"] |= SKIRT
    below = edges.reshape(-1, 2) + len(vertices)
    a, b = border.T
    low_a, low_b = below.T
    walls = np.stack([a, low_a, low_b, a, low_b, b], axis=1).reshape(-1, 3)
    return hem, walls
