# SPDX-License-Identifier: Apache-2.0
"""The measured deviation is never less than what brute force finds, nor more."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from ingest.mosaic import Mosaic
from ingest.terrain import RasterOptions
from ingest.terrain_mesh import Places, Surface
from ingest.truth import Truth, places_of, points_at, truth_of
from tests.ingest.rasters import (
    EGM96,
    ELLIPSOID,
    UTM,
    Floats,
    build_surface,
    deviation_of,
    drawn,
    ecef,
    hills,
    lattice_of,
    leaf_at,
    mosaic_of,
    north_up,
    own_surface_m,
    places_deg,
    whole_surface,
    write,
)
from tiles import cells

WHOLE = (0.0, 0.0, 1.0)
Opener = Callable[[Path, RasterOptions], Mosaic]


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opener]:
    connections = []

    def opener(path: Path, options: RasterOptions) -> Mosaic:
        mosaic, connection = mosaic_of(tmp_path / "a.geopage", [(path, options)])
        connections.append(connection)
        return mosaic

    yield opener
    for connection in connections:
        connection.close()


def dem(folder: Path, crs: str, height_m: float = 200.0) -> Path:
    where = north_up(660_000.0, 5_150_000.0, 500.0)
    if crs != UTM:
        where = north_up(11.0, 46.5, 0.005)
    return write(folder / "dem.tif", hills((190, 220), 1.0, height_m), where, crs)


@pytest.fixture(params=["EPSG:4326", UTM])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return dem(tmp_path, str(request.param))


@pytest.fixture
def truth(path: Path, opened: Opener) -> Truth:
    return truth_of(opened(path, EGM96), leaf_at(11.6, 46.1, 550.0), 90)


def gaps_m(path: Path, surface: Surface, cell: int, uv: Floats) -> Floats:
    """Distances of a surface from a file's own triangles at fractions of its cell."""
    lon, lat = places_deg(cell, uv)
    height = own_surface_m(path, lon, lat, egm96=True)
    return np.asarray(np.linalg.norm(drawn(surface, uv) - ecef(lon, lat, height), axis=1))


def close(path: Path, truth: Truth) -> float:
    """What may be missed beside the slack: rounding, and the fit of a projection."""
    off_m = 0.0005 * 500.0 if path_is_utm(path) else 0.0
    return float(np.abs(truth.points).max()) * 2.0**-22 + off_m + 1e-3


def path_is_utm(path: Path) -> bool:
    with rasterio.open(path) as dataset:
        return bool(dataset.crs.is_projected)


@pytest.mark.parametrize("bound_m", [60.0, 10.0, 1.0])
def test_no_place_is_further_off_than_measured(
    bound_m: float, path: Path, truth: Truth, rng: np.random.Generator
) -> None:
    surface = build_surface(truth.cell, places_of(truth), bound_m)
    found = deviation_of(surface, WHOLE, truth)
    gap = gaps_m(path, surface, truth.cell, rng.uniform(size=(10_000, 2)))
    assert np.isfinite(gap).all()
    assert gap.max() <= found.largest_m + close(path, truth)
    assert gap.max() > 0.4 * found.largest_m - truth.slack_m


@pytest.mark.parametrize("bound_m", [60.0, 10.0, 1.0])
def test_the_largest_distance_is_found_where_it_is_said_to_be(
    bound_m: float, path: Path, truth: Truth
) -> None:
    surface = build_surface(truth.cell, places_of(truth), bound_m)
    found = deviation_of(surface, WHOLE, truth)
    worst = int(found.far_m.argmax())
    gap = gaps_m(path, surface, truth.cell, found.uv[worst : worst + 1])[0]
    slack_m = truth.slack_m + close(path, truth)
    assert found.largest_m == pytest.approx(gap, abs=2 * slack_m, rel=0.05)


def test_every_triangles_own_distance_bounds_the_places_over_it(
    path: Path, truth: Truth, rng: np.random.Generator
) -> None:
    surface = build_surface(truth.cell, places_of(truth), 40.0)
    found = deviation_of(surface, WHOLE, truth)
    slack_m = truth.slack_m + close(path, truth)
    over_m = found.far_m
    for t in rng.choice(len(surface.triangles), 60):
        weights = rng.dirichlet(np.ones(3), 200)
        uv = weights @ surface.uv[surface.triangles[t]]
        gap = gaps_m(path, surface, truth.cell, uv).max()
        # An edge's distances are noted at one of its two triangles only.
        sides = np.isin(surface.triangles, surface.triangles[t]).sum(axis=1) >= 2
        assert gap <= over_m[sides].max() + slack_m


@pytest.mark.parametrize("depth", [1, 3])
def test_a_leaf_in_a_larger_cell_is_measured_where_it_lies(
    depth: int, path: Path, truth: Truth, rng: np.random.Generator
) -> None:
    """The larger cell's surface is another one: nothing agrees unless places do."""
    cell = int(cells.ancestor(truth.cell, cells.level(truth.cell) - depth))
    heights = rng.normal(500, 200, (17, 17))
    surface = build_surface(cell, lattice_of(cell, heights), 50.0)
    west, south, east, north = cells.bounds_rad(cell)
    left, low, right, _ = cells.bounds_rad(truth.cell)
    size = (right - left) / (east - west)
    window = ((left - west) / (east - west), (low - south) / (north - south), size)
    assert size == pytest.approx(2.0**-depth)
    found = deviation_of(surface, window, truth)
    # What lies between a post and the leaf's own edge is the next leaf's to see.
    inside = np.array(window[:2]) + size * rng.uniform(0.03, 0.97, size=(10_000, 2))
    gap = gaps_m(path, surface, cell, inside)
    slack_m = truth.slack_m + close(path, truth)
    assert gap.max() <= found.largest_m + slack_m
    assert found.largest_m <= 1.25 * gap.max() + slack_m
    worst = int(found.far_m.argmax())
    at = found.uv[worst : worst + 1]
    assert (at >= window[:2]).all()
    assert (at <= np.array(window[:2]) + size).all()
    assert found.largest_m == pytest.approx(
        gaps_m(path, surface, cell, at)[0], rel=0.05, abs=2 * slack_m
    )


