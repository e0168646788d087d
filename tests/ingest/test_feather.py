# SPDX-License-Identifier: Apache-2.0
"""A fine source meets what is around it without a cliff, however large the cells there."""

from pathlib import Path

import numpy as np
import pytest

from ingest.feather import followed_m, source_bound_m
from ingest.terrain import RasterOptions, ingest_rasters
from tests.ingest.rasters import mosaic_of, north_up, write
from tiles import cells
from tiles.store import Store
from tiles.surface import Surface

BORDER_DEG = 7.03125
"""of cells of level 5, 110 km wide"""
STEP_DEG = 0.001
ELLIPSOID = RasterOptions(datum="ellipsoid")


def hills(path: Path, rng: np.random.Generator) -> Path:
    """Ground of 300 to 700 m that ends 150 m east of the border."""
    posts = 500 + 200 * np.sin(np.arange(24) / 2)[:, None] + rng.uniform(-9, 9, (24, 24))
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
