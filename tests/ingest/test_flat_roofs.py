# SPDX-License-Identifier: Apache-2.0
"""Prisms with flat roofs between bodies and boxes: how far off, and where they stand."""

import numpy as np
import pytest
import shapely
import trimesh

from ingest.extrude import Prisms
from ingest.flat_roofs import flat_roofs, roofs_of
from ingest.object_pyramid import Buildings
from ingest.repair import metres_per_degree
from ingest.shapes import Shapes, dimensions_m
from ingest.solids import Solid, encode_solid
from tests.ingest.pyramids import Built, build
from tiles import cells
from tiles.frames import Floats
from tiles.mesh import ROOF, WALL

LON, LAT = 4.27, 52.1
SCALE = np.array(metres_per_degree(np.array([LAT]))).ravel()
GROUND_M = 20.0


def house(size: tuple[float, float], heights: tuple[float, float], over: float) -> bytes:
    """Return a gabled house: eaves and ridge, a roof that overhangs, without its floor."""
    (w, d), (eaves, ridge) = np.array(size) / 2, heights
    low = [(-w, -d, 0), (w, -d, 0), (w, d, 0), (-w, d, 0)]
    wall = [
        [low[k], low[(k + 1) % 4], (*low[(k + 1) % 4][:2], eaves), (*low[k][:2], eaves)]
        for k in range(4)
    ]
    gable = [
        [(s * w, -s * d, eaves), (s * w, s * d, eaves), (s * w, 0, ridge)] for s in (1, -1)
    ]
    drop = over * (ridge - eaves) / d
    a, b = w + over, d + over
    roof = [
        [
            (-s * a, -s * b, eaves - drop),
            (s * a, -s * b, eaves - drop),
            (s * a, 0, ridge),
            (-s * a, 0, ridge),
        ]
        for s in (1, -1)
    ]
    place, kind, faces = [], [], []
    for polygon, flag in [(one, WALL) for one in wall + gable] + [(r, ROOF) for r in roof]:
        first = len(place)
        place += polygon
        kind += [flag] * len(polygon)
        faces += [(first, first + k, first + k + 1) for k in range(1, len(polygon) - 1)]
    return encode_solid(
        Solid(np.float32(place), np.uint8(kind), np.uint16(faces), (eaves + ridge) / 2)
    )


def rectangle(middle_m: Floats, size: tuple[float, float]) -> shapely.Polygon:
    half = np.array(size) / 2
    low, high = (middle_m - half) / SCALE, (middle_m + half) / SCALE
    middle = np.array([LON, LAT])
    return shapely.box(*(low + middle), *(high + middle))