@pytest.mark.parametrize("depth", [1, 2])
def test_all_leaves_of_a_larger_cell_together_miss_nothing(
    depth: int, path: Path, opened: Opener, rng: np.random.Generator
) -> None:
    mosaic = opened(path, EGM96)
    leaf = leaf_at(11.6, 46.1, 550.0)
    cell = int(cells.ancestor(leaf, cells.level(leaf) - depth))
    heights = rng.normal(500, 200, (17, 17))
    surface = build_surface(cell, lattice_of(cell, heights), 50.0)
    largest_m = 0.0
    for n in range(4**depth):
        col, row = n % 2**depth, n // 2**depth
        u, v = (col + 0.5) / 2**depth, (row + 0.5) / 2**depth
        lon, lat = np.radians(places_deg(cell, np.array([[u, v]])))
        one = int(cells.cell_at(lon[0], lat[0], cells.level(leaf)))
        truth = truth_of(mosaic, one, 90)
        window = (col / 2**depth, row / 2**depth, 2.0**-depth)
        largest_m = max(largest_m, deviation_of(surface, window, truth).largest_m)
    gap = gaps_m(path, surface, cell, rng.uniform(size=(20_000, 2)))
    known = gap[np.isfinite(gap)]
    assert len(known) > 2000
    assert known.max() <= largest_m


def test_triangles_outside_the_leaf_are_not_measured(
    truth: Truth, rng: np.random.Generator
) -> None:
    cell = int(cells.ancestor(truth.cell, cells.level(truth.cell) - 1))
    surface = build_surface(cell, lattice_of(cell, rng.normal(0, 200, (17, 17))), 10.0)
    west, south, east, north = cells.bounds_rad(cell)
    left, low, _, _ = cells.bounds_rad(truth.cell)
    corner = np.array([(left - west) / (east - west), (low - south) / (north - south)])
    found = deviation_of(surface, (float(corner[0]), float(corner[1]), 0.5), truth)
    at = surface.uv[surface.triangles]
    apart = ((at.max(axis=1) < corner) | (at.min(axis=1) > corner + 0.5)).any(axis=1)
    inside = ((at > corner) & (at < corner + 0.5)).all(axis=(1, 2))
    assert apart.sum() > 100
    assert (found.far_m[apart] == 0).all()
    assert (found.far_m[inside] > 0).all()


def test_a_mesh_of_all_posts_deviates_by_its_rounding_only(
    path: Path, truth: Truth
) -> None:
    places = places_of(truth)
    surface = whole_surface(truth.cell, places)
    found = deviation_of(surface, WHOLE, truth)
    # At the rim squares are cut, and their triangles may be others than the source's.
    at = surface.uv[surface.triangles]
    inside = ((at > 0.03) & (at < 0.97)).all(axis=(1, 2))
    rounding_m = np.sqrt(3) / 2 * surface.mesh.scale_m
    # Places are rounded to 1 / 32768 of the cell: to 1 m, on slopes of 1 / 2.
    most = truth.slack_m + rounding_m + close(path, truth) + 0.5
    assert 0 < found.far_m[inside].max() <= most


def test_a_spike_between_the_meshs_places_is_found(opened: Opener, tmp_path: Path) -> None:
    posts = np.full((190, 220), 100, np.float32)
    posts[80, 120] = 900.0
    where = north_up(11.0, 46.5, 0.005)
    path = write(tmp_path / "spike.tif", posts, where, "EPSG:4326")
    cell = leaf_at(11.0 + 120.5 * 0.005, 46.5 - 80.5 * 0.005, 550.0)
    truth = truth_of(opened(path, ELLIPSOID), cell, 90)
    surface = build_surface(cell, lattice_of(cell, np.full((9, 9), 100.0)), 0.0)
    found = deviation_of(surface, WHOLE, truth)
    assert found.largest_m == pytest.approx(800.0, abs=10.0)
    lon, lat = places_deg(cell, found.uv[[found.far_m.argmax()]])
    np.testing.assert_allclose(lon, 11.0 + 120.5 * 0.005, atol=1e-9)
    np.testing.assert_allclose(lat, 46.5 - 80.5 * 0.005, atol=1e-9)


def test_a_ridge_that_edges_cut_through_between_posts_is_found(
    opened: Opener, tmp_path: Path, rng: np.random.Generator
) -> None:
    """With the wrong diagonals every post is met, but not the ridge between them."""
    posts = 1000 * np.eye(60, dtype=np.float32)
    where = Affine(0.01, 0, 11.0, 0, -0.01, 46.5)
    path = write(tmp_path / "ridge.tif", posts, where, "EPSG:4326")
    cell = leaf_at(11.3, 46.2, 1100.0, side=40)
    truth = truth_of(opened(path, ELLIPSOID), cell, 40)
    places = places_of(truth)
    uv = rng.uniform(size=(10_000, 2))
    there = points_at(truth, uv) + truth.centre
    for lean, low_m, high_m in ((places.lean, 0, 20), (-places.lean, 500, 1001)):
        surface = whole_surface(cell, Places(places.at, places.points, lean))
        found = deviation_of(surface, WHOLE, truth).largest_m
        gap = np.linalg.norm(drawn(surface, uv) - there, axis=1).max()
        # Straight up it is more than the shortest distance, on slopes of 1.
        assert 0.5 * gap <= found
        assert low_m < found < high_m
