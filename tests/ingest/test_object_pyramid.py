# SPDX-License-Identifier: Apache-2.0
"""The objects lane as a whole: tiles, proxies and the index that decides about them."""

import numpy as np
import pytest
import shapely
import trimesh

from ingest.object_pyramid import Buildings
from ingest.repair import repair
from ingest.shapes import Shapes, dimensions_m
from tests.ingest.pyramids import Built, both, build, renumbered
from tiles import cells, geodesy
from tiles.codec import checksum
from tiles.index_tree import is_monotone
from tiles.lanes import Lane
from tiles.mesh import ROOF
from tiles.objects import PROXY_ORDINAL, prefix_end

DEGREE_M = 111_194.0


def city(rng: np.random.Generator, count: int, lon: float, lat: float) -> Buildings:
    """Rectangles and L shapes of 6 to 30 m around a place, and two large halls."""
    east = np.cos(np.radians(lat))
    at = rng.normal(0, 500, (count, 2))
    size = rng.uniform(6, 30, (count, 2))
    size[:2] = (300, 180)
    shapes = []
    for (x, y), (w, h) in zip(at, size, strict=True):
        ring = [(0, 0), (w, 0), (w, h / 2), (w / 2, h / 2), (w / 2, h), (0, h)]
        places = [
            (lon + (x + a) / DEGREE_M / east, lat + (y + b) / DEGREE_M) for a, b in ring
        ]
        shapes.append(shapely.Polygon(places))
    polygon = repair(np.array(shapes, object)).polygon
    ground = 50 + at[:, 0] / 50
    height = rng.uniform(3, 40, count)
    none = np.full(count, None, object)
    flat = np.zeros((count, 2))
    shapes = Shapes(polygon, ground - 1, ground, ground + height, none, flat)
    return Buildings(np.arange(count), dimensions_m(polygon, height), shapes)


@pytest.fixture(scope="module", params=[100_000, 150], ids=["one branch", "branches"])
def built(request: pytest.FixtureRequest) -> Built:
    rng = np.random.default_rng(7)
    # One town across a corner of four zones, one inside a zone, and a farm.
    buildings = both(city(rng, 500, 0.0, 45.0), city(rng, 400, 7.4, 43.73))
    buildings = both(buildings, city(rng, 2, 12.6, 43.8))
    buildings = renumbered(buildings, rng.permutation(902) + 1000)
    return build(buildings, request.param)


def test_every_building_is_in_one_tile_once_largest_first(built: Built) -> None:
    found = np.concatenate([tile.objects["id"] for tile in built.tiles.values()])
    assert sorted(found.tolist()) == sorted(built.buildings.id.tolist())
    for cell, tile in built.tiles.items():
        by_id = np.argsort(built.buildings.id)
        order = by_id[np.searchsorted(built.buildings.id[by_id], tile.objects["id"])]
        assert (built.cell[order] == cell).all()
        sizes = built.buildings.dimension_m[order]
        assert np.allclose(tile.objects["dimension_m"], sizes, rtol=1e-6)
        assert (np.diff(tile.objects["dimension_m"]) <= 0).all()


def test_a_prefix_of_the_indices_draws_what_is_larger_than_a_threshold(
    built: Built,
) -> None:
    tile = max(built.tiles.values(), key=lambda tile: len(tile.objects))
    threshold = float(np.median(tile.objects["dimension_m"]))
    end = prefix_end(tile.objects, threshold)
    drawn = np.unique(tile.mesh.vertices["detail"][tile.mesh.indices[:end], 1])
    assert (
        drawn.tolist() == np.flatnonzero(tile.objects["dimension_m"] > threshold).tolist()
    )


