# SPDX-License-Identifier: Apache-2.0
"""A raster's copy in the store: the same posts, and halves of them."""

import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import rasterio
from numpy.typing import NDArray

from ingest import raster_copy
from ingest.journal import Journal
from ingest.raster_copy import Copied, chunks_of, copy_in
from ingest.raster_open import open_raster
from ingest.raster_plan import RasterOptions, plan
from tests.ingest.rasters import geoid_m, hills, north_up, write
from tiles.errors import InputError
from tiles.raster_blocks import BLOCK, Blocks, level_count, level_shape
from tiles.writer import Writer

WHERE = north_up(0, 1, 1e-4)
ELLIPSOID = RasterOptions(datum="ellipsoid")
Posts = NDArray[Any]


def told(done: int, total: int, what: str) -> None:
    assert 0 < done <= total
    assert what == "reading a"


def copied(
    folder: Path, posts: Posts, nodata: float | None = None, crs: str = "EPSG:4326"
) -> tuple[sqlite3.Connection, Copied]:
    path = folder / "a.tif"
    where = north_up(0, 1, 1e-4) if crs == "EPSG:4326" else north_up(6e5, 5.1e6, 90.0)
    write(path, posts, where, crs, nodata)
    return copied_from(path, ELLIPSOID)


def copied_from(path: Path, options: RasterOptions) -> tuple[sqlite3.Connection, Copied]:
    store = path.with_suffix(".geopage")
    with Writer(store) as writer, open_raster(path) as dataset:
        held = copy_in(Journal(writer), "k", dataset, plan(path, options), told)
    return sqlite3.connect(store), held


@pytest.mark.parametrize("shape", [(2, 2), (256, 256), (300, 700), (257, 4500)])
def test_the_posts_come_back(
    shape: tuple[int, int], tmp_path: Path, rng: np.random.Generator
) -> None:
    posts = rng.normal(500, 100, shape).astype(np.float32)
    connection, held = copied(tmp_path, posts)
    blocks = Blocks(connection, held.blocks, shape)
    np.testing.assert_array_equal(blocks.window(0, 0, shape[0], 0, shape[1]), posts)
    assert held.stored == posts.size
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
    connection, held = copied(tmp_path, posts)
    half = Blocks(connection, held.blocks, posts.shape).window(1, 0, 150, 0, 260)
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
    connection, held = copied(tmp_path, posts)
    clamped = Blocks(connection, held.blocks, (2, 3)).window(0, -1, 3, -2, 4)
    assert clamped[0].tolist() == [0, 0, 0, 1, 2, 2]
    assert clamped[-1].tolist() == [3, 3, 3, 4, 5, 5]
    wrapped = Blocks(connection, held.blocks, (2, 3), wraps=True).window(0, 0, 1, -2, 4)
    assert wrapped[0].tolist() == [1, 2, 0, 1, 2, 0]
    connection.close()


def test_a_raster_without_any_data_says_so(tmp_path: Path) -> None:
    connection, held = copied(tmp_path, np.full((5, 5), -1, np.int16), -1)
    assert (held.stored, held.skipped[0]) == (0, 25)
    connection.close()


def test_a_damaged_or_missing_block_is_refused(tmp_path: Path) -> None:
    connection, held = copied(tmp_path, np.ones((300, 300), np.float32))
    connection.execute("DELETE FROM raster_block WHERE level=0 AND row=1")
    connection.execute("UPDATE raster_block SET body=x'0011' WHERE level=1")
    blocks = Blocks(connection, held.blocks, (300, 300))
    for level, top in ((0, 290), (1, 0)):
        with pytest.raises(InputError, match="damaged"):
            blocks.window(level, top, top + 1, 0, 1)
    connection.close()


