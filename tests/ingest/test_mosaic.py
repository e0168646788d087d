# SPDX-License-Identifier: Apache-2.0
"""Nested sources make one surface without cliffs, holes or seams."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ingest.mosaic import Mosaic
from ingest.terrain import RasterOptions, editing, plan
from ingest.terrain import copy as copy_source
from tests.ingest.rasters import (
    EGM96,
    STEP,
    Floats,
    geoid_m,
    hills,
    north_up,
    places_in,
    source_height_m,
    write,
)
from tiles.store import Store

ELLIPSOID = RasterOptions(datum="ellipsoid")


def mosaic_of(
    store: Path, files: list[tuple[Path, RasterOptions]]
) -> tuple[Mosaic, sqlite3.Connection]:
    with editing(store) as writer:
        quiet = lambda done, total, what: None  # noqa: E731
        sources = [copy_source(writer, plan(*one), quiet) for one in files]
    connection = sqlite3.connect(store)
    return Mosaic(connection, sources), connection


@pytest.fixture
def nested(nested_folder: Path) -> Iterator[Mosaic]:
    with Store(nested_folder / "world.geopage") as store:
        yield Mosaic(store.connection, store.sources())


def heights(
    mosaic: Mosaic, lon_deg: Floats, lat_deg: Floats, step_m: float = 0.0
) -> Floats:
    return mosaic.heights(np.radians(lon_deg), np.radians(lat_deg), step_m)


def test_inside_the_finer_source_nothing_is_changed(
    nested: Mosaic, nested_folder: Path, rng: np.random.Generator
) -> None:
    inset = nested_folder / "inset.tif"
    lon, lat = places_in(inset, 2000, rng)
    truth = source_height_m(inset, lon, lat) + geoid_m(lon, lat)
    np.testing.assert_allclose(heights(nested, lon, lat), truth, atol=2e-3)


def test_beyond_the_feather_nothing_is_changed(
    nested: Mosaic, nested_folder: Path, rng: np.random.Generator
) -> None:
    coarse = nested_folder / "coarse.tif"
    lon, lat = places_in(coarse, 3000, rng)
    # The inset is 11.1 to 11.24 E, 46.07 to 46.15 N; the feather one coarse post.
    far = (lon < 11.06) | (lon > 11.28) | (lat < 46.03) | (lat > 46.19)
    lon, lat = lon[far], lat[far]
    truth = source_height_m(coarse, lon, lat) + geoid_m(lon, lat)
    # The datum is applied at the posts; between coarse posts the geoid bends a little.
    np.testing.assert_allclose(heights(nested, lon, lat), truth, atol=0.02)


def test_the_surface_has_no_cliff_at_the_rim(nested: Mosaic, nested_folder: Path) -> None:
    """Walk over the rim in steps of 10 m; the sources differ by hundreds of metres."""
    steepest = []
    for lat in np.linspace(46.08, 46.145, 14):
        lon = np.arange(11.05, 11.30, 10 / 77_000)
        walk = heights(nested, lon, np.full(len(lon), lat))
        steepest.append(np.abs(np.diff(walk)).max())
    inset = nested_folder / "inset.tif"
    inner = np.arange(11.12, 11.2, 10 / 77_000)
    own = source_height_m(inset, inner, np.full(len(inner), 46.1))
    own_step = np.nanmax(np.abs(np.diff(own)))
    coarse = source_height_m(
        nested_folder / "coarse.tif", inner, np.full(len(inner), 46.15)
    )
    jump = np.abs(np.nanmean(own) - np.nanmean(coarse))
    assert jump > 100
    # Between two rim posts the delta surface can't know the source's own edge.
    assert max(steepest) < 5 * own_step
    assert max(steepest) < jump / 2


def test_no_data_falls_through_to_the_coarser_source(tmp_path: Path) -> None:
    low = write(
        tmp_path / "low.tif",
        np.full((40, 40), 100, np.float32),
        north_up(10, 47, 0.05),
        "EPSG:4326",
    )
    posts = np.full((60, 60), 300, np.float32)
    posts[20:40, 20:40] = -1
    high = write(tmp_path / "high.tif", posts, north_up(10.5, 46.5, 0.01), "EPSG:4326", -1)
    mosaic, connection = mosaic_of(
        tmp_path / "w.geopage", [(low, ELLIPSOID), (high, ELLIPSOID)]
    )
    hole = np.array([10.8]), np.array([46.2])
    near_rim = np.array([10.6955]), np.array([46.205])
    assert heights(mosaic, *near_rim)[0] == pytest.approx(300, abs=5)
    # The coarser surface there, lifted all round: the hole is narrower than the feather.
    assert 100 <= heights(mosaic, *hole)[0] <= 300
    outside = np.array([10.2]), np.array([46.8])
    assert heights(mosaic, *outside)[0] == pytest.approx(100, abs=1e-6)
    connection.close()


@pytest.fixture
def globe(tmp_path: Path) -> Iterator[Mosaic]:
    posts = hills((90, 180), 1.0, 500.0)
    path = write(tmp_path / "globe.tif", posts, north_up(-180, 90, 2.0), "EPSG:4326")
    mosaic, connection = mosaic_of(tmp_path / "globe.geopage", [(path, EGM96)])
    yield mosaic
    connection.close()


@pytest.mark.parametrize("step_m", [0.0, 500e3, 2000e3])
def test_a_globe_has_no_seam_at_the_antimeridian(globe: Mosaic, step_m: float) -> None:
    lat = np.linspace(-88, 88, 100)
    west = heights(globe, np.full(100, -180 + 1e-9), lat, step_m)
    east = heights(globe, np.full(100, 180 - 1e-9), lat, step_m)
    np.testing.assert_allclose(west, east, atol=1e-3)
    np.testing.assert_allclose(
        heights(globe, np.full(100, 180.0), lat, step_m), east, atol=1e-3
    )


@pytest.mark.parametrize("step_m", [0.0, 500e3])
def test_a_globe_has_one_height_at_each_pole(globe: Mosaic, step_m: float) -> None:
    for pole in (-90.0, 90.0):
        whole = heights(globe, np.linspace(-180, 180, 73), np.full(73, pole), step_m)
        apart = [
            heights(globe, np.array([lon]), np.array([pole]), step_m)[0]
            for lon in (-170.0, 3.0, 99.0)
        ]
        assert np.ptp(np.concatenate([whole, apart])) < 1e-6


def test_towards_a_pole_the_surface_is_continuous(globe: Mosaic) -> None:
    lat = np.linspace(88.0, 90.0, 2001)
    for lon in (-180.0, -33.3, 0.0, 120.1):
        walk = heights(globe, np.full(len(lat), lon), lat)
        assert np.abs(np.diff(walk)).max() < 5


def test_a_band_around_the_globe_meets_the_coarser_source_without_a_cliff(
    tmp_path: Path,
) -> None:
    low = write(
        tmp_path / "low.tif",
        np.zeros((45, 90), np.float32),
        north_up(-180, 90, 4),
        "EPSG:4326",
    )
    band = write(
        tmp_path / "band.tif",
        np.full((60, 180), 400, np.float32),
        north_up(-180, 60, 2),
        "EPSG:4326",
    )
    mosaic, connection = mosaic_of(
        tmp_path / "w.geopage", [(low, ELLIPSOID), (band, ELLIPSOID)]
    )
    for lon in (-180.0, -179.9, 0.3, 77.7, 179.99):
        lat = np.linspace(50, 70, 4001)
        walk = heights(mosaic, np.full(len(lat), lon), lat)
        assert walk[0] == 400
        assert walk[-1] == 0
        assert np.abs(np.diff(walk)).max() < 40
    connection.close()


def test_without_any_source_the_surface_is_the_sea(tmp_path: Path) -> None:
    mosaic, connection = mosaic_of(tmp_path / "w.geopage", [])
    lon, lat = np.array([0.0, 100.0]), np.array([10.0, -45.0])
    np.testing.assert_allclose(heights(mosaic, lon, lat), geoid_m(lon, lat), atol=1e-4)
    connection.close()


def test_a_long_rim_is_thinned_evenly(tmp_path: Path) -> None:
    posts = np.full((1500, 1500), 200, np.float32)
    path = write(tmp_path / "big.tif", posts, north_up(10, 46, STEP / 50), "EPSG:4326")
    mosaic, connection = mosaic_of(tmp_path / "w.geopage", [(path, ELLIPSOID)])
    rim = mosaic.rims[0]
    assert rim is not None
    foot = rim.foot.T.astype(float) + rim.middle
    assert 2500 < len(foot) <= 4000
    lon = np.degrees(np.arctan2(foot[:, 1], foot[:, 0]))
    sides = [(lon < lon.min() + 1e-4).sum(), (lon > lon.max() - 1e-4).sum()]
    assert min(sides) > 500
    connection.close()
