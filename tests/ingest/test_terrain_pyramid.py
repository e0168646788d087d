# SPDX-License-Identifier: Apache-2.0
"""The pyramid of tiles: complete, monotone, and honest about its errors."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from ingest.terrain import ingest_rasters
from ingest.terrain_tile import LARGEST_BOUND_M
from tests.ingest.rasters import (
    EGM96,
    ELLIPSOID,
    UTM,
    coarse,
    hills,
    north_up,
    own_surface_m,
    places_deg,
    places_in,
    post_places_deg,
    source_height_m,
    write,
)
from tests.tiles.places import uv_in_cell
from tiles import cells, geodesy, terrain, zones
from tiles.check import faults_of
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
            if np.abs(cells.bounds_rad(record["cell"])[1::2]).max() > 1.57:
                continue  # at a pole, straight lines of a cell are bent on the ground
            uv = rng.uniform(size=(60, 2))
            west, south, east, north = cells.bounds_rad(record["cell"])
            lon, lat = west + uv[:, 0] * (east - west), south + uv[:, 1] * (north - south)
            leaf_rows = surface.rows(lon, lat)
            drawn_here = drawn(tile_of(store, record), uv)
            fine = np.full_like(drawn_here, np.nan)
            for leaf in np.unique(leaf_rows):
                at = leaf_rows == leaf
                leaf_tile = tile_of(store, surface.forest.records[leaf])
                place = np.stack(uv_in_cell(leaf_tile.cell, lon[at], lat[at]), axis=1)
                fine[at] = drawn(leaf_tile, place)
            gap = np.linalg.norm(drawn_here - fine, axis=1)
            # Both are measured against the sources.
            slack_m = surface.forest.records["error_m"][leaf_rows]
            assert (gap <= record["error_m"] + slack_m).all()


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


class World(NamedTuple):
    """A store, and the sources in it, finest last."""

    store: Path
    files: list[Path]
    spacings_m: list[float]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Three sources in three systems: degrees, metres of UTM, and over the antimeridian."""
    folder = tmp_path_factory.mktemp("pyramid")
    files = [
        coarse(folder / "coarse.tif"),
        write(
            folder / "fine.tif",
            hills((220, 200), 0.6, 300.0),
            north_up(656_000.0, 5_130_000.0, 200.0),
            UTM,
        ),
        write(
            folder / "east.tif",
            hills((200, 220), 1.0, 150.0),
            north_up(3.2e6 + 40_000, -1.7e6, 1500.0),
            "EPSG:3832",
        ),
    ]
    ingest_rasters(folder / "a.geopage", [(one, EGM96) for one in files], workers=1)
    with Store(folder / "a.geopage") as store:
        named = {source["name"]: source["spacing_m"] for source in store.sources()}
    return World(folder / "a.geopage", files, [named[one.stem] for one in files])


def box_deg(path: Path) -> tuple[float, float, float, float]:
    """Return where a file bends the coarse one, 0.03 degrees around its posts included."""
    lon, lat = post_places_deg(path)
    low, high = lon.min() - 0.03, lon.max() + 0.03
    return low, lat.min() - 0.03, high, lat.max() + 0.03


def owned(path: Path, cell: int, others: list[Path]) -> bool:
    """Say whether a cell lies on one file's posts alone."""
    steps = np.linspace(0, 1, 30)
    uv = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    place = places_deg(cell, uv)
    alone = all(np.isnan(source_height_m(other, *place)).all() for other in others)
    return alone and bool(np.isfinite(source_height_m(path, *place)).all())


def test_leaves_on_one_sources_posts_keep_a_hundredth_of_its_spacing(world: World) -> None:
    with Store(world.store) as store:
        forest = build_forest(store.index(Lane.TERRAIN))
        steps = {s["name"]: s["vertical_step_m"] for s in store.sources()}
    leaves = forest.records[forest.children[:, 0] < 0]
    for k, path in enumerate(world.files):
        finer = [p for p in world.files[k + 1 :] if k == 0]
        source_m = max(world.spacings_m[k] / 100, steps[path.stem] / 2)
        count = 0
        for record in leaves:
            cell = int(record["cell"])
            if owned(path, cell, finer):
                edge_m = float(geodesy.cell_edge_m(cell))
                assert record["error_m"] <= min(source_m, edge_m / 256) * (1 + 1e-6)
                count += 1
        assert count >= 1