def test_every_post_is_counted_by_what_it_is(tmp_path: Path) -> None:
    posts = np.full((20, 30), 100, np.float64)
    posts[0, :5] = -1.0  # declared
    posts[1, :4] = np.nan
    posts[2, :6] = -9999.0
    posts[3, :2] = -32768.0
    posts[4, :2] = -3.4e38
    posts[5, :7] = 20_000.0
    connection, held = copied(tmp_path, posts, -1.0)
    assert dict(zip(raster_copy.REASONS, held.skipped, strict=True)) == {
        "no data": 9,
        "no data, not declared": 10,
        "not an elevation": 7,
        "beyond the datum's grid": 0,
        "beyond the edge of its map": 0,
    }
    assert held.stored == 600 - 26
    block = Blocks(connection, held.blocks, (20, 30)).window(0, 0, 20, 0, 30)
    assert np.isfinite(block).sum() == held.stored
    connection.close()


def test_in_a_trench_9999_metres_of_depth_are_a_depth(tmp_path: Path) -> None:
    posts = np.linspace(-10_400, -9_500, 901, dtype=np.float64).reshape(17, 53)
    assert (posts == -9999).sum() == 1
    connection, held = copied(tmp_path, posts)
    assert held.stored == posts.size
    connection.close()


@pytest.mark.parametrize("deep", [True, False])
def test_whether_9999_is_a_depth_is_judged_by_the_whole_file(
    tmp_path: Path, *, deep: bool
) -> None:
    """Also where the trench is in another part than is read at once."""
    posts = np.full((3 * BLOCK, 40), -50.0, np.float32)
    posts[10, ::2] = posts[-10, ::2] = -9999.0
    posts[BLOCK + 10] = -10_000.0 if deep else -8000.0
    posts[20, 3] = -9500.0  # declared: no depth
    connection, held = copied(tmp_path, posts, -9500.0)
    assert held.stored == posts.size - 1 - (0 if deep else 40)
    connection.close()


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:32632", "EPSG:3413"])
def test_heights_stand_on_the_geoid_at_every_post(crs: str, tmp_path: Path) -> None:
    where = north_up(10, 47, 1e-2) if crs == "EPSG:4326" else north_up(-1e4, 1e4, 90.0)
    posts = hills((300, 270), 1.0, 200.0)
    path = write(tmp_path / "a.tif", posts, where, crs)
    connection, held = copied_from(path, RasterOptions(datum="egm96"))
    found = Blocks(connection, held.blocks, posts.shape).window(0, 0, 300, 0, 270)
    row, col = np.mgrid[:300, :270]
    a, _, c, _, e, f = tuple(where)[:6]
    x, y = a * (col.ravel() + 0.5) + c, e * (row.ravel() + 0.5) + f
    lon, lat = pyproj.Transformer.from_crs(crs, 4326, always_xy=True).transform(x, y)
    truth = posts.ravel() + geoid_m(np.asarray(lon), np.asarray(lat))
    np.testing.assert_allclose(found.ravel(), truth, atol=1e-3)
    connection.close()


def test_chunks_cover_every_level_once() -> None:
    width, height = 9000, 700
    for level in range(level_count(width, height)):
        rows, cols = level_shape(width, height, level)
        seen = np.zeros((rows, cols), int)
        for one in chunks_of(width, height):
            if one.level == level:
                seen[one.top : one.top + one.rows, one.left : one.left + one.cols] += 1
        assert (seen == 1).all()
    levels = [one.level for one in chunks_of(width, height)]
    assert levels == sorted(levels)


@pytest.mark.parametrize("stop", [1, 3, 6])
def test_a_copy_goes_on_where_it_was(
    stop: int, tmp_path: Path, rng: np.random.Generator
) -> None:
    posts = rng.normal(500, 100, (1100, 300)).astype(np.float32)
    posts[:40] = -5
    path = write(tmp_path / "a.tif", posts, north_up(0, 1, 1e-4), "EPSG:4326", -5)
    whole, held = copied_from(path, ELLIPSOID)
    calls: list[int] = []

    def interrupt(done: int, *_: object) -> None:
        calls.append(done)
        if len(calls) == stop:
            raise KeyboardInterrupt

    planned = plan(path, ELLIPSOID)
    with Writer(tmp_path / "b.geopage") as writer, open_raster(path) as dataset:
        journal = Journal(writer)
        with pytest.raises(KeyboardInterrupt):
            copy_in(journal, "k", dataset, planned, interrupt)
        first = len(calls)
        again = copy_in(journal, "k", dataset, planned, interrupt)
        ask = "SELECT level, row, col, body FROM raster_block WHERE source=?"
        found = writer.connection.execute(ask, (again.blocks,)).fetchall()
        count = writer.connection.execute("SELECT COUNT(*) FROM raster_block").fetchone()
    assert (again.stored, again.skipped) == (held.stored, held.skipped)
    assert found == whole.execute(ask, (held.blocks,)).fetchall()
    assert count == (len(found),)
    assert first == stop
    assert len(calls) == held.chunks
    whole.close()


