# SPDX-License-Identifier: Apache-2.0
"""Nested sources make one surface without cliffs, holes or seams."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyproj
import pytest
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.terrain import RasterOptions
from ingest.truth import points_at, truth_of
from tests.ingest.rasters import (
    EGM96,
    STEP,
    UTM,
    Floats,
    coarse,
    geoid_m,
    hills,
    leaf_at,
    mosaic_of,
    north_up,
    places_deg,
    places_in,
    source_height_m,
    write,
)
from tiles import cells, geodesy
from tiles.frames import Ecef
from tiles.store import Store

ELLIPSOID = RasterOptions(datum="ellipsoid")


@pytest.fixture
def nested(nested_folder: Path) -> Iterator[Mosaic]:
    with Store(nested_folder / "world.geopage") as store:
        yield Mosaic(store.connection, store.sources())


@pytest.fixture
def along(monkeypatch: pytest.MonkeyPatch) -> None:
    """Posts here are degrees apart: what flat triangles cut off is left out."""
    monkeypatch.setattr("ingest.layer.CURVED_M", np.inf)


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


@pytest.mark.usefixtures("along")
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
    assert max(steepest) < 3 * own_step
    assert max(steepest) < jump / 2


@pytest.mark.usefixtures("along")
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


@pytest.mark.usefixtures("along")
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


def rough_inset(path: Path, rng: np.random.Generator) -> Path:
    """Write 300 x 250 posts 30 m apart, steep and noisy, with holes of all sizes."""
    posts = hills((250, 300), 0.08, 300.0) + rng.normal(size=(250, 300)) * 15 + 500
    posts[60:110, 80:150] = -9999
    for _ in range(20):
        row, col = rng.integers(0, 240), rng.integers(0, 290)
        posts[row : row + rng.integers(1, 12), col : col + rng.integers(1, 12)] = -9999
    posts[rng.random(posts.shape) < 0.002] = -9999
    x, y = pyproj.Transformer.from_crs(4326, UTM, always_xy=True).transform(11.1, 46.25)
    where = north_up(x, y, 30.0)
    return write(path, posts.astype(np.float32), where, UTM, -9999.0)


def across_the_rim(layer: Layer, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return places (2, n), pairs 4 mm apart just inside and just outside the posts."""

    def known(at: Floats) -> NDArray[np.bool_]:
        return np.isfinite(layer.heights(*layer.places(*at), 0.0))

    inside = rng.uniform(0, 250, (2, 60_000))
    turn = rng.uniform(0, 2 * np.pi, 60_000)
    outside = inside + 2.0 * np.stack([np.cos(turn), np.sin(turn)])
    pair = known(inside) & ~known(outside)
    inside, outside = inside[:, pair], outside[:, pair]
    for _ in range(14):
        middle = (inside + outside) / 2
        inner = known(middle)
        inside, outside = np.where(inner, middle, inside), np.where(inner, outside, middle)
    lon, lat = zip(layer.places(*inside), layer.places(*outside), strict=True)
    return np.stack(lon), np.stack(lat)


