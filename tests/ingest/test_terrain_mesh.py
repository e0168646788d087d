# SPDX-License-Identifier: Apache-2.0
"""Meshes of cells: within their rounding, watertight at the skirt, seen from outside."""

import numpy as np
import pytest

from ingest.terrain_mesh import Surface, build_surface, lattice_of, lattice_places
from tiles import cells, geodesy
from tiles.mesh import SEA, SKIRT, UV_ONE

SIDE = 16
CELLS = [
    cells.cell_at(np.radians(lon), np.radians(lat), level)
    for lon, lat, level in ((11, 46, 9), (-179.999, -10, 4), (3, 89.9, 0), (20, -89, 6))
]


def surface_of(cell: int, height_m: np.ndarray) -> Surface:
    lattice = lattice_of(cell, *lattice_places(cell, SIDE), height_m)
    return build_surface(lattice, height_m < 0, 1.0)


@pytest.fixture(params=CELLS)
def surface(request: pytest.FixtureRequest, rng: np.random.Generator) -> Surface:
    height_m = rng.normal(0, 300, (SIDE + 1, SIDE + 1))
    pole = np.abs(lattice_places(int(request.param), SIDE)[1]) > np.pi / 2 - 1e-9
    height_m[pole] = 100.0  # one place, one height
    return surface_of(int(request.param), height_m)


def test_a_lattice_reaches_from_edge_to_edge_and_never_over_a_pole() -> None:
    for cell in CELLS:
        west, south, east, north = cells.bounds_rad(cell)
        lon, lat = lattice_places(int(cell), SIDE)
        assert lon[0, 0] == pytest.approx(west)
        assert lon[0, -1] == pytest.approx(east)
        assert lat[0, 0] == pytest.approx(south)
        assert lat[-1, 0] == pytest.approx(north)
        assert np.abs(lattice_places(int(cell), SIDE, margin=1)[1]).max() <= np.pi / 2


def test_positions_are_rounded_by_half_a_step(surface: Surface) -> None:
    raw = surface.mesh.vertices["position"][: len(surface.uv)] * surface.mesh.scale_m
    np.testing.assert_allclose(surface.points, raw, atol=1e-9)
    assert np.abs(surface.mesh.vertices["position"]).max() == 32767


def test_triangles_face_outwards(surface: Surface) -> None:
    a, b, c = np.moveaxis(surface.points[surface.triangles] + surface.mesh.centre, 1, 0)
    normal = np.cross(b - a, c - a)
    long_enough = np.linalg.norm(normal, axis=1) > 1.0  # at a pole, some have no area
    lon, lat, _ = geodesy.to_geodetic((a + b + c) / 3)
    outwards = (normal * geodesy.up(lon, lat)).sum(axis=1)
    assert (outwards[long_enough] > 0).all()


def test_the_skirt_repeats_the_rim(surface: Surface) -> None:
    vertices, count = surface.mesh.vertices, len(surface.uv)
    hem, top = vertices[count:], vertices[:count]
    assert (hem["flags"] & SKIRT == SKIRT).all()
    assert (top["flags"] & SKIRT == 0).all()
    on_rim = ((top["detail"] == 0) | (top["detail"] == UV_ONE)).any(axis=1)
    assert on_rim.sum() == len(hem)
    for field in ("position", "detail"):
        assert {t.tobytes() for t in hem[field]} <= {
            t.tobytes() for t in top[on_rim][field]
        }


def test_walls_of_the_skirt_face_away_from_the_cell(surface: Surface) -> None:
    indices = surface.mesh.indices.reshape(-1, 3)[len(surface.triangles) :].astype(int)
    drop = np.where(surface.mesh.vertices["flags"] & SKIRT, 5e3, 0.0)
    points = surface.mesh.local + surface.mesh.centre
    lon, lat, _ = geodesy.to_geodetic(points)
    points = points - drop[:, None] * geodesy.up(lon, lat)
    a, b, c = np.moveaxis(points[indices], 1, 0)
    normal = np.cross(b - a, c - a)
    away = (a + b + c) / 3 - surface.mesh.centre
    wide = np.linalg.norm(normal, axis=1) > 1e6  # at a pole, walls have no width
    assert ((normal * away).sum(axis=1)[wide] > 0).all()


def test_vertices_below_sea_level_are_marked(surface: Surface) -> None:
    _, _, height = geodesy.to_geodetic(surface.points + surface.mesh.centre)
    below = surface.mesh.vertices["flags"][: len(surface.uv)] & SEA == SEA
    sure = np.abs(height) > 3 * surface.mesh.scale_m
    assert (below == (height < 0))[sure].all()


def test_neighbours_share_the_posts_of_their_edge() -> None:
    west = int(cells.cell_at(np.radians(11), np.radians(46), 9))
    zone, row, col = int(cells.zone(west)), *(int(n) for n in cells.row_col(west))
    east = int(cells.make(zone, 9, row, col + 1))
    lon_w, lat_w = lattice_places(west, SIDE)
    lon_e, lat_e = lattice_places(east, SIDE)
    np.testing.assert_allclose(lon_w[:, -1], lon_e[:, 0], atol=1e-15)
    np.testing.assert_array_equal(lat_w[:, -1], lat_e[:, 0])