def test_a_buildings_roof_is_where_its_footprint_is(built: Built) -> None:
    for tile in list(built.tiles.values())[::20]:
        ecef = tile.mesh.local + tile.mesh.centre
        lon, lat, height = geodesy.to_geodetic(ecef)
        for ordinal, record in enumerate(tile.objects):
            k = int(np.flatnonzero(built.buildings.id == record["id"])[0])
            mine = tile.mesh.vertices["detail"][:, 1] == ordinal
            roof = mine & (tile.mesh.vertices["flags"] == ROOF)
            corners = shapely.get_coordinates(built.buildings.shapes.polygon[k])[:-1]
            place = np.degrees(np.column_stack((lon, lat)))[roof]
            assert np.abs(place - corners).max() * DEGREE_M < 3 * tile.mesh.scale_m
            top, foot = built.buildings.shapes.top_m[k], built.buildings.shapes.foot_m[k]
            assert np.abs(height[roof] - top).max() < 3 * tile.mesh.scale_m
            assert abs(height[mine].min() - foot) < 3 * tile.mesh.scale_m
            away = np.linalg.norm(tile.mesh.local[mine] - record["centre"], axis=1)
            assert away.max() <= record["radius_m"] + 2 * tile.mesh.scale_m


def test_proxies_come_after_the_objects_and_stand_for_one_child_each(built: Built) -> None:
    held = 0
    for cell, tile in built.tiles.items():
        end = int(tile.objects["index_end"][-1]) if len(tile.objects) else 0
        for proxy in tile.proxies:
            assert proxy["index_start"] == end
            end = int(proxy["index_end"])
            used = tile.mesh.indices[proxy["index_start"] : end]
            assert (tile.mesh.vertices["detail"][used, 1] == PROXY_ORDINAL).all()
            child = cells.children(cell)[proxy["child"]]
            assert proxy["count"] == cells.contains(child, built.cell).sum()
            held += 1
        assert end == len(tile.mesh.indices)
        assert len(set(tile.proxies["child"].tolist())) == len(tile.proxies)
    assert held > 20


def test_a_tile_with_proxies_has_one_for_every_child(built: Built) -> None:
    records = built.forest.records
    for row in np.flatnonzero(records["row"] > 0):
        tile = built.tiles[int(records["cell"][row])]
        children = [k for k in range(4) if records["children"][row] >> k & 1]
        if len(tile.proxies):
            assert sorted(tile.proxies["child"].tolist()) == children
        elif children:
            assert records["radius_m"][row] > 40_000


def test_each_town_is_one_proxy_from_far_away(built: Built) -> None:
    at = np.radians((7.4, 43.73))
    towns = cells.cell_at(*at, np.arange(cells.MAX_LEVEL + 1))
    rows = built.forest.row_of(towns)
    rows = rows[rows >= 0]
    with_tile = rows[built.forest.records["row"][rows] > 0]
    top = built.tiles[int(built.forest.records["cell"][with_tile[0]])]
    assert len(top.proxies) == 1
    assert top.proxies["count"][0] == 400
    assert len(top.objects) == 0
    assert top.proxies["dimension_m"][0] > 400


def test_errors_and_dimensions_never_grow_downwards(built: Built) -> None:
    forest, records = built.forest, built.forest.records
    assert is_monotone(records, forest.parent).all()
    below = forest.parent >= 0
    for name in ("subtree_dimension_m", "proxy_dimension_m"):
        assert (records[name][below] <= records[name][forest.parent[below]]).all()
    for row, record in enumerate(records):
        if record["row"] == 0:
            assert record["own_dimension_m"] == 0
            continue
        tile = built.tiles[int(record["cell"])]
        assert record["own_dimension_m"] == tile.objects["dimension_m"].max(initial=0)
        assert record["error_m"] == tile.proxies["error_m"].max(initial=0)
        for proxy in tile.proxies:
            child = records[forest.children[row][proxy["child"]]]
            assert proxy["error_m"] >= child["error_m"]


def test_a_cells_sphere_and_heights_hold_all_that_is_drawn_at_or_below_it(
    built: Built,
) -> None:
    for record in built.forest.records:
        for cell, tile in built.tiles.items():
            if cells.contains(record["cell"], cell):
                ecef = tile.mesh.local + tile.mesh.centre
                away = np.linalg.norm(ecef - record["centre"], axis=1)
                assert away.max() <= record["radius_m"]
                slack = 2 * tile.mesh.scale_m
                height = geodesy.to_geodetic(ecef)[2]
                assert height.min() >= record["min_height_m"] - slack
                assert height.max() <= record["max_height_m"] + slack


