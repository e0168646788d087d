# SPDX-License-Identifier: Apache-2.0
"""Meshes of cells: within their rounding, watertight at the skirt, seen from outside."""

import numpy as np
import pytest

from ingest.pole import at_pole, on_pole
from ingest.terrain_mesh import (
    Meshing,
    Places,
    Surface,
    lattice_places,
    snapped,
)
from tests.ingest.rasters import build_surface, drawn, lattice_of, places_deg
from tiles import cells, geodesy
from tiles.mesh import SKIRT, UV_ONE

SIDE = 16
CELLS = [
    cells.cell_at(np.radians(lon), np.radians(lat), level)
    for lon, lat, level in ((11, 46, 9), (-179.999, -10, 4), (3, 89.9, 0), (20, -89, 6))
]


def surface_of(cell: int, height_m: np.ndarray) -> Surface:
    return build_surface(cell, lattice_of(cell, height_m), 1.0)


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
    assert np.abs(surface.mesh.vertices["position"]).max() >= 32766


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
    # Along a pole an edge is a point, where no wall is.
    south, north = np.abs(cells.bounds_rad(surface.cell)[1::2]) > cells.POLAR_RAD
    v = top["detail"][:, 1]
    along_pole = ((v == 0) & south) | ((v == UV_ONE) & north)
    along_pole &= (top["detail"][:, 0] > 0) & (top["detail"][:, 0] < UV_ONE)
    on_rim &= ~along_pole
    assert along_pole.any() == (south | north)
    assert on_rim.sum() == len(hem)
    for field in ("position", "detail"):
        assert {t.tobytes() for t in hem[field]} <= {
            t.tobytes() for t in top[on_rim][field]
        }


def test_walls_of_the_skirt_face_away_from_the_cell(surface: Surface) -> None:
    indices = surface.mesh.indices.reshape(-1, 3)[len(surface.shown[0]) :].astype(int)
    drop = np.where(surface.mesh.vertices["flags"] & SKIRT, 5e3, 0.0)
    points = surface.mesh.local + surface.mesh.centre
    lon, lat, _ = geodesy.to_geodetic(points)
    points = points - drop[:, None] * geodesy.up(lon, lat)
    a, b, c = np.moveaxis(points[indices], 1, 0)
    normal = np.cross(b - a, c - a)
    away = (a + b + c) / 3 - surface.mesh.centre
    assert (np.linalg.norm(normal, axis=1) > 1e3).all()
    assert ((normal * away).sum(axis=1) > 0).all()


def test_all_vertices_at_a_pole_are_in_its_place(surface: Surface) -> None:
    poles = on_pole(surface.cell, surface.at)
    assert poles.any() == at_pole(surface.cell)
    height_m = geodesy.to_ecef(0.0, np.radians(90.0), 100.0)[2]
    for place in surface.points[poles] + surface.centre:
        np.testing.assert_allclose(np.abs(place), [0.0, 0.0, height_m], atol=1e-6)
    assert (surface.steps[poles] == surface.steps[poles][:1]).all()


def test_what_has_no_area_at_a_pole_is_not_drawn(surface: Surface) -> None:
    (triangles, border), points = surface.shown, surface.points
    assert (np.linalg.norm(points[border[:, 0]] - points[border[:, 1]], axis=1) > 1).all()
    left_out = len(surface.triangles) - len(triangles)
    assert (left_out > 0) == at_pole(surface.cell)
    a, b, c = np.moveaxis(points[surface.triangles], 1, 0)
    lines = np.linalg.norm(np.cross(b - a, c - a), axis=1) < 1e-6
    assert lines.sum() == left_out


def test_neighbours_share_the_posts_of_their_edge() -> None:
    west = int(cells.cell_at(np.radians(11), np.radians(46), 9))
    zone, row, col = int(cells.zone(west)), *(int(n) for n in cells.row_col(west))
    east = int(cells.make(zone, 9, row, col + 1))
    lon_w, lat_w = lattice_places(west, SIDE)
    lon_e, lat_e = lattice_places(east, SIDE)
    np.testing.assert_allclose(lon_w[:, -1], lon_e[:, 0], atol=1e-15)
    np.testing.assert_array_equal(lat_w[:, -1], lat_e[:, 0])