def test_inner_cells_keep_as_close_as_their_texels(world: World) -> None:
    """Also those above the parts, which have a lattice only: sources are small here."""
    with Store(world.store) as store:
        forest = build_forest(store.index(Lane.TERRAIN))
    inner = forest.records[forest.children[:, 0] >= 0]
    allowed = np.minimum(geodesy.cell_edge_m(inner["cell"]) / 256, LARGEST_BOUND_M)
    over = inner["error_m"] > allowed * (1 + 1e-6)
    assert len(inner) > 20
    assert not over.any(), [
        (cells.text(one["cell"]), float(one["error_m"])) for one in inner[over]
    ]


def test_every_source_is_met_within_the_errors_that_are_stated(
    world: World, rng: np.random.Generator
) -> None:
    """Posts by rasterio, places by PROJ, the geoid by PROJ at the posts."""
    with Store(world.store) as store:
        surface = Surface(store)
        for k, path in enumerate(world.files):
            lon, lat = places_in(path, 10_000, rng)
            truth = own_surface_m(path, lon, lat, egm96=True)
            if k == 0:
                keep = np.isnan(source_height_m(world.files[1], lon, lat))
                lon, lat, truth = lon[keep], lat[keep], truth[keep]
                # The coarse source bends to meet the fine one, by one of its own posts.
                west, south, east, north = box_deg(world.files[1])
                far = (lon < west) | (lon > east) | (lat < south) | (lat > north)
                lon, lat, truth = lon[far], lat[far], truth[far]
            known = np.isfinite(truth)
            found, error_m = surface.heights(np.radians(lon), np.radians(lat))
            off = np.abs(found - truth)[known]
            # Where a leaf reaches beyond its source, posts are not the source's alone.
            assert known.sum() > 5000
            assert (off <= error_m[known]).mean() > 0.999
            assert np.median(error_m[known]) <= world.spacings_m[k] / 100 * (1 + 1e-6)


def test_flat_ground_and_sea_take_few_tiles_within_the_bound(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    posts = np.zeros((400, 400), np.float32)
    posts[150:250, 150:250] = hills((100, 100), 1.0, 200.0)
    where = north_up(20.0, 40.0, 0.005)
    flat = write(tmp_path / "flat.tif", posts, where, "EPSG:4326")
    full = write(tmp_path / "full.tif", hills((400, 400), 1.0, 200.0), where, "EPSG:4326")
    counts = []
    for path in (flat, full):
        store = path.with_suffix(".geopage")
        ingest_rasters(store, [(path, ELLIPSOID)], workers=1)
        with Store(store) as opened:
            surface = Surface(opened)
            counts.append(len(surface.forest.records))
            lon, lat = rng.uniform(20.1, 21.9, 3000), rng.uniform(38.1, 39.9, 3000)
            truth = own_surface_m(path, lon, lat, egm96=False)
            found, error_m = surface.heights(np.radians(lon), np.radians(lat))
            assert (np.abs(found - truth) <= error_m).all()
            assert error_m.max() <= 556.6 / 100
    assert counts[0] - 32 < 0.7 * (counts[1] - 32)


def test_a_source_far_away_leaves_tiles_alone_and_errors_true(
    world: World, tmp_path: Path
) -> None:
    grown = tmp_path / "grown.geopage"
    ingest_rasters(grown, [(one, EGM96) for one in world.files[:2]], workers=1)
    with Store(grown) as store:
        before = {int(one["cell"]): one for one in store.index(Lane.TERRAIN)}
    ingest_rasters(grown, [(world.files[2], EGM96)], workers=1)
    with Store(grown) as store, Store(world.store) as whole:
        after = {int(one["cell"]): one for one in store.index(Lane.TERRAIN)}
        fresh = {int(one["cell"]): one for one in whole.index(Lane.TERRAIN)}
        assert list(faults_of(store)) == []
    assert after.keys() == fresh.keys()
    for cell, one in after.items():
        assert one["error_m"] == pytest.approx(fresh[cell]["error_m"], rel=1e-5)
    zone = int(cells.cell_at(np.radians(11), np.radians(46), 0))
    mine = [cell for cell in before if cells.contains(zone, cell)]
    assert len(mine) > 10
    for cell in mine:
        assert after[cell]["row"] == before[cell]["row"]
