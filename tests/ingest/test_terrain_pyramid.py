# SPDX-License-Identifier: Apache-2.0
"""The pyramid of tiles: complete, monotone, and honest about its errors."""

from pathlib import Path

import numpy as np
import pytest

from tiles import cells, geodesy, terrain, zones
from tiles.forest import Forest, build_forest
from tiles.frames import Floats
from tiles.lanes import Lane
from tiles.mesh import UV_ONE
from tiles.store import Store
from tiles.surface import Surface
from tiles.terrain import TerrainTile


@pytest.fixture(scope="module")
def forest(nested_folder: Path) -> Forest:
    with Store(nested_folder / "world.geopage") as store:
        return build_forest(store.index(Lane.TERRAIN))


def tile_of(store: Store, record: np.void) -> TerrainTile:
    return terrain.decode(store.body(int(record["row"])))


def test_every_zone_has_a_root_and_every_cell_none_or_four_children(forest: Forest) -> None:
    level = cells.level(forest.records["cell"])
    assert (level == 0).sum() == zones.COUNT
    assert set((forest.children >= 0).sum(axis=1)) == {0, 4}
    assert (forest.records["row"] > 0).all()
    assert (forest.parent[level > 0] >= 0).all()


def test_errors_never_grow_downwards(forest: Forest) -> None:
    error, parent = forest.records["error_m"], forest.parent
    below = parent >= 0
    assert (error[below] <= error[parent[below]]).all()
    assert (error > 0).all()


def test_bounds_hold_every_vertex(nested_folder: Path, forest: Forest) -> None:
    with Store(nested_folder / "world.geopage") as store:
        for record in forest.records[:: max(1, len(forest.records) // 60)]:
            mesh = tile_of(store, record).mesh
            reach = np.linalg.norm(mesh.local + mesh.centre - record["centre"], axis=1)
            assert reach.max() <= record["radius_m"] + mesh.scale_m
            height = geodesy.to_geodetic(mesh.local + mesh.centre)[2]
            assert height.min() >= record["min_height_m"] - 2 * mesh.scale_m
            assert height.max() <= record["max_height_m"] + 2 * mesh.scale_m


def drawn(tile: TerrainTile, uv: Floats) -> Floats:
    """Points of a tile's triangles at fractions of its cell, ECEF, by brute force."""
    triangles = tile.mesh.indices[: tile.surface_index_count].reshape(-1, 3).astype(int)
    at = tile.mesh.vertices["detail"] / UV_ONE
    a, b, c = np.moveaxis(at[triangles], 1, 0)
    out = np.full((len(uv), 3), np.nan)
    for i, place in enumerate(uv):
        matrix = np.stack([b - a, c - a], axis=-1)
        weights = np.linalg.solve(matrix, (place - a)[..., None])[..., 0]
        weights = np.column_stack([1 - weights.sum(axis=1), weights])
        inside = int(np.argmax(weights.min(axis=1)))
        out[i] = weights[inside] @ tile.mesh.local[triangles[inside]]
    return out + tile.mesh.centre


def test_inner_errors_bound_the_distance_to_the_finest_surface(
    nested_folder: Path, forest: Forest, rng: np.random.Generator
) -> None:
    inner = np.flatnonzero(forest.children[:, 0] >= 0)
    assert len(inner) > 5
    with Store(nested_folder / "world.geopage") as store:
        surface = Surface(store)
        for row in inner:
            record = forest.records[row]
            uv = rng.uniform(size=(60, 2))
            west, south, east, north = cells.bounds_rad(record["cell"])
            lon, lat = west + uv[:, 0] * (east - west), south + uv[:, 1] * (north - south)
            leaf_rows = surface.rows(lon, lat)
            coarse = drawn(tile_of(store, record), uv)
            fine = np.full_like(coarse, np.nan)
            for leaf in np.unique(leaf_rows):
                at = leaf_rows == leaf
                leaf_tile = tile_of(store, surface.forest.records[leaf])
                place = np.stack(cells.uv_in_cell(leaf_tile.cell, lon[at], lat[at]), axis=1)
                fine[at] = drawn(leaf_tile, place)
            gap = np.linalg.norm(coarse - fine, axis=1)
            assert gap.max() <= record["error_m"]


def test_edges_of_neighbours_meet_within_their_errors(
    nested_folder: Path, rng: np.random.Generator
) -> None:
    """Walk over shared edges of leaves: heights on both sides are both near the truth."""
    with Store(nested_folder / "world.geopage") as store:
        surface = Surface(store)
        leaves = surface.forest.records[surface.forest.children[:, 0] < 0]
        for record in leaves[:: max(1, len(leaves) // 60)]:
            west, south, _, north = cells.bounds_rad(record["cell"])
            lat = rng.uniform(south, north, 5)
            inside, e1 = surface.heights(np.full(5, west + 1e-12), lat)
            beyond, e2 = surface.heights(np.full(5, west - 1e-12), lat)
            assert (np.abs(inside - beyond) <= e1 + e2).all()
