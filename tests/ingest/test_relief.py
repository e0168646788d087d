# SPDX-License-Identifier: Apache-2.0
"""Relief is the same from tile to tile, and shows no triangles between posts."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ingest.mosaic import Mosaic
from ingest.relief import LEAF_TEXELS, slopes_of, steeper_of
from ingest.terrain_mesh import lattice_places
from ingest.terrain_tile import step_m
from tests.ingest.rasters import EGM96, Floats, coarse, hills, mosaic_of, north_up, write
from tiles import cells
from tiles.store import Store
from tiles.terrain import TEXTURE_SIDE

BESIDE = 11.3, 46.12
"""Lon, lat in degrees: beside the inset, in the coarse source of posts 550 m apart"""


@pytest.fixture
def nested(nested_folder: Path) -> Iterator[Mosaic]:
    with Store(nested_folder / "world.geopage") as store:
        yield Mosaic(store.connection, store.sources())


def slopes(mosaic: Mosaic, cell: int, side: int) -> Floats:
    lon, lat = lattice_places(cell, side, margin=1)
    step = step_m(cell, side)
    heights = mosaic.heights(lon.ravel(), lat.ravel(), step).reshape(lon.shape)
    return slopes_of(mosaic, lon, lat, heights, (step, step_m(cell, TEXTURE_SIDE)))


def cell_at(level: int) -> int:
    return int(cells.cell_at(*np.radians(BESIDE), level))


def test_small_tiles_take_slopes_over_the_posts_spacing(nested: Mosaic) -> None:
    """Within one triangle between posts the slope goes on changing: no facets."""
    spacing_m = nested.layers[0].spacing_m
    cell = cell_at(14)
    assert step_m(cell, 1) < 3 * spacing_m
    found = slopes(nested, cell, 64)
    change = np.abs(np.diff(found[..., :2], axis=1)).max()
    assert change < 3.0 * np.ptp(found[..., :2]) / 64
    assert np.unique(np.round(found[..., 0], 9)).size > 1000


def test_tiles_of_different_size_have_the_same_slopes_where_they_meet(
    nested: Mosaic,
) -> None:
    big, small = cell_at(13), int(cells.children(cell_at(13))[0])
    whole, part = slopes(nested, big, 64), slopes(nested, small, 32)
    np.testing.assert_allclose(part, whole[:33, :33], atol=1e-9)


def test_small_tiles_exaggerate_as_leaves_of_the_same_source_do(nested: Mosaic) -> None:
    spacing_m = nested.layers[0].spacing_m
    found = slopes(nested, cell_at(15), 8)[..., 2]
    np.testing.assert_allclose(found, steeper_of(np.array(spacing_m / LEAF_TEXELS)))


def test_spacing_is_that_of_the_source_that_shows(nested: Mosaic) -> None:
    lon, lat = np.radians([11.17, BESIDE[0], 60.0]), np.radians([46.11, BESIDE[1], 20.0])
    coarse, fine = (layer.spacing_m for layer in nested.layers)
    np.testing.assert_array_equal(nested.spacing_m(lon, lat), [fine, coarse, np.inf])


def test_a_small_hole_is_shaded_like_the_ground_around_it(tmp_path: Path) -> None:
    posts, where = hills((600, 600), 0.6, 300.0), north_up(11.0, 46.4, 0.002)
    posts[30:33, 30:33] = -9999.0
    posts[20:40, 0:20] = -9999.0
    fine = write(tmp_path / "fine.tif", posts, where, "EPSG:4326", -9999.0)
    files = [(coarse(tmp_path / "coarse.tif"), EGM96), (fine, EGM96)]
    mosaic, connection = mosaic_of(tmp_path / "world.geopage", files)
    cell = int(cells.cell_at(*np.radians((11.06, 46.34)), 9))
    lon, lat = lattice_places(cell, 128)
    exaggerated = slopes(mosaic, cell, 128)[..., 2]
    connection.close()
    col = (np.degrees(lon) - 11.0) / 0.002 - 0.5
    row = (46.4 - np.degrees(lat)) / 0.002 - 0.5
    small = (np.abs(col - 31) < 1) & (np.abs(row - 31) < 1)
    large = (np.abs(col - 8) < 2) & (np.abs(row - 30) < 2)
    around = (np.abs(col - 28) < 4) & (np.abs(row - 10) < 4)
    assert small.any()
    assert large.any()
    assert np.unique(exaggerated[small]) == np.unique(exaggerated[around])
    assert (exaggerated[large] > exaggerated[around].max()).all()
