# SPDX-License-Identifier: Apache-2.0
"""Heights of the finest stored meshes are within their stated errors of the sources."""

import json
from pathlib import Path

import numpy as np
import pytest

from geopage.cli import main
from ingest.terrain import ingest_rasters
from tests.ingest.rasters import (
    EGM96,
    Floats,
    geoid_m,
    places_in,
    source_height_m,
)
from tests.tiles.places import uv_in_cell
from tiles import cells, terrain
from tiles.errors import TileFault
from tiles.geodesy import to_geodetic
from tiles.index_tree import rung_errors_m
from tiles.lanes import Lane
from tiles.mesh import UV_ONE
from tiles.samples import SAMPLES
from tiles.store import Store
from tiles.surface import Surface
from tiles.writer import Writer

FEATHER_DEG = 0.045


def truth_m(path: Path, lon_deg: Floats, lat_deg: Floats) -> Floats:
    return source_height_m(path, lon_deg, lat_deg) + geoid_m(lon_deg, lat_deg)


def test_heights_of_the_inset_are_within_the_stated_error(
    nested_folder: Path, rng: np.random.Generator
) -> None:
    inset = nested_folder / "inset.tif"
    lon, lat = places_in(inset, 2000, rng)
    with Store(nested_folder / "world.geopage") as store:
        height, error = Surface(store).heights(np.radians(lon), np.radians(lat))
    gap = np.abs(height - truth_m(inset, lon, lat))
    assert (gap <= error).all()
    assert np.median(error) < 30  # an error that allows everything would prove nothing


def test_heights_of_the_coarse_source_are_within_the_stated_error(
    nested_folder: Path, rng: np.random.Generator
) -> None:
    coarse, inset = nested_folder / "coarse.tif", nested_folder / "inset.tif"
    lon, lat = places_in(coarse, 2000, rng)
    around = [
        np.isfinite(source_height_m(inset, lon + a * FEATHER_DEG, lat + b * FEATHER_DEG))
        for a in np.linspace(-1, 1, 9)
        for b in np.linspace(-1, 1, 9)
    ]
    far = ~np.logical_or.reduce(around)
    assert far.sum() > 200
    lon, lat = lon[far], lat[far]
    with Store(nested_folder / "world.geopage") as store:
        height, error = Surface(store).heights(np.radians(lon), np.radians(lat))
    gap = np.abs(height - truth_m(coarse, lon, lat))
    assert (gap <= error).all()
    assert np.median(error) < 100


