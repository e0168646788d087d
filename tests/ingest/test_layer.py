# SPDX-License-Identifier: Apache-2.0
"""One source as a function of place: exact at posts, in any CRS, coarser when asked."""

import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import rasterio
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.terrain import RasterOptions, editing, plan
from ingest.terrain import copy as copy_source
from tests.ingest.rasters import geoid_m, hills, north_up, pixels, source_height_m, write
from tiles.frames import WGS84_A_M, Floats

ECEF = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
Opener = Callable[..., Layer]
ELLIPSOID = RasterOptions(datum="ellipsoid")


@pytest.fixture
def along(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files are compared along the earth; that triangles are flat has a test of its own."""
    monkeypatch.setattr("ingest.layer.CURVED_M", np.inf)


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


@pytest.mark.usefixtures("along")
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


@pytest.mark.usefixtures("along")
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
    stated = RasterOptions(datum="ellipsoid", units="us-ft")
    feet = opened(hills((20, 20), 1, 50), north_up(6e6, 2e6, 100.0), "EPSG:2227", stated)
    assert feet.spacing_m == pytest.approx(100 * 1200 / 3937)


@pytest.mark.usefixtures("along")
@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3035"])
def test_between_posts_far_apart_triangles_are_flat(
    crs: str,
    opened: Opener,
    tmp_path: Path,
    rng: np.random.Generator,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where the vertical meets the plane of three posts in ECEF, with pyproj's places."""
    where = north_up(10, 50, 1 / 6) if crs == "EPSG:4326" else north_up(4.3e6, 3.2e6, 2e4)
    layer = opened(hills((20, 20), 1, 500), where, crs)
    col, row = rng.uniform(4, 15, (2, 200))
    col0, row0 = np.floor(col), np.floor(row)
    lower = row - row0 > col - col0
    way = np.stack([np.where(lower, 0, 1), np.where(lower, 1, 0)])
    with rasterio.open(tmp_path / "source.tif") as file:
        posts, lon_lat = (
            file.read(1).astype(float),
            pyproj.Transformer.from_crs(crs, 4326, always_xy=True),
        )
        step, _, west, _, _, north = tuple(file.transform)[:6]

    def place_of(c: Floats, r: Floats) -> tuple[Floats, Floats]:
        return west + step * (c + 0.5), north - step * (r + 0.5)

    def ecef(c: Floats, r: Floats) -> Floats:
        lon, lat = lon_lat.transform(*place_of(c, r))
        height = posts[r.astype(int), c.astype(int)]
        return np.stack(ECEF.transform(lon, lat, height), axis=-1)

    a, b = ecef(col0, row0), ecef(col0 + 1, row0 + 1)
    across = np.cross(b - a, ecef(col0 + way[0], row0 + way[1]) - a)
    lon, lat = lon_lat.transform(*place_of(col, row))
    foot = np.stack(ECEF.transform(lon, lat, 0 * lon), axis=-1)
    up = np.stack(ECEF.transform(lon, lat, 0 * lon + 1), axis=-1) - foot
    true = ((a - foot) * across).sum(axis=1) / (up * across).sum(axis=1)
    lon, lat = np.radians(lon), np.radians(lat)
    curved_m = layer.heights(lon, lat, 0.0)
    monkeypatch.setattr("ingest.layer.CURVED_M", 1500.0)
    flat_m = layer.heights(lon, lat, 0.0)
    # A post's place in a square of the map is one in a square of the ground, nearly.
    assert np.abs(flat_m - true).max() < 0.1 * np.abs(curved_m - true).max()
    assert np.abs(curved_m - true).max() > 5


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


def elevation_m(path: Path, lon_deg: Floats, lat_deg: Floats) -> Floats:
    """Read a global or polar file as `source_height_m` does, columns taken once round."""
    with rasterio.open(path) as dataset:
        posts = dataset.read(1).astype(np.float64)
    col, row = pixels(path, lon_deg, lat_deg)
    if dataset.crs.is_geographic:
        col %= 360 / dataset.transform.a
    elif dataset.crs.to_epsg() == 3857:
        col %= 2 * np.pi * 6_378_137 / dataset.transform.a
    once = abs(posts.shape[1] * dataset.transform.a - 360) < 1e-9
    if dataset.crs.is_geographic and once:
        posts = np.concatenate([posts, posts[:, :1]], axis=1)
    c = np.clip(np.floor(col), 0, posts.shape[1] - 2).astype(int)
    r = np.clip(np.floor(row), 0, posts.shape[0] - 2).astype(int)
    x, y = col - c, row - r
    nw, ne, sw, se = posts[r, c], posts[r, c + 1], posts[r + 1, c], posts[r + 1, c + 1]
    east, south = nw + x * (ne - nw) + y * (se - ne), nw + y * (sw - nw) + x * (se - sw)
    found = np.where(x > y, east, south)
    beyond = (col < 0) | (col > posts.shape[1] - 1) | (row < 0) | (row > posts.shape[0] - 1)
    return np.where(beyond, np.nan, found)


EVERYWHERE = (-180.0, 180.0, -90.0, 90.0)


@pytest.mark.usefixtures("along")
@pytest.mark.parametrize(
    ("crs", "where", "shape", "box"),
    [
        ("EPSG:3413", north_up(-300e3, 300e3, 5e3), (120, 120), (-180, 180, 87, 90)),
        ("EPSG:3031", north_up(-300e3, 300e3, 5e3), (120, 120), (-180, 180, -90, -87)),
        ("EPSG:4326", north_up(0, 90, 2.0), (90, 180), EVERYWHERE),
        ("EPSG:4326", north_up(-180, 90, 2.0), (90, 180), EVERYWHERE),
        ("EPSG:4326", north_up(171, 8, 0.25), (64, 72), (171.2, 188.8, -7.8, 7.8)),
        ("EPSG:4326", north_up(-189, 8, 0.25), (64, 72), (171.2, 188.8, -7.8, 7.8)),
        ("EPSG:3832", north_up(3e6, 9e5, 3e4), (60, 60), (178, 190, -7, 7)),
        ("EPSG:3857", north_up(19.9e6, 9e5, 3e4), (40, 30), (179, 186.5, -2.5, 7.9)),
        (
            "+proj=longlat +ellps=clrk66",
            north_up(250, 40, 0.1),
            (30, 40),
            (250.2, 253.8, 37.2, 39.8),
        ),
        ("EPSG:32601", north_up(1e5, 9e5, 3e3), (90, 90), (179.3, 182, 6, 8)),
    ],
)
def test_over_poles_and_the_antimeridian_heights_are_the_files(
    opened: Opener,
    tmp_path: Path,
    crs: str,
    where: Any,
    shape: tuple[int, int],
    box: tuple[float, float, float, float],
    rng: np.random.Generator,
) -> None:
    layer = opened(hills(shape, 1.0, 100.0), where, crs)
    lon, lat = rng.uniform(*box[:2], 2000), rng.uniform(*box[2:], 2000)
    # Both sides of the seam, and the pole.
    lon[:40], lon[40:80], lat[80:90] = -180 + 1e-9, 180 - 1e-9, max(box[2:], key=abs)
    truth = elevation_m(tmp_path / "source.tif", lon, lat)
    told = np.isfinite(truth)
    turn = rng.choice([-360.0, 0.0, 360.0], 2000)
    found = layer.heights(np.radians(lon + turn), np.radians(lat), 0.0)
    assert told.mean() > 0.5
    # Near its pole a projection turns the rounding of a longitude into a millimetre.
    np.testing.assert_allclose(found[told], truth[told], atol=2e-3)
    assert np.isnan(found[~told]).all() or layer.wraps


def test_between_the_last_row_and_the_pole_the_surface_closes(opened: Opener) -> None:
    posts = hills((90, 180), 1.0, 100.0)
    layer = opened(posts, north_up(0, 90, 2.0), "EPSG:4326")
    for pole, row in ((90.0, 0), (-90.0, -1)):
        lon = np.radians(np.linspace(-180, 180, 9))
        at_pole = layer.heights(lon, np.full(9, np.radians(pole)), 0.0)
        np.testing.assert_allclose(at_pole, posts[row].mean(dtype=float), rtol=1e-6)


@pytest.mark.parametrize(
    ("crs", "where"),
    [
        ("EPSG:4326", north_up(11.0, 46.5, 0.01)),
        ("EPSG:4326", north_up(178.0, 46.5, 0.01)),
        ("EPSG:4326", north_up(-180.0, 90.0, 0.45)),
        ("EPSG:32632", north_up(660_000.0, 5_150_000.0, 500.0)),
        ("EPSG:3413", north_up(-1_200_000.0, 900_000.0, 3000.0)),
    ],
)
def test_a_box_with_a_post_in_it_holds_data(
    opened: Opener, crs: str, where: Any, rng: np.random.Generator
) -> None:
    """A few islands in 800 x 400 posts; boxes of all sizes, some over the antimeridian."""
    posts = np.full((400, 800), np.nan, np.float32)
    rows, cols = rng.integers(0, 400, 12), rng.integers(0, 800, 12)
    posts[rows, cols] = 1.0
    layer = opened(posts, where, crs)
    lon, lat = layer.places(cols.astype(float), rows.astype(float))
    extent = np.radians(layer.bounds_deg)
    wrong_yes = empty = 0
    for size in 10.0 ** rng.uniform(-3, 0, 300):
        wide, high = size * (extent[2] - extent[0]), size * (extent[3] - extent[1])
        west, south = rng.uniform(extent[0], extent[2]), rng.uniform(extent[1], extent[3])
        box = west - wide / 2, south - high / 2, west + wide / 2, south + high / 2
        off = (lon - box[0]) % (2 * np.pi)
        inside = ((off <= wide) & (lat >= box[1]) & (lat <= box[3])).any()
        held = layer.holds(box)
        assert held or not inside
        empty += not inside
        wrong_yes += held and not inside
    for k in range(12):
        assert layer.holds((lon[k], lat[k], lon[k], lat[k]))
        assert layer.holds(
            (lon[k] - 7, lat[k] - 1e-9, lon[k] - 7 + 2 * np.pi, lat[k] + 1e-9)
        )
    assert empty > 100
    assert wrong_yes < 0.25 * empty


def test_boxes_beside_a_source_hold_none_of_its_data(opened: Opener) -> None:
    layer = opened(np.ones((40, 40), np.float32), north_up(11, 46, 0.01), "EPSG:4326")
    beside = [
        (10.0, 45.6, 10.9, 46.0),
        (11.1, 46.1, 11.2, 46.2),
        (-170.0, 45.6, -160.0, 46),
    ]
    assert not any(layer.holds(np.radians(box)) for box in beside)


def test_heights_of_the_rim_are_those_of_the_nearest_posts(
    opened: Opener, rng: np.random.Generator
) -> None:
    ramp = np.add.outer(np.zeros(40), np.arange(40.0) * 10.0)  # rises eastwards
    layer = opened(ramp, north_up(660_000.0, 5_150_000.0, 500.0), "EPSG:32632")
    row = rng.uniform(2, 37, 50)
    for col, rim_m, away_px in ((-21.0, 5.0, 21.5), (59.0, 385.0, 20.5), (17.0, 170.0, 0)):
        lon, lat = layer.places(np.full(50, col), row)
        found_m, away_m = layer.rim_heights(lon, lat, 0.0)
        np.testing.assert_allclose(found_m, rim_m, atol=0.01)
        np.testing.assert_allclose(away_m, away_px * 500.0, atol=1.0)
