# SPDX-License-Identifier: Apache-2.0
"""What a leaf stands for: its source's own posts and triangles, wherever it lies."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyproj
import pytest
from rasterio.transform import Affine

from ingest.mosaic import Mosaic
from ingest.terrain import RasterOptions
from ingest.truth import Truth, places_of, points_at, truth_of
from tests.ingest.rasters import (
    EGM96,
    ELLIPSOID,
    Floats,
    ecef,
    hills,
    leaf_at,
    mosaic_of,
    north_up,
    own_surface_m,
    pixels,
    places_deg,
    posts_m,
    whole_surface,
    write,
)
from tiles import cells
from tiles.mesh import UV_ONE

Opener = Callable[..., Mosaic]
SIDE = 90


class Case(NamedTuple):
    """A raster, and a place in it that is not near its rim."""

    crs: str
    where: Affine
    shape: tuple[int, int]
    lon_deg: float
    lat_deg: float


TURNED = Affine.translation(11.0, 46.5) @ Affine.rotation(20) @ Affine.scale(0.005, -0.005)
CASES = {
    "lon_lat": Case("EPSG:4326", north_up(11.0, 46.5, 0.005), (190, 220), 11.55, 46.0),
    "utm": Case("EPSG:32632", north_up(6e5, 5.15e6, 400.0), (230, 240), 10.95, 46.05),
    "globe": Case("EPSG:4326", Affine(0.5, 0, -180, 0, -0.5, 90), (360, 720), 20.0, 10.0),
    "globe_from_0": Case(
        "EPSG:4326", Affine(0.5, 0, 0, 0, -0.5, 90), (360, 720), 10.0, 20.0
    ),
    "over_180": Case("EPSG:4326", north_up(179.0, -15.0, 0.01), (200, 200), -179.9, -16.1),
    "over_180_in_metres": Case(
        "EPSG:3832", north_up(3.2e6, -1.7e6, 1000.0), (200, 240), -179.9, -16.1
    ),
    "south_up": Case(
        "EPSG:4326", Affine(0.005, 0, 11, 0, 0.005, 45.5), (190, 220), 11.55, 46.0
    ),
    "turned": Case("EPSG:4326", TURNED, (190, 220), 11.7, 46.2),
    "near_pole": Case("EPSG:3413", north_up(-6e5, -4e5, 2000.0), (400, 400), -45.0, 83.5),
}
LEANS = {"south_up": -1}


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opener]:
    connections = []

    def opener(*files: Path, options: RasterOptions = EGM96) -> Mosaic:
        store = tmp_path / f"{len(connections)}.geopage"
        mosaic, connection = mosaic_of(store, [(file, options) for file in files])
        connections.append(connection)
        return mosaic

    yield opener
    for connection in connections:
        connection.close()


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def file_of(folder: Path, name: str) -> Path:
    case = CASES[name]
    posts = hills(case.shape, 1.0, 300.0)
    return write(folder / f"{name}.tif", posts, case.where, case.crs)


def leaf_of(mosaic: Mosaic, name: str) -> Truth:
    case = CASES[name]
    cell = leaf_at(case.lon_deg, case.lat_deg, mosaic.layers[-1].spacing_m)
    return truth_of(mosaic, cell, SIDE)


def heights_of(points: Floats) -> Floats:
    to_geodetic = pyproj.Transformer.from_crs(4978, 4979, always_xy=True)
    return np.asarray(to_geodetic.transform(*points.reshape(-1, 3).T)[2])


def rounding_m(truth: Truth) -> float:
    """Posts are kept as float32."""
    return float(np.abs(truth.points).max()) * 2.0**-22 + 1e-3


def misfit_m(name: str) -> float:
    """Places in a projection may be off by a twentieth of the error of a leaf."""
    case = CASES[name]
    return 0.0 if case.crs == "EPSG:4326" else 0.0005 * case.where.a


def test_a_leaf_takes_the_posts_of_its_source(
    case: str, opened: Opener, tmp_path: Path
) -> None:
    path = file_of(tmp_path, case)
    truth = leaf_of(opened(path), case)
    lon, lat = places_deg(truth.cell, truth.uv.reshape(-1, 2))
    known = posts_m(path, egm96=True)
    col, row = pixels(path, lon, lat)
    if case.startswith("globe"):
        col %= known.shape[1]
    c, r = np.rint(col).astype(int), np.rint(row).astype(int)
    assert np.abs(col - c).max() < 1e-5
    assert np.abs(row - r).max() < 1e-5
    inside = (c >= 0) & (r >= 0) & (c < known.shape[1]) & (r < known.shape[0])
    assert inside.mean() > 0.9
    c, r, there = c[inside], r[inside], truth.points.reshape(-1, 3)[inside] + truth.centre
    gap = np.linalg.norm(there - ecef(lon[inside], lat[inside], known[r, c]), axis=1)
    assert gap.max() < rounding_m(truth)
    # They cover the cell, and not much more.
    assert (truth.uv.reshape(-1, 2).min(axis=0) <= 0).all()
    assert (truth.uv.reshape(-1, 2).max(axis=0) >= 1).all()
    assert 30 < np.sqrt(len(lon)) < 200


def test_between_posts_the_surface_is_that_of_the_sources_triangles(
    case: str, opened: Opener, tmp_path: Path, rng: np.random.Generator
) -> None:
    path = file_of(tmp_path, case)
    truth = leaf_of(opened(path), case)
    uv = rng.uniform(size=(2000, 2))
    lon, lat = places_deg(truth.cell, uv)
    height = own_surface_m(path, lon, lat, egm96=True)
    gap = np.linalg.norm(
        points_at(truth, uv) + truth.centre - ecef(lon, lat, height), axis=1
    )
    assert np.isfinite(gap).all()
    assert gap.max() <= truth.slack_m + rounding_m(truth) + misfit_m(case)


def test_the_heights_of_a_leaf_are_those_of_the_posts_inside(
    case: str, opened: Opener, tmp_path: Path
) -> None:
    truth = leaf_of(opened(file_of(tmp_path, case)), case)
    found = heights_of(truth.points + truth.centre)
    inside = ((truth.uv >= 0) & (truth.uv <= 1)).all(axis=-1).ravel()
    assert truth.low_m == pytest.approx(found[inside].min(), abs=rounding_m(truth))
    assert truth.high_m == pytest.approx(found[inside].max(), abs=rounding_m(truth))


def test_places_are_the_corners_the_crossings_of_edges_and_the_posts_inside(
    case: str, opened: Opener, tmp_path: Path
) -> None:
    path = file_of(tmp_path, case)
    truth = leaf_of(opened(path), case)
    places = places_of(truth)
    assert places.at[:4].tolist() == [[0, 0], [UV_ONE, 0], [UV_ONE, UV_ONE], [0, UV_ONE]]
    assert len(np.unique(places.at, axis=0)) == len(places.at)
    inner = places.at[((places.at > 0) & (places.at < UV_ONE)).all(axis=1)]
    flat = truth.uv.reshape(-1, 2)
    posts = flat[((flat > 1e-9) & (flat < 1 - 1e-9)).all(axis=1)]
    assert len(inner) == len(posts)
    assert np.abs(np.sort(inner[:, 0]) - np.sort(posts[:, 0]) * UV_ONE).max() <= 1
    there = places.points - truth.centre
    gap = np.abs(points_at(truth, places.at / UV_ONE) - there).max()
    assert gap < 1e-6


@pytest.mark.parametrize("edge", range(4))
def test_between_two_places_on_an_edge_the_surface_is_straight(
    edge: int, case: str, opened: Opener, tmp_path: Path
) -> None:
    truth = leaf_of(opened(file_of(tmp_path, case)), case)
    places = places_of(truth)
    axis, end = edge // 2, edge % 2 * UV_ONE
    on = np.flatnonzero(places.at[:, axis] == end)
    on = on[np.argsort(places.at[on, 1 - axis])]
    assert len(on) > 24
    at, points = places.at[on] / UV_ONE, places.points[on] - truth.centre
    middle = points_at(truth, (at[:-1] + at[1:]) / 2)
    gap = np.linalg.norm(middle - (points[:-1] + points[1:]) / 2, axis=1)
    # Places are rounded to 1 / 32768 of the cell; posts are up to 500 m high apart.
    rounded_posts = np.abs(truth.grid[:, 1:3]).max() / UV_ONE
    assert gap.max() <= 2000 * rounded_posts + 0.1


def test_with_every_post_the_mesh_has_the_triangles_of_the_source(
    case: str, opened: Opener, tmp_path: Path
) -> None:
    """The lean is right: also of rasters that are upside down or turned."""
    path = file_of(tmp_path, case)
    truth = leaf_of(opened(path), case)
    places = places_of(truth)
    assert places.lean == LEANS.get(case, 1)
    surface = whole_surface(truth.cell, places)
    inner = ((surface.uv > 0) & (surface.uv < 1)).all(axis=1)
    whole = surface.triangles[inner[surface.triangles].all(axis=1)]
    lon, lat = places_deg(truth.cell, surface.uv[whole].reshape(-1, 2))
    col, row = (np.rint(one).reshape(-1, 3) for one in pixels(path, lon, lat))
    if case.startswith("globe"):
        col %= CASES[case].shape[1]
        col = np.where(np.ptp(col, axis=1, keepdims=True) > 9, (col + 99) % 720, col)
    # A triangle of the source spans one square, and its slanted edge runs to larger
    # column and row: so no corner lies off that diagonal twice.
    off = (col - row) - (col - row).min(axis=1, keepdims=True)
    slanted = (np.ptp(col, axis=1) == 1) & (np.ptp(row, axis=1) == 1)
    assert slanted.mean() > 0.999
    assert (off.max(axis=1) == 1).mean() > 0.999


def test_voids_are_filled_from_the_coarser_source(opened: Opener, tmp_path: Path) -> None:
    base = write(
        tmp_path / "base.tif",
        hills((60, 60), 1.0, 300.0),
        north_up(10.6, 46.7, 0.02),
        "EPSG:4326",
    )
    posts = hills((200, 200), 1.0, 100.0)
    posts[60:120, 60:120] = -9999
    fine = write(
        tmp_path / "fine.tif", posts, north_up(11.0, 46.4, 0.001), "EPSG:4326", -9999
    )
    mosaic = opened(base, fine)
    truth = truth_of(mosaic, leaf_at(11.09, 46.31, mosaic.layers[-1].spacing_m), SIDE)
    lon, lat = places_deg(truth.cell, truth.uv.reshape(-1, 2))
    known = posts_m(fine, egm96=True)
    col, row = (np.rint(one).astype(int) for one in pixels(fine, lon, lat))
    there = known[row, col]
    found = heights_of(truth.points + truth.centre)
    void = np.isnan(there)
    assert 100 < void.sum() < len(void) - 100
    np.testing.assert_allclose(found[~void], there[~void], atol=2e-2)
    filled = mosaic.heights(np.radians(lon[void]), np.radians(lat[void]), 0.0)
    np.testing.assert_allclose(found[void], filled, atol=2e-2)
    # Further inside than the fill is bent, it is the coarser source as it is.
    deep = (np.abs(col - 89.5) < 3) & (np.abs(row - 89.5) < 3)
    if deep.any():
        plain = own_surface_m(base, lon[deep], lat[deep], egm96=True)
        assert np.abs(found[deep] - plain).max() < 600


def test_where_a_coarser_source_fills_in_a_leaf_knows_what_it_misses(
    opened: Opener, tmp_path: Path, rng: np.random.Generator
) -> None:
    rough = hills((120, 120), 1.0, 300.0) + rng.normal(0.0, 40.0, (120, 120))
    base = write(tmp_path / "base.tif", rough, north_up(10.9, 46.5, 0.0033), "EPSG:4326")
    posts = hills((100, 100), 1.0, 100.0)
    fine = write(tmp_path / "fine.tif", posts, north_up(11.0, 46.4, 0.001), "EPSG:4326")
    mosaic = opened(base, fine)
    cell = leaf_at(11.0995, 46.35, mosaic.layers[-1].spacing_m)
    truth = truth_of(mosaic, cell, SIDE)
    uv = rng.uniform(size=(20_000, 2))
    lon, lat = places_deg(cell, uv)
    height = mosaic.heights(np.radians(lon), np.radians(lat), 0.0)
    gap = np.abs(heights_of(points_at(truth, uv) + truth.centre) - height)
    fine_posts = mosaic.layers[-1]
    shown = np.isfinite(mosaic.beside(fine_posts, np.radians(lon), np.radians(lat)))
    assert 1000 < shown.sum() < len(shown) - 1000
    assert 0.5 < gap[shown].max() <= truth.slack_m
    assert truth.missed_m <= 2 * gap[shown].max()
    inside = np.isfinite(fine_posts.heights(np.radians(lon), np.radians(lat), 0.0))
    assert gap[inside].max() < 0.05


@pytest.mark.parametrize("lat_deg", [89.99, -89.99])
def test_at_a_pole_a_leaf_takes_a_lattice_and_knows_what_it_misses(
    lat_deg: float, opened: Opener, tmp_path: Path, rng: np.random.Generator
) -> None:
    mosaic = opened(file_of(tmp_path, "globe"), options=ELLIPSOID)
    cell = leaf_at(20.0, lat_deg, mosaic.layers[-1].spacing_m)
    truth = truth_of(mosaic, cell, SIDE)
    assert np.isfinite(truth.points).all()
    uv = rng.uniform(size=(4000, 2))
    lon, lat = places_deg(cell, uv)
    height = mosaic.heights(np.radians(lon), np.radians(lat), 0.0)
    found = points_at(truth, uv) + truth.centre
    gap = np.linalg.norm(found - ecef(lon, lat, height), axis=1)
    # The slack is that of the middles of squares; elsewhere it may be a little more.
    assert gap.max() <= 2 * truth.slack_m


def test_both_sides_of_the_antimeridian_have_the_same_points(
    opened: Opener, tmp_path: Path
) -> None:
    for name in ("globe", "globe_from_0", "over_180", "over_180_in_metres"):
        mosaic = opened(file_of(tmp_path, name))
        spacing_m = mosaic.layers[-1].spacing_m
        lat_deg = -16.1 if name.startswith("over") else 20.0
        west, east = (
            truth_of(mosaic, leaf_at(lon, lat_deg, spacing_m), SIDE)
            for lon in (179.9999, -179.9999)
        )
        assert cells.bounds_rad(west.cell)[2] == pytest.approx(np.pi)
        steps = np.linspace(0, 1, 50)
        one = points_at(west, np.stack([np.ones(50), steps], axis=1)) + west.centre
        other = points_at(east, np.stack([np.zeros(50), steps], axis=1)) + east.centre
        gap = np.linalg.norm(one - other, axis=1)
        assert gap.max() <= rounding_m(west) + rounding_m(east) + misfit_m(name)


def test_far_from_any_source_a_leaf_is_the_sea(opened: Opener, tmp_path: Path) -> None:
    mosaic = opened(file_of(tmp_path, "lon_lat"))
    cell = int(cells.cell_at(np.radians(-120), np.radians(-30), 5))
    truth = truth_of(mosaic, cell, SIDE)
    lon, lat = places_deg(cell, truth.uv.reshape(-1, 2))
    sea = mosaic.heights(np.radians(lon), np.radians(lat), 0.0)
    np.testing.assert_allclose(heights_of(truth.points + truth.centre), sea, atol=0.2)
    assert -110 < truth.low_m <= truth.high_m < 90
