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
from tiles.errors import TileFault
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


def test_a_store_without_terrain_answers_zero_with_an_infinite_error(
    tmp_path: Path,
) -> None:
    Writer(tmp_path / "empty.geopage").close()
    with Store(tmp_path / "empty.geopage") as store:
        height, error = Surface(store).heights(np.zeros(2), np.zeros(2))
    assert height.tolist() == [0, 0]
    assert np.isinf(error).all()


def test_a_changed_tile_is_refused(nested_folder: Path, tmp_path: Path) -> None:
    store_path = tmp_path / "changed.geopage"
    with Store(nested_folder / "world.geopage") as store, Writer(store_path) as copy:
        store.connection.backup(copy.connection)
        copy.connection.execute("UPDATE tile SET body = CAST(body || x'00' AS BLOB)")
    with Store(store_path) as store, pytest.raises(TileFault, match="checksum"):
        Surface(store).height_at(0.2, 0.8)
