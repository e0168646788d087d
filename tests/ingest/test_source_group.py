# SPDX-License-Identifier: Apache-2.0
"""Sources of one spacing, as the tiles of a survey are, make one surface."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ingest.mosaic import Mosaic
from tests.ingest.rasters import Floats, hills, north_up, source_height_m, write
from tests.ingest.test_mosaic import ELLIPSOID, heights, mosaic_of

FINE = 0.002
World = Callable[..., Mosaic]


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    """Open tiles from 45.2 N, each from a longitude, over a coarse source."""
    opened = []

    def world_of(
        tiles: dict[str, tuple[Floats, float]], north: float = 45.2, **norths: float
    ) -> Mosaic:
        low = np.full((40, 60), 1000, np.float32)
        files = [write(tmp_path / "low.tif", low, north_up(10, 46, 0.04), "EPSG:4326")]
        for name, (posts, west) in tiles.items():
            path = tmp_path / f"{name}.tif"
            where = north_up(west, norths.get(name, north), FINE)
            files.append(write(path, posts.astype(np.float32), where, "EPSG:4326"))
        with_datum = [(file, ELLIPSOID) for file in files]
        mosaic, connection = mosaic_of(tmp_path / "w.geopage", with_datum)
        opened.append(connection)
        return mosaic

    yield world_of
    for connection in opened:
        connection.close()


@pytest.fixture
def relief() -> Floats:
    return hills((100, 201), 0.3, 200.0).astype(np.float64)


def largest_step(mosaic: Mosaic, lon: Floats, lat: Floats) -> float:
    return float(np.abs(np.diff(heights(mosaic, lon, lat))).max())


def test_tiles_that_share_a_row_of_posts_are_both_unchanged(
    world: World, tmp_path: Path, relief: Floats, rng: np.random.Generator
) -> None:
    tiles = {"a": (relief[:, :101], 11.0), "b": (relief[:, 100:], 11.2)}
    mosaic = world(tiles)
    lon, lat = rng.uniform(11.002, 11.398, 4000), rng.uniform(45.002, 45.198, 4000)
    found = heights(mosaic, lon, lat)
    for name in tiles:
        truth = source_height_m(tmp_path / f"{name}.tif", lon, lat)
        own = np.isfinite(truth)
        assert own.sum() > 1500
        np.testing.assert_allclose(found[own], truth[own], atol=2e-3)


def test_tiles_meet_the_coarser_source_over_its_own_post_spacing(
    world: World, relief: Floats
) -> None:
    mosaic = world({"a": (relief[:, :101], 11.0), "b": (relief[:, 100:], 11.2)})
    assert mosaic.reach_m(mosaic.layers[1]) == mosaic.layers[0].spacing_m > 4000
    lat = np.arange(45.19, 45.25, 1e-6)
    for lon in (11.05, 11.1995, 11.201, 11.3333):
        walk = heights(mosaic, np.full(len(lat), lon), lat)
        # A tenth of a metre northwards; relief of 1 in 2 is steep, a cliff is not that.
        assert np.abs(np.diff(walk)).max() < 0.2
        assert np.ptp(walk) > 200
        assert walk[-1] == pytest.approx(1000, abs=40)


def test_a_gap_of_one_post_between_tiles_is_bridged(
    world: World, tmp_path: Path, relief: Floats
) -> None:
    mosaic = world({"a": (relief[:, :100], 11.0), "b": (relief[:, 100:], 11.2)})
    lon = np.arange(11.19, 11.21, 1e-6)
    for lat in (45.05, 45.1234):
        walk = heights(mosaic, lon, np.full(len(lon), lat))
        assert np.abs(np.diff(walk)).max() < 0.5
        whole = write(
            tmp_path / "whole.tif", relief, north_up(11.0, 45.2, FINE), "EPSG:4326"
        )
        truth = source_height_m(whole, lon, np.full(len(lon), lat))
        assert np.abs(walk - truth).max() < 25


def test_where_surveys_overlap_the_later_wins_and_they_meet(
    world: World, tmp_path: Path, relief: Floats
) -> None:
    tiles = {"a": (relief[:, :120], 11.0), "b": (relief[:, 80:] + 30.0, 11.16)}
    mosaic = world(tiles)
    lon, lat = np.array([11.2, 11.1]), np.array([45.1, 45.1])
    b = source_height_m(tmp_path / "b.tif", lon, lat)
    a = source_height_m(tmp_path / "a.tif", lon, lat)
    np.testing.assert_allclose(heights(mosaic, lon, lat), [b[0], a[1]], atol=2e-3)
    walk = np.arange(11.15, 11.17, 1e-6)
    assert largest_step(mosaic, walk, np.full(len(walk), 45.0777)) < 0.3


def test_no_pit_opens_where_the_rims_of_two_surveys_cross(
    world: World, tmp_path: Path, rng: np.random.Generator
) -> None:
    """An edge of the later one ends there where the earlier one has no data."""
    flat = np.full((50, 50), 3000.0)
    mosaic = world({"a": (flat, 11.0), "b": (flat + 8.0, 11.0307)}, b=45.2313)
    lon, lat = rng.uniform(11.0, 11.14, 200_000), rng.uniform(45.1, 45.24, 200_000)
    names = [tmp_path / f"{name}.tif" for name in "ab"]
    known = np.isfinite([source_height_m(one, lon, lat) for one in names]).any(axis=0)
    found = heights(mosaic, lon[known], lat[known])
    assert known.sum() > 50_000
    assert found.min() > 2999
    assert found.max() < 3009