def test_a_rough_inset_meets_its_surroundings_everywhere(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """At any place of its rim, holes included, and over the coarser posts' folds."""
    low, high = coarse(tmp_path / "low.tif"), rough_inset(tmp_path / "high.tif", rng)
    mosaic, connection = mosaic_of(
        tmp_path / "w.geopage", [(low, ELLIPSOID), (high, ELLIPSOID)]
    )
    lon, lat = across_the_rim(mosaic.layers[1], rng)
    inside, outside = (mosaic.heights(a, b, 0.0) for a, b in zip(lon, lat, strict=True))
    step_m = np.abs(inside - outside)
    between_sources_m = np.abs(inside - mosaic.layers[0].heights(lon[0], lat[0], 0.0))
    assert len(step_m) > 1000
    assert np.median(between_sources_m) > 200
    assert np.quantile(step_m, 0.95) < 0.05
    assert (step_m < 0.1 + 0.001 * between_sources_m).all()
    connection.close()


def test_a_long_rim_is_kept_whole(tmp_path: Path) -> None:
    posts = np.full((1500, 1500), 200, np.float32)
    path = write(tmp_path / "big.tif", posts, north_up(10, 46, STEP / 50), "EPSG:4326")
    mosaic, connection = mosaic_of(tmp_path / "w.geopage", [(path, ELLIPSOID)])
    rim = mosaic.rims[0]
    assert rim is not None
    assert len(rim.lines) >= 4 * 1499
    connection.close()


def test_the_sea_beside_a_coast_stays_sea(tmp_path: Path, rng: np.random.Generator) -> None:
    """The fine source ends at the coast, up to 60 m high; the coarse one has a sea bed."""
    lon_deg = 10 + 0.1 * (np.arange(40) + 0.5)
    bed = np.broadcast_to((lon_deg - 12) * 100, (20, 40)).astype(np.float32)
    low = write(tmp_path / "low.tif", bed, north_up(10, 1, 0.1), "EPSG:4326")
    land = rng.uniform(1, 60, (100, 100)).astype(np.float32)
    high = write(tmp_path / "high.tif", land, north_up(11.0, 0.5, 0.01), "EPSG:4326")
    mosaic, connection = mosaic_of(tmp_path / "w.geopage", [(low, EGM96), (high, EGM96)])
    lon, lat = rng.uniform(10.5, 10.96, 3000), rng.uniform(-0.4, 0.4, 3000)
    found = heights(mosaic, lon, lat) - geoid_m(lon, lat)
    # West of the coast the bed is 100 m deep and more; a fine post is 1.1 km.
    assert found.max() < 0.05
    shore = heights(mosaic, np.full(100, 11.00499), np.linspace(-0.4, 0.4, 100))
    assert (shore - geoid_m(np.full(100, 11.005), np.linspace(-0.4, 0.4, 100)) > 1).all()
    connection.close()


def test_a_finer_source_says_what_it_meets_and_over_which_distance(nested: Mosaic) -> None:
    outer, inset = nested.layers
    assert nested.meets(inset) == outer.name
    assert nested.reach_m(inset) == outer.spacing_m
    assert nested.meets(outer) == "", "the sea level"


def test_what_another_survey_shows_beside_a_source_counts_as_missed(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """Two of one spacing overlap, half a post apart: neither's posts do for the other."""
    files = []
    for name, west in (("a", 7.0), ("b", 7.0155)):
        posts = rng.uniform(0, 500, (40, 40)).astype(np.float32)
        where = north_up(west, 44.0, 0.001)
        files.append(
            (write(tmp_path / f"{name}.tif", posts, where, "EPSG:4326"), ELLIPSOID)
        )
    mosaic, connection = mosaic_of(tmp_path / "world.geopage", files)
    cell = leaf_at(7.0155 + 0.02, 43.98, 111.0, 30)
    truth = truth_of(mosaic, cell, 90)
    lon, lat = places_deg(cell, rng.uniform(0, 1, (3000, 2)))
    shown = heights(mosaic, lon, lat)
    at = np.stack([np.radians(lon), np.radians(lat)], axis=1)
    west, south, east, north = (float(edge) for edge in cells.bounds_rad(cell))
    uv = (at - (west, south)) / (east - west, north - south)
    found = points_at(truth, uv) + truth.centre
    off_m = np.abs(geodesy.to_geodetic(Ecef(found))[2] - shown)
    assert off_m.max() > 5.0
    assert off_m.max() <= truth.slack_m
    connection.close()


def test_a_finer_source_beside_another_leaves_its_posts_alone(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """Its feather is one post of the coarse source under both, as wide as both of them."""
    placed = {"low": (500, 6, 1 / 6), "a": (1000, 7.0, 9e-4), "b": (1500, 7.074, 6e-4)}
    files = []
    for name, (height_m, west, step) in placed.items():
        posts = np.full((60, 60) if name != "low" else (12, 12), height_m, np.float32)
        north = 44.0 if name != "low" else 45.0
        where = north_up(west, north, step)
        files.append(write(tmp_path / f"{name}.tif", posts, where, "EPSG:4326"))
    mosaic, connection = mosaic_of(
        tmp_path / "w.geopage", [(file, ELLIPSOID) for file in files]
    )
    for name, height_m in (("a", 1000), ("b", 1500)):
        lon, lat = places_in(tmp_path / f"{name}.tif", 2000, rng)
        assert np.abs(heights(mosaic, lon, lat) - height_m).max() < 0.1
    lon = np.arange(7.04, 7.09, 1e-6)
    walk = heights(mosaic, lon, np.full(len(lon), 43.98))
    # Between them, 1.6 km, it climbs 500 m; eight centimetres are a step.
    assert np.abs(np.diff(walk)).max() < 0.1
    connection.close()