def test_the_index_is_connected_up_to_the_zone_roots(built: Built) -> None:
    forest, records = built.forest, built.forest.records
    assert (cells.level(records["cell"][forest.parent < 0]) == 0).all()
    mask = ((forest.children >= 0) << np.arange(4)).sum(axis=1)
    assert np.array_equal(mask, records["children"])
    leaf = records["children"] == 0
    assert (records["row"][leaf] > 0).all()


def test_the_index_names_each_tile_with_its_checksum_and_sizes(built: Built) -> None:
    for record in built.records[built.records["row"] > 0]:
        cell = int(record["cell"])
        body = built.bodies[cell]
        assert record["check"] == checksum(Lane.OBJECTS, cell, body)
        assert record["tile_bytes"] == len(body)
        assert record["memory_bytes"] >= built.tiles[cell].mesh.gpu_bytes
        children = sum(1 << int(k) for k in built.tiles[cell].proxies["child"])
        assert record["proxies"] == children


def test_a_proxys_error_is_no_less_than_how_far_roofs_are_off_it(built: Built) -> None:
    shapes, looked_at = built.buildings.shapes, 0
    for cell, tile in built.tiles.items():
        for proxy in tile.proxies[tile.proxies["count"] > 20]:
            child = cells.children(cell)[proxy["child"]]
            which = slice(int(proxy["index_start"]), int(proxy["index_end"]))
            faces = tile.mesh.local[tile.mesh.indices[which].reshape(-1, 3)]
            for k in np.flatnonzero(cells.contains(child, built.cell))[:4].tolist():
                corners = np.radians(shapely.get_coordinates(shapes.polygon[k]).T)
                roof = geodesy.to_ecef(*corners, shapes.top_m[k]) - tile.mesh.centre
                # Where nothing is drawn, the ground is: a house left out is off by its
                # height. A roof inside a box is not seen.
                off_m = min(shapes.top_m[k] - shapes.ground_m[k], distance_m(roof, faces))
                low, high = faces.min(axis=(0, 1)), faces.max(axis=(0, 1))
                if ((roof < low) | (roof > high)).any():
                    assert off_m <= proxy["error_m"]
                    looked_at += 1
    assert looked_at > 10


def distance_m(points: np.ndarray, faces: np.ndarray) -> float:
    """The largest distance of a point to the nearest of some triangles, by trimesh."""
    every = np.repeat(faces, len(points), axis=0), np.tile(points, (len(faces), 1))
    away = np.linalg.norm(trimesh.triangles.closest_point(*every) - every[1], axis=1)
    return float(away.reshape(len(faces), -1).min(axis=0).max())


def test_branches_hold_the_same_cells_and_tiles_below_the_crown() -> None:
    rng = np.random.default_rng(3)
    town = city(rng, 600, 7.4, 43.73)
    whole, cut = build(town, 10_000), build(town, 100)
    assert cut.branches > 4
    assert np.array_equal(whole.cell, cut.cell)
    assert whole.tiles.keys() == cut.tiles.keys()
    for cell, tile in whole.tiles.items():
        other = cut.tiles[cell]
        assert np.array_equal(tile.objects["id"], other.objects["id"])
        assert np.array_equal(tile.proxies["child"], other.proxies["child"])
        assert np.array_equal(tile.proxies["count"], other.proxies["count"])
    leaf = [cell for cell, tile in whole.tiles.items() if not len(tile.proxies)]
    assert all(whole.bodies[cell] == cut.bodies[cell] for cell in leaf)


def test_no_buildings_make_no_tiles() -> None:
    none = np.zeros(0)
    empty = build(Buildings(none.astype(int), none, Shapes.joined([])), 10)
    assert len(empty.records) == len(empty.tiles) == len(empty.cell) == 0