MEMORY = """
import sys
from pathlib import Path
from ingest.raster_open import open_raster
from ingest.raster_plan import RasterOptions
from ingest.terrain import copy, plan
from tiles.writer import Writer

def peak_mib():
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024

small, large = (plan(Path(word), RasterOptions(datum="egm96")) for word in sys.argv[1:])
with Writer(Path(sys.argv[1]).with_suffix(".geopage")) as writer:
    quiet = lambda done, total, what: None
    copy(writer, small, quiet)
    before = peak_mib()
    copy(writer, large, quiet)
    print(peak_mib() - before)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_copy_needs_no_more_memory_for_a_larger_raster(tmp_path: Path) -> None:
    """Whole rows of 30,000 posts: read at once they would take 500 MB, with places 1 GB."""
    small = write(tmp_path / "small.tif", hills((300, 300), 1.0, 99.0), WHERE, "EPSG:4326")
    large, posts = tmp_path / "large.tif", hills((256, 30_000), 1.0, 99.0)
    profile = {"driver": "GTiff", "width": 30_000, "height": 1000, "count": 1}
    profile |= {"dtype": "float32", "crs": "EPSG:4326", "sparse_ok": True}
    with rasterio.open(large, "w", **profile, transform=north_up(1, 50, 1e-4)) as out:
        out.write(posts, 1, window=((512, 768), (0, 30_000)))
    words = [sys.executable, "-c", MEMORY, str(small), str(large)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 150


@pytest.mark.parametrize("void", [-32768, -32767])
@pytest.mark.parametrize("dtype", [np.int16, np.float32])
def test_what_a_16_bit_file_has_for_no_data_is_no_depth_in_feet(
    void: int, dtype: type, tmp_path: Path
) -> None:
    posts = np.full((20, 30), 1000, dtype)
    posts[3:6, 4:9] = void
    posts[10, :3] = -9999  # nor does it make a trench of the file, where this is a depth
    path = write(tmp_path / "a.tif", posts, WHERE, "EPSG:4326")
    options = RasterOptions(datum="ellipsoid", units="ft")
    connection, held = copied_from(path, options)
    found = Blocks(connection, held.blocks, posts.shape).window(0, 0, 20, 0, 30)
    np.testing.assert_array_equal(np.isnan(found), posts != 1000)
    assert held.skipped == (0, 18, 0, 0, 0)
    connection.close()


@pytest.mark.parametrize("dtype", [np.int16, np.uint16, np.float32])
def test_where_an_alpha_band_is_clear_there_is_no_data(dtype: type, tmp_path: Path) -> None:
    """As gdalwarp -dstalpha writes it; GDAL itself heeds 16 bits without a sign only."""
    posts = np.full((2, 20, 30), 500, dtype)
    posts[:, 3:6, 4:9] = 0
    path, size = tmp_path / "a.tif", {"height": 20, "width": 30, "count": 2}
    where = {"transform": WHERE, "crs": "EPSG:4326"}
    with rasterio.open(path, "w", dtype=dtype, alpha="yes", **size, **where) as out:
        out.write(posts)
    connection, held = copied_from(path, ELLIPSOID)
    found = Blocks(connection, held.blocks, (20, 30)).window(0, 0, 20, 0, 30)
    np.testing.assert_array_equal(np.isnan(found), posts[1] == 0)
    assert held.skipped == (15, 0, 0, 0, 0)
    connection.close()
