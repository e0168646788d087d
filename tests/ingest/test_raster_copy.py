# SPDX-License-Identifier: Apache-2.0
"""A raster's copy in the store: the same posts, and halves of them."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
import rasterio

from ingest.raster_copy import copy_in
from tests.ingest.rasters import north_up, write
from tiles.errors import InputError
from tiles.raster_blocks import Blocks, level_count, level_shape
from tiles.writer import Writer

PLANNED = {"unit_m": 1.0, "datum": "ellipsoid"}


def copied(
    folder: Path, posts: np.ndarray, nodata: float | None = None
) -> tuple[sqlite3.Connection, bool]:
    path = write(folder / "a.tif", posts, north_up(0, 0, 1e-3), "EPSG:4326", nodata)
    writer = Writer(folder / "a.geopage")
    with writer, rasterio.open(path) as dataset, writer.transaction():
        held = copy_in(writer.connection, "a", dataset, PLANNED, lambda a, b, c: None)
    return sqlite3.connect(folder / "a.geopage"), held


@pytest.mark.parametrize("shape", [(1, 1), (256, 256), (300, 700), (257, 1025)])
def test_the_posts_come_back(
    shape: tuple[int, int], tmp_path: Path, rng: np.random.Generator
) -> None:
    posts = rng.normal(500, 100, shape).astype(np.float32)
    connection, held = copied(tmp_path, posts)
    blocks = Blocks(connection, "a", shape)
    np.testing.assert_array_equal(blocks.window(0, 0, shape[0], 0, shape[1]), posts)
    assert held
    connection.close()


def test_levels_end_when_one_block_holds_all() -> None:
    assert level_count(256, 256) == 1
    assert level_count(257, 3) == 2
    assert level_shape(700, 300, 1) == (150, 350)
    assert level_shape(7, 5, 2) == (2, 2)


def test_a_level_is_the_mean_of_two_by_two_known_posts(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    posts = rng.normal(500, 100, (300, 520)).astype(np.float32)
    posts[10:14, 20:24] = np.nan
    posts[100, 100] = np.nan
    connection, _ = copied(tmp_path, posts)
    half = Blocks(connection, "a", posts.shape).window(1, 0, 150, 0, 260)
    quads = posts.reshape(150, 2, 260, 2).astype(float)
    known = np.isfinite(quads)
    mean = np.where(known, quads, 0).sum(axis=(1, 3)) / np.maximum(
        known.sum(axis=(1, 3)), 1
    )
    mean[known.sum(axis=(1, 3)) == 0] = np.nan
    np.testing.assert_allclose(half, mean, rtol=1e-6)
    connection.close()


def test_windows_repeat_the_edge_or_wrap(tmp_path: Path) -> None:
    posts = np.arange(6, dtype=np.float32).reshape(2, 3)
    connection, _ = copied(tmp_path, posts)
    clamped = Blocks(connection, "a", (2, 3)).window(0, -1, 3, -2, 4)
    assert clamped[0].tolist() == [0, 0, 0, 1, 2, 2]
    assert clamped[-1].tolist() == [3, 3, 3, 4, 5, 5]
    wrapped = Blocks(connection, "a", (2, 3), wraps=True).window(0, 0, 1, -2, 4)
    assert wrapped[0].tolist() == [1, 2, 0, 1, 2, 0]
    connection.close()


def test_a_raster_without_any_data_says_so(tmp_path: Path) -> None:
    connection, held = copied(tmp_path, np.full((5, 5), -1, np.int16), -1)
    assert not held
    connection.close()


def test_a_damaged_or_missing_block_is_refused(tmp_path: Path) -> None:
    connection, _ = copied(tmp_path, np.ones((300, 300), np.float32))
    connection.execute("DELETE FROM raster_block WHERE level=0 AND row=1")
    connection.execute("UPDATE raster_block SET body=x'0011' WHERE level=1")
    blocks = Blocks(connection, "a", (300, 300))
    for level, top in ((0, 290), (1, 0)):
        with pytest.raises(InputError, match="damaged"):
            blocks.window(level, top, top + 1, 0, 1)
    connection.close()