@pytest.mark.parametrize("bound_m", [20.0, 100.0])
def test_every_place_is_within_the_bound_rounding_included(
    bound_m: float, rng: np.random.Generator
) -> None:
    for cell in CELLS[:2]:  # at a pole, triangles are bent in longitude and latitude
        heights = rng.normal(0, 30, (SIDE + 1, SIDE + 1))
        places = lattice_of(int(cell), heights)
        surface = build_surface(int(cell), places, bound_m)
        rounding_m = np.sqrt(3) / 2 * surface.mesh.scale_m
        gap = np.linalg.norm(drawn(surface, places.at / UV_ONE) - places.points, axis=1)
        # On cells of 1000 km a step of 16 bits may be more than the bound.
        # Slopes are small: straight up it is hardly more than the shortest distance.
        assert gap.max() <= 1.03 * max(bound_m, rounding_m)
        used = np.linalg.norm(
            surface.points + surface.mesh.centre - places.points[surface.used], axis=1
        )
        assert used.max() <= rounding_m + 1e-6


def test_triangles_cover_the_cell_once(surface: Surface) -> None:
    at = np.rint(surface.uv * UV_ONE)
    a, b, c = np.moveaxis(at[surface.triangles], 1, 0)
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (twice > 0).all()
    assert twice.sum() == 2 * UV_ONE * UV_ONE


def test_vertices_lie_where_the_places_said(surface: Surface) -> None:
    detail = surface.mesh.vertices["detail"][: len(surface.uv)]
    np.testing.assert_array_equal(detail, surface.uv * UV_ONE)
    assert {(0, 0), (UV_ONE, 0), (0, UV_ONE), (UV_ONE, UV_ONE)} <= set(
        map(tuple, detail.tolist())
    )


def test_only_what_lies_on_an_edge_is_rounded_to_it() -> None:
    step = 1 / UV_ONE
    fractions = np.array([0.0, 0.1 * step, 0.49 * step, 0.6 * step, 0.5, 1 - 0.1 * step, 1])
    np.testing.assert_array_equal(
        snapped(fractions), [0, 1, 1, 1, UV_ONE // 2, UV_ONE - 1, UV_ONE]
    )


def test_of_places_that_are_alike_the_first_counts() -> None:
    at = np.array([(0, 0), (9, 0), (9, 9), (0, 9), (5, 5), (4, 4), (5, 5), (9, 9)])
    points = np.arange(24.0).reshape(8, 3)
    places = Places.of(at, points, -1)
    np.testing.assert_array_equal(places.at, at[:6])
    np.testing.assert_array_equal(places.points, points[:6])
    assert places.lean == -1


def test_what_is_added_to_a_mesh_becomes_a_vertex(rng: np.random.Generator) -> None:
    for cell in map(int, CELLS):
        places = lattice_of(cell, np.zeros((SIDE + 1, SIDE + 1)))
        more = rng.integers(1, UV_ONE, (30, 2))
        points = geodesy.to_ecef(*np.radians(places_deg(cell, more / UV_ONE)), np.zeros(30))
        meshing = Meshing(cell, places)
        meshing.refine(1e5)
        assert meshing.add(more, points, np.zeros(30, np.int64))
        meshing.refine(1e5)
        surface = meshing.surface()
        at = np.rint(surface.uv * UV_ONE).astype(int)
        found = (at[:, None] == more).all(axis=-1)
        assert found.any(axis=0).all()
        vertex = found.argmax(axis=0)
        gap = np.linalg.norm(surface.points[vertex] + surface.mesh.centre - points, axis=1)
        assert gap.max() <= surface.mesh.scale_m
