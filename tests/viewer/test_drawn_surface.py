# SPDX-License-Identifier: Apache-2.0
"""Distances to drawn triangles, against every triangle one by one."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tiles.posts import shortest
from tests.viewer.worlds import one_colour, terrain_tile
from tiles import cells, geodesy
from tiles.terrain import TerrainTile
from viewer.drawn_surface import LEAF, boxes_of, distances_to, holders, join


def tiles(count: int = 4, level: int = 7) -> list[TerrainTile]:
    first = cells.cell_at(0.2, 0.8, level)
    row, col = cells.global_row_col(first)
    made = [cells.from_global(level, row, col + k) for k in range(count)]

    def rough(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        return 900 * np.sin(lon * 900) * np.cos(lat * 1100)

    return [terrain_tile(int(cell), one_colour((9, 9, 9)), 9, rough) for cell in made]


def triangles(tile: TerrainTile) -> np.ndarray:
    indices = tile.mesh.indices[: tile.surface_index_count].reshape(-1, 3)
    return np.asarray((tile.mesh.local + tile.mesh.centre)[indices])


@pytest.mark.parametrize("known", [False, True])
def test_distances_are_those_of_brute_force(rng: np.random.Generator, known: bool) -> None:  # noqa: FBT001
    drawn = tiles()
    every = np.concatenate([triangles(tile) for tile in drawn])
    points = every[rng.integers(len(every), size=100)].mean(axis=1)
    points = points + rng.normal(size=(100, 3)) * rng.choice([1.0, 500.0, 2e4], (100, 1))
    expected = np.array([shortest(every, point) for point in points])
    hint = rng.integers(4, size=100) if known else np.full(100, -1)
    limit = np.where(known, expected * 3 + 1, np.full(100, np.inf))
    surface = join([boxes_of(tile) for tile in drawn])
    found = distances_to(surface, points, hint, limit, np.zeros(100))
    assert np.allclose(found, expected, rtol=1e-9, atol=1e-6)


def test_the_tile_of_a_place_is_the_one_whose_cell_holds_it(
    rng: np.random.Generator,
) -> None:
    drawn = tiles()
    surface = join([boxes_of(tile) for tile in drawn[::-1]])
    west, south, east, north = cells.bounds_rad(np.array([tile.cell for tile in drawn]))
    share = rng.uniform(size=(2, 4))
    lon, lat = west + share[0] * (east - west), south + share[1] * (north - south)
    points = geodesy.to_ecef(lon, lat, 700.0)
    assert holders(surface, points).tolist() == [3, 2, 1, 0]
    away = geodesy.to_ecef(np.array([lon[0], 2.0]), np.array([-0.7, 0.5]), 0.0)
    assert holders(surface, away).tolist() == [-1, -1]


def test_a_known_bound_comes_back_where_nothing_is_nearer() -> None:
    drawn = tiles(1)
    surface = join([boxes_of(tile) for tile in drawn])
    point = drawn[0].mesh.centre[None] * 1.01
    hint, enough = np.zeros(1, np.int64), np.zeros(1)
    found = distances_to(surface, point, hint, np.array([5.0]), enough)
    assert found.tolist() == [5.0]


def test_every_box_holds_its_triangles_and_skirts_are_left_out() -> None:
    tile = tiles(1)[0]
    boxes = boxes_of(tile)
    leaves = len(boxes.boxes) // 2
    corners = boxes.corners.reshape(leaves, LEAF, 3, 3)
    known = corners[np.isfinite(corners).all(axis=(2, 3))]
    assert len(known) == tile.surface_index_count // 3 == 128
    for node in range(1, 2 * leaves):
        depth = int(np.log2(node))
        side = leaves >> depth
        part = corners[(node - (1 << depth)) * side :][:side].reshape(-1, 3)
        assert (np.nanmin(part, axis=0) == boxes.boxes[node, :3]).all()
        assert (np.nanmax(part, axis=0) == boxes.boxes[node, 3:]).all()


def test_a_single_triangle_is_a_tree(rng: np.random.Generator) -> None:
    tile = replace(tiles(1)[0], surface_index_count=3)
    surface = join([boxes_of(tile)])
    points = triangles(tile).mean(axis=1) + rng.normal(size=(5, 3)) * 1000
    found = distances_to(surface, points, np.full(5, -1), np.full(5, np.inf), np.zeros(5))
    assert np.allclose(found, [shortest(triangles(tile), p) for p in points])
