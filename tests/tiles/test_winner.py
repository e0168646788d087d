# SPDX-License-Identifier: Apache-2.0
"""The source of a place is decided by posts, not by boxes."""

from pathlib import Path

import numpy as np
import pytest
import rasterio

from ingest.terrain import RasterOptions, ingest_rasters
from tests.ingest.rasters import (
    SIDE,
    STEP,
    WEST,
    Floats,
    north_up,
    pixels,
    source_height_m,
    write,
)
from tiles.geodesy import to_ecef
from tiles.placement import Placement
from tiles.places import Places
from tiles.store import Store
from tiles.winner import Winners


@pytest.fixture(scope="module")
def everywhere() -> tuple[Floats, Floats]:
    """Places in and around both rasters."""
    rng = np.random.default_rng(5)
    return rng.uniform(11.05, 11.3, 1500), rng.uniform(46.0, 46.2, 1500)


def test_the_finest_source_with_data_wins(
    nested_folder: Path, everywhere: tuple[Floats, Floats]
) -> None:
    fine = np.isfinite(source_height_m(nested_folder / "inset.tif", *everywhere))
    col, row = pixels(nested_folder / "inset.tif", *everywhere)
    without_data = (col > 0) & (col < 49) & (row > 0) & (row < 39) & ~fine
    assert without_data.sum() > 5
    with Store(nested_folder / "world.geopage") as store:
        winners = Winners(store)
        found = [one.source for one in winners.at(*np.radians(everywhere))]
        assert winners.at(np.zeros(1), np.zeros(1)) == [(None, False)]
    assert found == np.where(fine, "inset", "coarse").tolist()


def test_feathered_is_what_lies_within_reach_of_finer_posts(
    nested_folder: Path, everywhere: tuple[Floats, Floats]
) -> None:
    with rasterio.open(nested_folder / "inset.tif") as dataset:
        row, col = np.nonzero(dataset.read_masks(1))
    with Store(nested_folder / "world.geopage") as store:
        inset = next(s for s in store.sources() if s["name"] == "inset")
        winners = Winners(store)
        found = [one.feathered for one in winners.at(*np.radians(everywhere))]
    posts = to_ecef(*Placement(inset).places(col.astype(float), row.astype(float)), 0.0)
    places = to_ecef(*np.radians(everywhere), 0.0)
    away = np.array([np.linalg.norm(posts - one, axis=1).min() for one in places])
    outside = np.isnan(source_height_m(nested_folder / "inset.tif", *everywhere))
    reach_m = inset["reach_m"]
    assert reach_m > 1000
    wanted = outside & (away <= reach_m)
    assert wanted.sum() > 200
    # The search is in halved posts, 200 m here at the finest.
    sure = np.abs(away - reach_m) > 400
    assert (np.array(found) == wanted)[sure].all()
    assert not np.array(found)[~outside].any()


def test_of_two_alike_the_later_one_wins(tmp_path: Path) -> None:
    where = north_up(11, 46, 0.01)
    files = [
        write(tmp_path / f"{name}.tif", np.full((9, 9), 5, np.float32), where, "EPSG:4326")
        for name in ("one", "other")
    ]
    ellipsoid = RasterOptions(datum="ellipsoid")
    ingest_rasters(tmp_path / "w.geopage", [(f, ellipsoid) for f in files], workers=1)
    with Store(tmp_path / "w.geopage") as store:
        place = np.radians([[11.045], [45.955]])
        assert [one.source for one in Winners(store).at(*place)] == ["other"]


def test_a_source_beside_a_finer_one_is_feathered_over_a_post_of_its_own(
    tmp_path: Path,
) -> None:
    """Though the finer one's feather, over the coarsest of the three, reaches over it."""
    placed = {"low": (12, 6, 1 / 6), "a": (20, 7.0, 9e-4), "b": (20, 7.0185, 6e-4)}
    files = []
    for name, (count, west, step) in placed.items():
        where = north_up(west, 45.0 if name == "low" else 44.0, step)
        posts = np.full((count, count), 500, np.float32)
        files.append(write(tmp_path / f"{name}.tif", posts, where, "EPSG:4326"))
    ellipsoid = RasterOptions(datum="ellipsoid")
    ingest_rasters(tmp_path / "w.geopage", [(f, ellipsoid) for f in files], workers=1)
    with Store(tmp_path / "w.geopage") as store:
        lon = np.radians([7.005, 7.0165, 7.0174])
        assert [tuple(one) for one in Winners(store).at(lon, np.full(3, 0.76782))] == [
            ("a", False),
            ("a", False),
            ("a", True),
        ]


def test_a_sample_names_the_winner(nested_folder: Path) -> None:
    with Store(nested_folder / "world.geopage") as store:
        lon, lat = np.array([11.17, WEST + SIDE * STEP / 2]), np.array([46.11, 46.4])
        inside, outside = Places(store).at(lon, lat)
    assert (inside["source"], inside["feathered"]) == ("inset", False)
    assert (outside["source"], outside["feathered"]) == ("coarse", False)
