# SPDX-License-Identifier: Apache-2.0
"""Extrusion against trimesh: closed when a floor is added, right volume, facing out."""

import numpy as np
import pyproj
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from ingest.extrude import CORNER_VERTICES, Prisms, extrude
from ingest.repair import area_m2, repair
from tiles import geodesy
from tiles.mesh import ROOF, WALL

LON, LAT = -122.44, 37.76
PER_LON, PER_LAT = 88_000.0, 111_000.0


def placed(*shapes: shapely.Geometry) -> np.ndarray:
    """Shapes in metres, put down in San Francisco and repaired as the ingest does."""
    scale = np.array([1 / PER_LON, 1 / PER_LAT])
    array = np.empty(len(shapes), object)
    array[:] = [shapely.transform(s, lambda xy: xy * scale + (LON, LAT)) for s in shapes]
    return repair(array).polygon


L_SHAPE = shapely.Polygon([(0, 0), (30, 0), (30, 10), (10, 10), (10, 25), (0, 25)])
COURT = shapely.Polygon(
    [(0, 0), (40, 0), (40, 40), (0, 40)],
    [[(10, 10), (30, 10), (30, 20), (10, 20)], [(10, 25), (30, 25), (20, 35)]],
)
TWO = shapely.MultiPolygon([shapely.box(0, 0, 10, 10), shapely.box(20, 0, 35, 10)])
SHAPES = placed(L_SHAPE, COURT, TWO, shapely.Point(0, 0).buffer(15))


def mesh_of(prisms: Prisms, k: int, *, floor: bool) -> trimesh.Trimesh:
    """One object around its first vertex; a floor is the roof turned over, at the foot."""
    v0, v1 = prisms.vertex_start[k : k + 2]
    triangles = prisms.triangles[prisms.triangle_start[k] : prisms.triangle_start[k + 1]]
    points, faces = prisms.ecef[v0:v1], triangles - v0
    if floor:
        roof = prisms.vertices["flags"][v0:v1] == ROOF
        foot = prisms.height_m[v0:v1].min()
        low = geodesy.to_ecef(prisms.lon_rad[v0:v1], prisms.lat_rad[v0:v1], foot)
        turned = faces[roof[faces[:, 0]]][:, ::-1] + len(points)
        points, faces = np.concatenate((points, low)), np.concatenate((faces, turned))
    return trimesh.Trimesh(points - points[0], faces, process=True)


@pytest.mark.parametrize("k", range(len(SHAPES)))
def test_with_a_floor_a_prism_is_closed_and_has_the_right_volume_and_area(k: int) -> None:
    foot, top = np.full(len(SHAPES), 12.0), np.full(len(SHAPES), 30.0)
    mesh = mesh_of(extrude(SHAPES, foot, top), k, floor=True)
    area = area_m2(SHAPES)[k]
    geod = pyproj.Geod(ellps="WGS84")
    rings = shapely.get_rings(shapely.get_parts(SHAPES[k : k + 1]))
    around = sum(geod.geometry_length(ring) for ring in rings)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(18 * area, rel=1e-4)
    assert mesh.area == pytest.approx(2 * area + 18 * around, rel=1e-4)


def test_objects_come_one_after_the_other_with_five_vertices_a_corner() -> None:
    foot, top = np.zeros(len(SHAPES)), np.full(len(SHAPES), 9.0)
    prisms = extrude(SHAPES, foot, top)
    for k, shape in enumerate(SHAPES):
        rings = shapely.get_rings(shapely.get_parts(np.array([shape])))
        corners = shapely.get_num_coordinates(rings).sum() - len(rings)
        v0, v1 = prisms.vertex_start[k : k + 2]
        t0, t1 = prisms.triangle_start[k : k + 2]
        assert v1 - v0 == CORNER_VERTICES * corners
        assert prisms.triangles[t0:t1].min() >= v0
        assert prisms.triangles[t0:t1].max() < v1
        alone = extrude(SHAPES[k : k + 1], foot[:1], top[:1])
        assert np.array_equal(alone.triangles + v0, prisms.triangles[t0:t1])


def test_normals_are_those_of_the_faces_and_walls_follow_the_vertical() -> None:
    prisms = extrude(SHAPES, np.zeros(len(SHAPES)), np.full(len(SHAPES), 20.0))
    corner = prisms.ecef[prisms.triangles]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    size = np.linalg.norm(across, axis=1)
    stored = prisms.vertices["normal"][prisms.triangles[:, 0], :3] / 127
    assert ((across / size[:, None] * stored).sum(axis=1) > 0.99).all()
    up = geodesy.up(prisms.lon_rad, prisms.lat_rad)
    wall = prisms.vertices["flags"] == WALL
    flat = prisms.vertices["normal"][:, :3] / 127
    assert np.abs((flat * up).sum(axis=1)[wall]).max() < 0.02
    assert (flat * up).sum(axis=1)[~wall].min() > 0.99


def test_detail_counts_decimetres_from_the_ground() -> None:
    foot, top = np.array([5.0, 0.0]), np.array([17.34, 9000.0])
    prisms = extrude(SHAPES[:2], foot, top, np.array([8.0, 5000.0]))
    rise = np.ascontiguousarray(prisms.vertices["detail"][:, 0]).view(np.int16)
    first = slice(prisms.vertex_start[0], prisms.vertex_start[1])
    assert set(rise[first].tolist()) == {-30, 93}
    assert (rise[first] == -30).sum() == 2 * 6
    assert (rise.min(), rise.max()) == (-32768, 32767)
    without = extrude(SHAPES[:1], foot[:1], top[:1]).vertices["detail"][:, 0]
    assert set(without.tolist()) == {0, 123}


def test_the_roof_covers_the_footprint_once() -> None:
    prisms = extrude(SHAPES, np.zeros(len(SHAPES)), np.full(len(SHAPES), 3.0))
    roof = prisms.vertices["flags"][prisms.triangles[:, 0]] == ROOF
    place = np.degrees(np.column_stack((prisms.lon_rad, prisms.lat_rad)))
    faces = shapely.polygons(place[prisms.triangles[roof]])
    owner = np.searchsorted(prisms.vertex_start, prisms.triangles[roof][:, 0], "right") - 1
    for k, shape in enumerate(SHAPES):
        assert shapely.area(faces[owner == k]).sum() == pytest.approx(shape.area, rel=1e-6)


corner = st.tuples(st.integers(0, 40), st.integers(0, 40))


@given(st.lists(corner, min_size=3, max_size=10), st.floats(0.5, 300))
def test_any_repaired_ring_gives_the_volume_of_its_area(
    ring: list[tuple[int, int]], rise_m: float
) -> None:
    shape = placed(shapely.Polygon(ring))
    if shape[0] is None:
        return
    prisms = extrude(shape, np.zeros(1), np.array([rise_m]))
    mesh = mesh_of(prisms, 0, floor=True)
    assert mesh.volume == pytest.approx(rise_m * area_m2(shape)[0], rel=2e-3)
