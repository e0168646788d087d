# SPDX-License-Identifier: Apache-2.0
"""A fine source meets what is around it without a cliff, however large the cells there."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from ingest.feather import distance_m, followed_m, source_bound_m
from ingest.mosaic import Mosaic
from ingest.terrain import RasterOptions, ingest_rasters
from ingest.terrain_plan import Plan
from ingest.truth import OWN_LATTICE
from tests.ingest.rasters import Floats, ecef, mosaic_of, north_up, write
from tiles import cells, geodesy
from tiles.store import Store
from tiles.surface import Surface

BORDER_DEG = 7.03125
"""of cells of level 5, 110 km wide"""
STEP_DEG = 0.001
ELLIPSOID = RasterOptions(datum="ellipsoid")


def hills(path: Path, rng: np.random.Generator, height_m: float = 500.0) -> Path:
    """Ground of 200 m around a height that ends 150 m east of the border."""
    posts = (
        height_m + 200 * np.sin(np.arange(24) / 2)[:, None] + rng.uniform(-9, 9, (24, 24))
    )
    where = north_up(BORDER_DEG + 0.002, 43.9, STEP_DEG)
    return write(path, posts.astype(np.float32), where, "EPSG:4326")


def test_beside_a_fine_source_the_surface_has_no_cliff_at_a_large_cells_edge(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    world = tmp_path / "world.geopage"
    ingest_rasters(world, [(hills(tmp_path / "hills.tif", rng), ELLIPSOID)], workers=1)
    lat = np.radians(np.linspace(43.878, 43.898, 40))
    sides = [np.full(40, np.radians(BORDER_DEG + off)) for off in (-1e-6, 1e-6)]
    with Store(world) as store:
        surface = Surface(store)
        west, east = (surface.heights(lon, lat)[0] for lon in sides)
    assert west.min() > 100
    # Without it the large cell is off by more than 100 m here.
    assert np.abs(west - east).max() < 15


def test_the_further_from_a_source_the_less_closely_is_its_bend_followed(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    mosaic, connection = mosaic_of(
        tmp_path / "world.geopage", [(hills(tmp_path / "hills.tif", rng), ELLIPSOID)]
    )
    layer = mosaic.layers[0]
    reach_m = mosaic.reach_m(layer)
    found = []
    for away_m in (0.0, reach_m / 2, 2 * reach_m):
        lon = BORDER_DEG + 0.001 - away_m / 80_000
        cell = int(cells.cell_at(np.radians(lon), np.radians(43.888), 18))
        found.append(followed_m(mosaic, cell)[0])
    assert found[0] == pytest.approx(source_bound_m(layer))
    assert found[0] < found[1] < reach_m / 256
    assert found[2] == np.inf
    connection.close()


def land(path: Path, slope_m: float = 10.0) -> Path:
    """Land of about 1,000 m, posts 22 km apart."""
    y, x = np.mgrid[:16, :16]
    posts = (1000 + slope_m * (x - 1.5 * y)).astype(np.float32)
    return write(path, posts, north_up(5.5, 45.5, 0.2), "EPSG:4326")


class Nested(NamedTuple):
    """Hills in a wide coarse land: as one surface, and as a store."""

    mosaic: Mosaic
    store: Path


@pytest.fixture(scope="module")
def nested(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nested]:
    folder, rng = tmp_path_factory.mktemp("nested"), np.random.default_rng(3)
    files = [land(folder / "land.tif"), hills(folder / "hills.tif", rng, 1500.0)]
    given = [(file, ELLIPSOID) for file in files]
    ingest_rasters(folder / "world.geopage", given, workers=1)
    mosaic, connection = mosaic_of(folder / "one.geopage", given)
    yield Nested(mosaic, folder / "world.geopage")
    connection.close()


def posts_deg(mosaic: Mosaic) -> tuple[float, ...]:
    """Return west, south, east and north of the hills' outermost posts."""
    west, south, east, north = mosaic.layers[-1].bounds_deg
    half = STEP_DEG / 2
    return west + half, south + half, east - half, north - half


def rim_m(mosaic: Mosaic, count: int) -> Floats:
    """Return places on the hills' outermost posts, (4 count, 3) ECEF m."""
    west, south, east, north = posts_deg(mosaic)
    t = np.linspace(0, 1, count)
    lon, lat = west + t * (east - west), south + t * (north - south)
    flat = np.zeros(count)
    sides = [
        (lon, flat + south),
        (lon, flat + north),
        (flat + west, lat),
        (flat + east, lat),
    ]
    return np.concatenate([ecef(*side, flat) for side in sides])


