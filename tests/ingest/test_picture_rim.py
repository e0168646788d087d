# SPDX-License-Identifier: Apache-2.0
"""A picture has no hard frame, and pictures side by side have none between them."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ingest.drape import COARSE_M, COARSE_SHARE, SHARE, drape
from ingest.layer import Layer
from ingest.picture_rim import rim_m
from ingest.terrain import RasterOptions, editing, plan
from ingest.terrain import copy as copy_source
from tests.ingest.rasters import north_up, write
from tiles import cells
from tiles.terrain import TEXTURE_SIDE

CELL = int(cells.cell_at(np.radians(11.0), np.radians(40.0), 8))
WEST, SOUTH, EAST, NORTH = np.degrees(cells.bounds_rad(CELL))
STEP = float(EAST - WEST) / 120
DARK, BRIGHT = 40, 200
Pictures = dict[str, Layer]


@pytest.fixture
def pictures(tmp_path: Path) -> Iterator[Pictures]:
    """A coarse dark one, and two bright ones that meet at the middle of the cell."""
    middle, top = float(WEST + EAST) / 2, float(NORTH) + STEP
    files = {
        "wide": (DARK, north_up(float(WEST) - 2, float(NORTH) + 2, 0.05), (90, 90)),
        "left": (
            BRIGHT,
            north_up(middle - 50 * STEP, top, STEP),
            (122, 50),
        ),
        "right": (BRIGHT, north_up(middle, top, STEP), (122, 50)),
    }
    store, sources = tmp_path / "world.geopage", {}
    with editing(store) as writer:
        for name, (grey, where, shape) in files.items():
            bands = np.full((3, *shape), grey, np.uint8)
            file = write(tmp_path / f"{name}.tif", bands, where, "EPSG:4326")
            planned = plan(file, RasterOptions("imagery"))
            sources[name] = copy_source(writer, planned, lambda *_: None)
    connection = sqlite3.connect(store)
    yield {name: Layer(connection, source) for name, source in sources.items()}
    connection.close()


def row_of(pictures: Pictures, names: str) -> np.ndarray:
    shown = drape(CELL, [pictures[name] for name in names.split()])
    return np.asarray(shown[TEXTURE_SIDE // 2, :, 0])


def test_a_rim_has_no_step(pictures: Pictures) -> None:
    row, under = row_of(pictures, "wide left"), DARK * COARSE_SHARE
    assert pictures["wide"].spacing_m > COARSE_M > pictures["left"].spacing_m
    assert row.max() == pytest.approx(BRIGHT, abs=0.1)
    assert row.min() == pytest.approx(under, abs=0.1)
    texels = rim_m(pictures["left"]) / (np.radians(NORTH - SOUTH) * 6378137 / 256)
    assert texels > 4
    assert np.abs(np.diff(row)).max() < 2.5 * (BRIGHT - under) / texels


def test_pictures_side_by_side_have_no_rim_between_them(pictures: Pictures) -> None:
    row = row_of(pictures, "wide left right")
    np.testing.assert_allclose(row[64:-64], BRIGHT, atol=0.1)


def test_a_rim_is_no_wider_than_it_says(pictures: Pictures) -> None:
    shown = drape(CELL, [pictures["left"]])[TEXTURE_SIDE // 2, :, SHARE]
    west = 128 - 50 / 120 * TEXTURE_SIDE
    texels = rim_m(pictures["left"]) / (np.radians(NORTH - SOUTH) * 6378137 / 256)
    inside = np.arange(TEXTURE_SIDE) + 0.5 - west
    per_texel = np.cos(np.radians(40.0))
    assert (shown[(inside * per_texel > 1.2 * texels) & (inside < 50)] > 0.999).all()
    assert not shown[inside < -1].any()
