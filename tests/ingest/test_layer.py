# SPDX-License-Identifier: Apache-2.0
"""One source as a function of place: exact at posts, in any CRS, coarser when asked."""

import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.terrain import RasterOptions, editing, plan
from ingest.terrain import copy as copy_source
from tests.ingest.rasters import geoid_m, hills, north_up, source_height_m, write
from tiles.frames import WGS84_A_M

Opener = Callable[..., Layer]
ELLIPSOID = RasterOptions(datum="ellipsoid")


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opener]:
    """Write a raster, copy it into a store, open it."""
    connections = []

    def opener(
        posts: NDArray[Any],
        where: Any,
        crs: str,
        options: RasterOptions = ELLIPSOID,
        nodata: float | None = None,
    ) -> Layer:
        path = write(tmp_path / "source.tif", posts, where, crs, nodata)
        with editing(tmp_path / "layer.geopage") as writer:
            source = copy_source(writer, plan(path, options), lambda done, all_, what: None)
        connections.append(sqlite3.connect(tmp_path / "layer.geopage"))
        return Layer(connections[-1], source)

    yield opener
    for connection in connections:
        connection.close()


@pytest.mark.parametrize(
    ("crs", "where"),
    [
        ("EPSG:4326", north_up(11.0, 46.5, 0.01)),
        ("EPSG:4267", north_up(-100.0, 46.5, 0.01)),  # NAD27: not WGS84's degrees
        ("EPSG:32632", north_up(660_000.0, 5_150_000.0, 500.0)),
        ("EPSG:3413", north_up(-300_000.0, 200_000.0, 9000.0)),  # over the north pole
        ("EPSG:2193", north_up(1_600_000.0, 5_400_000.0, 500.0)),  # northing first
    ],
)
def test_heights_are_the_files_own_triangles_in_any_crs(
    opened: Opener, tmp_path: Path, crs: str, where: Any, rng: np.random.Generator
) -> None:
    layer = opened(hills((50, 60), 1.0, 100.0), where, crs, RasterOptions(datum="egm96"))
    back = pyproj.Transformer.from_crs(crs, 4326, always_xy=True)
    a, _, c, _, e, f = tuple(where)[:6]
    col, row = rng.uniform(0.5, 59.5, 500), rng.uniform(0.5, 49.5, 500)
    lon, lat = (np.asarray(one) for one in back.transform(a * col + c, e * row + f))
    truth = source_height_m(tmp_path / "source.tif", lon, lat) + geoid_m(lon, lat)
    found = layer.heights(np.radians(lon), np.radians(lat), 0.0)
    assert np.isfinite(truth).sum() > 450
    # The datum is applied at the posts; between posts 9 km apart the geoid bends by 4 cm.
    np.testing.assert_allclose(found, truth, atol=0.05)


def test_outside_its_posts_a_source_says_nothing(opened: Opener) -> None:
    layer = opened(np.ones((10, 10), np.float32), north_up(11, 46, 0.1), "EPSG:4326")
    inside = [(11.05, 45.95), (11.95, 45.05), (11.5, 45.5)]
    outside = [(11.04, 45.5), (11.96, 45.5), (11.5, 45.96), (11.5, 45.04), (-170, 45.5)]
    lon, lat = np.radians(np.array(inside + outside)).T
    found = layer.heights(lon, lat, 0.0)
    assert np.isfinite(found).tolist() == [True] * 3 + [False] * 5


def test_no_data_nan_and_absurd_values_are_no_data(opened: Opener) -> None:
    posts = np.full((9, 9), 5, np.float32)
    posts[0, 0], posts[2, 2], posts[4, 4], posts[6, 6] = -32768, np.nan, 3e38, -20000
    layer = opened(posts, north_up(11, 46, 0.1), "EPSG:4326", nodata=-32768)
    at = np.array([0, 2, 4, 6, 8])
    lon, lat = np.radians(11.05 + 0.1 * at), np.radians(45.95 - 0.1 * at)
    found = layer.heights(lon, lat, 0.0)
    assert np.isnan(found[:4]).all()
    assert found[4] == 5


def test_coarser_posts_are_averages(opened: Opener) -> None:
    posts = np.zeros((512, 512), np.float32)
    posts[::2] = 100
    layer = opened(posts, north_up(11, 46, 0.001), "EPSG:4326")
    lon, lat = np.radians(np.array([11.2])), np.radians(np.array([45.8005]))
    assert layer.heights(lon, lat, 1.0)[0] == pytest.approx(0, abs=1e-6)
    assert layer.heights(lon, lat, 3 * layer.spacing_m)[0] == pytest.approx(50)


def test_units_and_scale_become_metres(tmp_path: Path) -> None:
    posts = np.full((20, 20), 328, np.int16)
    path = write(
        tmp_path / "feet.tif",
        posts,
        north_up(11, 46, 0.01),
        "EPSG:4326",
        units=("ft",),
        scales=(10.0,),
        offsets=(1.0,),
    )
    source = plan(path, ELLIPSOID)
    with editing(tmp_path / "feet.geopage") as writer:
        source = copy_source(writer, source, lambda done, total, what: None)
        layer = Layer(writer.connection, source)
        found = layer.heights(np.radians(np.array([11.1])), np.radians(np.array([45.9])), 0)
    assert found[0] == pytest.approx(3281 * 0.3048, abs=1e-3)
    assert source["vertical_step_m"] == pytest.approx(3.048)


def test_longitudes_beyond_180_are_the_same_places(opened: Opener) -> None:
    layer = opened(hills((20, 20), 1, 50), north_up(175, 10, 0.5), "EPSG:4326")
    lon, lat = np.array([178.0, 181.0, 184.0]), np.full(3, 5.0)
    one = layer.heights(np.radians(lon), np.radians(lat), 0.0)
    other = layer.heights(np.radians(lon - 360), np.radians(lat), 0.0)
    assert np.isfinite(one).all()
    np.testing.assert_allclose(one, other, atol=1e-6)


def test_spacing_is_in_metres(opened: Opener) -> None:
    degree_m = np.radians(1) * WGS84_A_M
    degrees = opened(hills((20, 20), 1, 50), north_up(11, 60.1, 0.01), "EPSG:4326")
    assert degrees.spacing_m == pytest.approx(0.01 * degree_m, rel=0.01)
    metres = opened(hills((20, 20), 1, 50), north_up(6e5, 5e6, 30.0), "EPSG:32632")
    assert metres.spacing_m == 30
    feet = opened(hills((20, 20), 1, 50), north_up(6e6, 2e6, 100.0), "EPSG:2227")
    assert feet.spacing_m == pytest.approx(100 * 1200 / 3937)


def test_a_turned_raster_keeps_its_places(opened: Opener, tmp_path: Path) -> None:
    """Rows run to the north-east, columns to the south-east."""
    where = type(north_up(0, 0, 1))(70.0, 70.0, 660_000.0, -70.0, 70.0, 5_140_000.0)
    layer = opened(hills((40, 40), 1, 100), where, "EPSG:32632")
    back = pyproj.Transformer.from_crs(32632, 4326, always_xy=True)
    lon, lat = (np.asarray(v) for v in back.transform([662_000.0], [5_140_100.0]))
    truth = source_height_m(tmp_path / "source.tif", lon, lat)
    assert np.isfinite(truth).all()
    found = layer.heights(np.radians(lon), np.radians(lat), 0.0)
    np.testing.assert_allclose(found, truth, atol=1e-3)
