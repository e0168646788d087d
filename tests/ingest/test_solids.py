# SPDX-License-Identifier: Apache-2.0
"""Solids: what was put in comes out, stands on the ground and mixes with prisms."""

import numpy as np
import pytest
import shapely
import trimesh

from ingest.extrude import Prisms, extrude
from ingest.repair import metres_per_degree
from ingest.solids import (
    MAX_SOLID_VERTICES,
    Solid,
    decode_solid,
    encode_solid,
    mixed,
    solid_prisms,
    widths_m,
)
from tiles.mesh import ROOF, WALL

LON, LAT = np.array([4.36]), np.array([52.0])


def box_solid(east_m: float, north_m: float, up_m: float) -> Solid:
    """Return trimesh's box on the ground, its floor taken out, flat-shaded."""
    mesh = trimesh.creation.box((east_m, north_m, up_m))
    mesh.apply_translation((0, 0, up_m / 2))
    mesh.update_faces(mesh.face_normals[:, 2] > -0.5)
    mesh.unmerge_vertices()
    up = np.repeat(mesh.face_normals[:, 2] > 0.5, 3)
    kind = np.where(up, ROOF, WALL).astype(np.uint8)
    place = mesh.vertices.astype(np.float32)
    return Solid(place, kind, mesh.faces.astype(np.uint16), up_m)


def test_a_solid_comes_back_as_it_was() -> None:
    solid = box_solid(12.0, 9.0, 7.5)
    back = decode_solid(encode_solid(solid))
    assert np.array_equal(back.place, solid.place)
    assert np.array_equal(back.kind, solid.kind)
    assert np.array_equal(back.triangles, solid.triangles)
    assert back.roof_m == solid.roof_m


@pytest.mark.parametrize("cut", [0, 3, 20, -1])
def test_bytes_cut_off_are_no_solid(cut: int) -> None:
    with pytest.raises(ValueError, match="not a solid"):
        decode_solid(encode_solid(box_solid(1, 1, 1))[:cut])


def test_a_triangle_needs_vertices_that_are_there() -> None:
    solid = box_solid(1, 1, 1)
    far = solid.triangles.copy()
    far[0, 0] = len(solid.place)
    with pytest.raises(ValueError, match="not there"):
        decode_solid(encode_solid(Solid(solid.place, solid.kind, far, 1.0)))


def test_too_many_vertices_are_refused() -> None:
    many = MAX_SOLID_VERTICES + 1
    none = np.zeros((0, 3), np.uint16)
    solid = Solid(np.zeros((many, 3), np.float32), np.zeros(many, np.uint8), none, 0.0)
    with pytest.raises(ValueError, match="vertices"):
        encode_solid(solid)


def test_a_width_is_twice_the_farthest_reach() -> None:
    solid = box_solid(12.0, 30.0, 7.5)
    off = Solid(solid.place + np.float32([4, 0, 0]), solid.kind, solid.triangles, 7.5)
    assert widths_m([encode_solid(solid), encode_solid(off)]).tolist() == [30.0, 30.0]


def test_a_box_is_drawn_like_its_footprint_raised() -> None:
    size = (12.0, 9.0, 7.5)
    body = encode_solid(box_solid(*size))
    solid = solid_prisms([body], LON, LAT, np.array([40.0]), np.array([2.0]))
    middle = np.concatenate((LON, LAT))
    half = np.array([12.0, 9.0]) / 2 / np.concatenate(metres_per_degree(LAT))
    foot = shapely.box(*(middle - half), *(middle + half))
    heights = np.array([38.0]), np.array([47.5]), np.array([40.0])
    prism = extrude(np.array([foot], object), *heights)
    assert solid.height_m.min() == 38.0
    assert solid.height_m.max() == 47.5
    for flag in (WALL, ROOF):
        ours = solid.vertices[solid.vertices["flags"] == flag]
        theirs = prism.vertices[prism.vertices["flags"] == flag]
        assert set(ours["detail"][:, 0].tolist()) == set(theirs["detail"][:, 0].tolist())
        known = theirs["normal"][:, :3].astype(int)
        for normal in ours["normal"][:, :3].astype(int):
            assert np.abs(known - normal).max(axis=1).min() <= 1
    assert np.abs(np.ptp(solid.ecef, axis=0) - np.ptp(prism.ecef, axis=0)).max() < 1e-5


def test_only_what_is_at_the_foot_goes_down_by_the_plinth() -> None:
    solid = box_solid(4, 4, 3)
    low = solid.place[:, 2] == 0
    lifted = solid.place.copy()
    lifted[np.flatnonzero(low)[0], 2] = 0.06
    body = encode_solid(Solid(lifted, solid.kind, solid.triangles, 3.0))
    found = solid_prisms([body], LON, LAT, np.array([10.0]), np.array([1.5]))
    at = np.unique(found.height_m.round(3))
    assert at.tolist() == [8.5, 10.06, 13.0]


def pieces(prisms: Prisms, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, places and triangles of one mesh, by plain slicing."""
    v0, v1 = prisms.vertex_start[k : k + 2]
    t0, t1 = prisms.triangle_start[k : k + 2]
    return prisms.vertices[v0:v1], prisms.ecef[v0:v1], prisms.triangles[t0:t1] - v0


def test_mixing_keeps_every_mesh_and_puts_it_in_its_place() -> None:
    random = np.random.default_rng(4)
    lon, lat = random.uniform(-1, 1, 5), random.uniform(50, 51, 5)
    squares = shapely.buffer(shapely.points(lon, lat), 1e-4, cap_style="square")
    prisms = extrude(np.asarray(squares, object), np.zeros(5), np.arange(5.0) + 3)
    bodies = [encode_solid(box_solid(3 + k, 4, 5)) for k in range(4)]
    solids = solid_prisms(bodies, lon[:4], lat[:4], np.zeros(4), np.ones(4))
    where = random.permutation(9)
    both = mixed(prisms, where[:5], solids, where[5:])
    for source, k, place in [
        *((prisms, k, where[k]) for k in range(5)),
        *((solids, k, where[5 + k]) for k in range(4)),
    ]:
        for ours, theirs in zip(pieces(both, place), pieces(source, k), strict=True):
            assert np.array_equal(ours, theirs)


@pytest.mark.parametrize("count", [0, 1])
def test_nothing_mixes_with_anything(count: int) -> None:
    none, every = np.zeros(0, np.int64), np.arange(count)
    solids = solid_prisms(
        [encode_solid(box_solid(3, 4, 5))] * count,
        *(np.zeros(count) for _ in range(4)),
    )
    empty = extrude(np.zeros(0, object), np.zeros(0), np.zeros(0))
    assert np.array_equal(mixed(empty, none, solids, every).triangles, solids.triangles)
    assert np.array_equal(mixed(solids, every, empty, none).vertices, solids.vertices)