@pytest.mark.slow
def test_geopage_sample_agrees_with_the_san_francisco_file(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    dem, store = SAMPLES / "sanfrancisco.tif", tmp_path / "sf.geopage"
    ingest_rasters(store, [(dem, EGM96)], workers=1)
    lon, lat = places_in(dem, 400, rng)
    points = tmp_path / "points.csv"
    lines = [f"{b:.12f},{a:.12f}" for a, b in zip(lon, lat, strict=True)]
    points.write_text("\n".join(["lat_deg,lon_deg", *lines]))
    assert main(["sample", str(store), "--points", str(points), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["points"]
    height = np.array([one["height_m"] for one in found])
    error = np.array([one["error_m"] for one in found])
    assert (np.abs(height - truth_m(dem, lon, lat)) <= error).all()
    assert np.median(error) < 2.0
    assert {one["source"] for one in found} == {"sanfrancisco"}


def test_geopage_sample_warns_of_heights_that_may_be_far_off(
    nested_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store, points = str(nested_folder / "world.geopage"), tmp_path / "points.csv"
    points.write_text("lat_deg,lon_deg\n46.12,11.15\n46.6,10.8\n46.5,10.8\n-40,0\n")
    words = ["sample", store, "--points", str(points)]
    assert main([*words, "--json"]) == 0
    said = capsys.readouterr()
    fine, coarse, _, nothing = json.loads(said.out)["points"]
    assert said.err == ""
    assert fine["source"] == "inset"
    assert fine["error_m"] <= 10
    assert "warning" not in fine
    assert coarse["error_m"] > 10
    assert "of coarse, which are 2," in coarse["warning"]
    assert nothing["source"] is None
    assert "no source" in nothing["warning"]
    assert main(words) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert sum("(2 of 4 places)" in line for line in lines) == 1


def test_every_place_of_the_globe_has_a_leaf(
    nested_folder: Path, rng: np.random.Generator
) -> None:
    lon, lat = rng.uniform(-7, 7, 1000), np.arcsin(rng.uniform(-1, 1, 1000))
    edge = np.array([(-np.pi, 0), (np.pi, 0), (0, np.pi / 2), (0, -np.pi / 2), (0, 0)])
    lon, lat = np.concatenate([lon, edge[:, 0]]), np.concatenate([lat, edge[:, 1]])
    with Store(nested_folder / "world.geopage") as store:
        surface = Surface(store)
        height, error = surface.heights(lon, lat)
    assert (surface.rows(lon, lat) >= 0).all()
    assert np.isfinite(height).all()
    assert np.isfinite(error).all()


def searched_m(store: Store, surface: Surface, row: int, lon: float, lat: float) -> float:
    """Look through all triangles of a tile, in numpy, and turn the point back."""
    record = surface.forest.records[row]
    key = int(record["cell"]), int(record["row"]), int(record["check"])
    tile = terrain.decode(store.checked_body(Lane.TERRAIN, *key))
    u, v = uv_in_cell(tile.cell, lon, lat)
    triangles = tile.mesh.indices[: tile.surface_index_count].reshape(-1, 3)
    uv, at = tile.mesh.vertices["detail"][triangles] / UV_ONE, np.array([u, v])
    for pole, edge in zip(cells.bounds_rad(tile.cell)[1::2], (0.0, 1.0), strict=True):
        if abs(pole) > cells.POLAR_RAD:  # there the cell's meridians meet
            for one in (uv, at):
                one[..., 0] = 0.5 + (one[..., 0] - 0.5) * np.abs(edge - one[..., 1])
    uv -= at
    ahead, behind = np.roll(uv, -1, axis=1), np.roll(uv, -2, axis=1)
    weight = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    area = weight.sum(axis=1, keepdims=True)
    weight = np.divide(weight, area, out=np.full_like(weight, -np.inf), where=area > 0)
    best = int(np.argmax(weight.min(axis=1)))
    point = weight[best] @ tile.mesh.local[triangles[best]] + tile.mesh.centre
    return float(to_geodetic(point)[2])


def some_places(folder: Path, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Places all over the globe, many on the inset, and corners of cells."""
    lon, lat = places_in(folder / "inset.tif", 60, rng)
    lon = np.concatenate([np.radians(lon), rng.uniform(-np.pi, np.pi, 60)])
    lat = np.concatenate([np.radians(lat), np.arcsin(rng.uniform(-1, 1, 60))])
    edge = np.array([(-np.pi, 0.3), (np.pi, 0.3), (0, np.pi / 2), (0, -np.pi / 2), (0, 0)])
    return np.concatenate([lon, edge[:, 0]]), np.concatenate([lat, edge[:, 1]])


def test_heights_are_those_of_a_search_through_all_triangles(
    nested_folder: Path, rng: np.random.Generator
) -> None:
    lon, lat = some_places(nested_folder, rng)
    with Store(nested_folder / "world.geopage") as store:
        surface = Surface(store)
        rows = surface.rows(lon, lat)
        expected = [
            searched_m(store, surface, *one) for one in zip(rows, lon, lat, strict=True)
        ]
        assert np.abs(surface.heights(lon, lat)[0] - expected).max() < 1e-6


def test_rows_are_the_cells_that_hold_the_places(
    nested_folder: Path, rng: np.random.Generator
) -> None:
    lon, lat = some_places(nested_folder, rng)
    with Store(nested_folder / "world.geopage") as store:
        surface = Surface(store)
    rows = surface.rows(lon, lat)
    assert (surface.forest.records["children"][rows] == 0).all()
    place = cells.cell_at(lon, lat, cells.MAX_LEVEL)
    assert cells.contains(surface.forest.records["cell"][rows], place).all()
    with pytest.raises(ValueError, match="not a finite"):
        surface.rows(np.array([np.nan]), np.zeros(1))


def test_heights_at_a_level_are_those_of_its_tiles_or_of_leaves_above(
    nested_folder: Path, rng: np.random.Generator
) -> None:
    lon, lat = some_places(nested_folder, rng)
    with Store(nested_folder / "world.geopage") as store:
        surface = Surface(store)
        records = surface.forest.records
        leaf = cells.level(records["cell"][surface.rows(lon, lat)])
        for level in (0, 3, int(leaf.max()), cells.MAX_LEVEL):
            cell = cells.cell_at(lon, lat, np.minimum(leaf, level))
            rows = surface.forest.row_of(cell)
            height, error = surface.heights_at_level(lon, lat, level)
            assert error.tolist() == records["error_m"][rows].tolist()
            expected = [
                searched_m(store, surface, *one)
                for one in zip(rows[::7], lon[::7], lat[::7], strict=True)
            ]
            assert np.abs(height[::7] - expected).max() < 1e-6


def test_the_lowest_coarser_terrain_is_that_of_the_tiles_within_the_error(
    nested_folder: Path, rng: np.random.Generator
) -> None:
    lon, lat = some_places(nested_folder, rng)
    within = np.where(np.arange(len(lon)) % 3 > 0, 10 ** rng.uniform(2, 5, len(lon)), 0)
    with Store(nested_folder / "world.geopage") as store:
        surface = Surface(store)
        expected = np.full(len(lon), np.inf)
        for level in range(cells.MAX_LEVEL):
            rows = surface.rows(lon, lat)
            leaf = cells.level(surface.forest.records["cell"][rows])
            above = surface.forest.row_of(cells.cell_at(lon, lat, np.minimum(level, leaf)))
            height = surface.heights_at_level(lon, lat, level)[0]
            counts = (level < leaf) & (surface.selected_m[above] <= within)
            expected = np.where(counts, np.minimum(expected, height), expected)
        rungs_m = rung_errors_m(surface.forest.records)
        assert np.isfinite(rungs_m[rows]).any()
        inner = 0
        for level in range(cells.MAX_LEVEL):
            at_most = np.minimum(level, leaf)
            here = surface.forest.row_of(cells.cell_at(lon, lat, at_most))
            reached = (level >= leaf) | (surface.selected_m[here] <= within)
            for rung in (1, 2, 3):
                height = surface.heights_in(here, lon, lat, rung)
                counts = reached & (rungs_m[here, rung - 1] <= within)
                inner += (counts & (level < leaf)).sum()
                expected = np.where(counts, np.minimum(expected, height), expected)
        assert inner > 0
        assert surface.lowest(lon, lat, within).tolist() == expected.tolist()
    assert 0.1 < np.isfinite(expected).mean() < 0.9


def test_a_store_without_terrain_answers_zero_with_an_infinite_error(
    tmp_path: Path,
) -> None:
    Writer(tmp_path / "empty.geopage").close()
    with Store(tmp_path / "empty.geopage") as store:
        surface = Surface(store)
        height, error = surface.heights(np.zeros(2), np.zeros(2))
        low = surface.lowest(np.zeros(2), np.zeros(2), np.full(2, np.inf))
        at_level = surface.heights_at_level(np.zeros(2), np.zeros(2), 3)
    assert height.tolist() == [0, 0] == at_level[0].tolist()
    assert np.isinf([*error, *low, *at_level[1]]).all()


def test_a_changed_tile_is_refused(nested_folder: Path, tmp_path: Path) -> None:
    store_path = tmp_path / "changed.geopage"
    with Store(nested_folder / "world.geopage") as store, Writer(store_path) as copy:
        store.connection.backup(copy.connection)
        copy.connection.execute("UPDATE tile SET body = CAST(body || x'00' AS BLOB)")
    with Store(store_path) as store, pytest.raises(TileFault, match="checksum"):
        Surface(store).height_at(0.2, 0.8)