def town(rng: np.random.Generator, count: int, step_m: float = 25.0) -> Buildings:
    """Return gabled houses in rows, every tenth a flat one without a body of its own."""
    across = int(np.ceil(np.sqrt(count)))
    polygon, solid, top = [], [], []
    for k in range(count):
        size = tuple(rng.uniform(8, 14, 2))
        eaves = rng.uniform(4, 8)
        ridge = eaves + rng.uniform(1.0, 4.0)
        middle = step_m * np.array([k % across, k // across]) + rng.normal(0, 2, 2)
        polygon.append(rectangle(middle, size))
        over = float(rng.choice([0.0, 0.5]))
        solid.append(None if k % 10 == 9 else house(size, (eaves, ridge), over))
        top.append(GROUND_M + (ridge if k % 10 != 9 else eaves))
    shape = np.array(polygon, object)
    ground, level = np.full(count, GROUND_M), np.zeros((count, 2))
    body = np.fromiter(solid, object, count)
    shapes = Shapes(shape, ground - 1, ground, np.array(top), body, level)
    return Buildings(np.arange(count), dimensions_m(shape, shapes.top_m - ground), shapes)


def mesh_m(prisms: Prisms, k: int) -> trimesh.Trimesh:
    """Return a mesh in metres east, north and above the ground."""
    v, t = prisms.vertex_start[k : k + 2], prisms.triangle_start[k : k + 2]
    deg = np.degrees(np.column_stack((prisms.lon_rad, prisms.lat_rad)))[slice(*v)]
    place = np.column_stack(((deg - (LON, LAT)) * SCALE, prisms.height_m[slice(*v)]))
    place[:, 2] -= GROUND_M
    return trimesh.Trimesh(place, prisms.triangles[slice(*t)] - v[0], process=False)


def roof_m(mesh: trimesh.Trimesh, xy: np.ndarray) -> Floats:
    """Return the highest point of a mesh above each place, -inf beside it."""
    high = np.full(len(xy), -np.inf)
    for corner in mesh.triangles[mesh.face_normals[:, 2] > 0.1]:
        bary = trimesh.triangles.points_to_barycentric(
            np.repeat(np.insert(corner[None, :, :2], 2, 0, axis=2), len(xy), axis=0),
            np.column_stack((xy, np.zeros(len(xy)))),
        )
        inside = (bary > -1e-9).all(axis=1)
        high = np.where(inside, np.maximum(high, bary @ corner[:, 2]), high)
    return high


def off_m(a: trimesh.Trimesh, b: trimesh.Trimesh, rng: np.random.Generator) -> float:
    """Return how far points of `a` above the ground are from what `b` fills, or from it."""
    share = rng.dirichlet((0.5, 0.5, 0.5), (len(a.triangles), 60))
    points = np.einsum("tpk,tkd->tpd", share, a.triangles).reshape(-1, 3)
    points = points[points[:, 2] > 0]
    near = trimesh.proximity.closest_point_naive(b, points)[1]
    inside = points[:, 2] <= roof_m(b, points[:, :2])
    return float(np.where(inside, 0.0, np.minimum(near, points[:, 2])).max())


def test_the_error_is_no_less_than_a_dense_sample_of_both_and_little_more(
    rng: np.random.Generator,
) -> None:
    shapes = town(rng, 8).shapes
    prisms = shapes.prisms()
    solids = shapes.solids(prisms)
    flat, error_m = flat_roofs(shapes, solids, roofs_of(shapes, prisms, solids))
    drawn = flat.prisms()
    for k in range(8):
        real, prism = mesh_m(prisms, k), mesh_m(drawn, k)
        found = max(off_m(real, prism, rng), off_m(prism, real, rng))
        assert found <= error_m[k] + 1e-3
        assert error_m[k] <= 1.4 * found + 1.5


def test_a_roof_that_is_not_whole_has_no_prism_instead() -> None:
    size = (12.0, 10.0)
    polygon = np.array([rectangle(np.zeros(2), size)] * 2, object)
    body = np.fromiter([house(size, (5, 8), 0.0), None], object, 2)
    top = np.array([28.0, 28.0])
    ground, level = np.full(2, GROUND_M), np.zeros((2, 2))
    shapes = Shapes(polygon, ground, ground, top, body, level)
    prisms = shapes.prisms()
    solids = shapes.solids(prisms)
    roofs = roofs_of(shapes, prisms, solids)
    assert roofs.up_m2 == pytest.approx([120, 0], rel=1e-3)
    assert roofs.low_m[0] == pytest.approx(25, abs=0.01)
    whole = flat_roofs(shapes, solids, roofs)[1]
    holed = flat_roofs(shapes, solids, roofs._replace(up_m2=roofs.up_m2 / 2))[1]
    assert np.isfinite(whole).all()
    assert np.isinf(holed).tolist() == [True, False]


@pytest.fixture(scope="module")
def built() -> Built:
    return build(town(np.random.default_rng(5), 700), 100_000)


def test_from_afar_roofs_are_flat_and_farther_away_they_are_boxes(built: Built) -> None:
    holders = [cell for cell, tile in built.tiles.items() if len(tile.proxies)]
    prisms, leaves, boxes = 0, 0, 0
    for cell in holders:
        tile = built.tiles[cell]
        for proxy in tile.proxies:
            child = cells.children(cell)[proxy["child"]]
            which = slice(int(proxy["index_start"]), int(proxy["index_end"]))
            drawn = np.unique(tile.mesh.indices[which])
            roofs = (tile.mesh.vertices["flags"][drawn] == ROOF).sum() / 4
            if cells.contains(child, np.array(holders)).any():
                assert roofs < proxy["count"] / 2
                boxes += 1
                continue
            leaves += 1
            if roofs == proxy["count"] and int(child) in built.tiles:
                bodies = len(built.tiles[int(child)].mesh.indices)
                assert which.stop - which.start < 0.8 * bodies
                prisms += 1
    assert prisms > 0.8 * leaves > 10
    assert boxes > 2


def test_the_error_grows_from_prisms_to_boxes(built: Built) -> None:
    for cell, tile in built.tiles.items():
        for proxy in tile.proxies:
            child = built.tiles.get(int(cells.children(cell)[proxy["child"]]))
            below = 0.0 if child is None else child.proxies["error_m"].max(initial=0)
            assert proxy["error_m"] >= below
            assert proxy["error_m"] > 0.5