def around(mosaic: Mosaic, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return places 0.1 m to the whole feather away from the rim, inside or outside."""
    west, south, east, north = posts_deg(mosaic)
    along = rng.uniform(size=(2, count))
    side = rng.integers(2, size=count).astype(bool)
    along[np.where(side, 0, 1), np.arange(count)] = rng.integers(2, size=count)
    reach_deg = mosaic.reach_m(mosaic.layers[-1]) / 111e3
    away_deg = 10 ** rng.uniform(-6, np.log10(reach_deg), count)
    turn = rng.uniform(0, 2 * np.pi, count)
    lon = west + along[0] * (east - west) + away_deg * np.cos(turn) / 0.72
    lat = south + along[1] * (north - south) + away_deg * np.sin(turn)
    return np.radians(lon), np.radians(lat)


@pytest.mark.parametrize("level", [0, 3, 5, 8, 11])
def test_how_far_a_rim_is_from_a_cell_is_known_within_a_fifth(
    nested: Nested, level: int
) -> None:
    """By all places of the cell's edges and of the rim, brute force."""
    rim = nested.mosaic.groups[-1].outer
    assert rim
    beside = int(cells.cell_at(np.radians(BORDER_DEG - 1e-4), np.radians(43.888), level))
    _, south, east, north = np.degrees(cells.bounds_rad(beside))
    holds = east > BORDER_DEG + 0.002
    t = np.linspace(0, 1, 400)
    lat = np.clip(south + t * (north - south), 43.8, 43.95)
    edge = ecef(np.full(400, east), lat, np.zeros(400))
    true_m = np.linalg.norm(edge[:, None] - rim_m(nested.mosaic, 400), axis=2).min()
    found_m = distance_m(rim, beside, 1.0)
    if holds:
        assert found_m == 0.0
    else:
        assert 0.8 * true_m <= found_m <= true_m + 1.0


def test_a_bend_as_low_as_the_bound_asks_for_nothing(tmp_path: Path) -> None:
    where = north_up(BORDER_DEG + 0.2, 43.9, STEP_DEG)
    near = int(cells.cell_at(np.radians(BORDER_DEG - 1e-4), np.radians(43.888), 7))
    for height_m, asks in ((1030.0, False), (1900.0, True)):
        posts = np.full((24, 24), height_m, np.float32)
        fine = write(tmp_path / "fine.tif", posts, where, "EPSG:4326")
        files = [(land(tmp_path / "land.tif", 0.0), ELLIPSOID), (fine, ELLIPSOID)]
        mosaic, connection = mosaic_of(tmp_path / f"{height_m}.geopage", files)
        assert (followed_m(mosaic, near)[1] == mosaic.layers[-1].spacing_m) == asks
        connection.close()


def test_around_a_rim_the_ground_is_drawn_within_its_stated_error(
    nested: Nested, rng: np.random.Generator
) -> None:
    """No cliff: at random places, not those that any cell was made of."""
    lon, lat = around(nested.mosaic, 3000, rng)
    layer = nested.mosaic.layers[-1]
    with Store(nested.store) as store:
        surface = Surface(store)
        drawn, error_m = surface.heights(lon, lat)
        leaf = surface.forest.records["cell"][surface.rows(lon, lat)]
    off_m = np.abs(drawn - nested.mosaic.heights(lon, lat, 0.0))
    plan = Plan(nested.mosaic, [])
    coarse = np.array([layer not in plan.held(int(cell)) for cell in leaf])
    assert (off_m <= error_m)[coarse].all()
    # It is small beside the rim and grows with the distance from it.
    here = ecef(*np.degrees((lon, lat)), np.zeros(len(lon)))
    near_m = np.linalg.norm(here[:, None] - rim_m(nested.mosaic, 100), axis=2).min(axis=1)
    edge_m = geodesy.cell_edge_m(leaf)
    # Where a leaf's own lattice is as fine as the source, it misses up to that share.
    missed_m = np.where(edge_m < OWN_LATTICE * layer.spacing_m, edge_m / 1024, 0.0)
    bound_m = np.maximum(source_bound_m(layer), near_m / 256)
    assert (off_m <= bound_m + missed_m)[coarse].all()
    assert (near_m[coarse] < 500).sum() > 50
