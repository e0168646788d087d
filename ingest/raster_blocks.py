# SPDX-License-Identifier: Apache-2.0
"""A source raster inside the store: square blocks, and halved copies of itself.

The store keeps what it was made from, so that a source can be replaced or removed and
the terrain made again without the original files.
"""

import sqlite3
from collections import OrderedDict
from collections.abc import Callable, Iterator

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.windows import Window

from tiles.codec import zstd
from tiles.errors import InputError

BLOCK = 256
CACHE_BLOCKS = 1024
LOWEST_M, HIGHEST_M = -12000.0, 9500.0
"""Elevations beyond these are no data, whatever the file says."""
CHECKED = {int(zstd.CompressionParameter.checksum_flag): 1}
Progress = Callable[[int, int, str], None]


def level_shape(width: int, height: int, level: int) -> tuple[int, int]:
    """Return (height, width) of the copy that was halved `level` times."""
    ceil = (1 << level) - 1
    return (height + ceil) >> level, (width + ceil) >> level


def level_count(width: int, height: int) -> int:
    """Levels until the whole raster fits one block."""
    count = 1
    while max(level_shape(width, height, count - 1)) > BLOCK:
        count += 1
    return count


def copy_in(
    connection: sqlite3.Connection,
    source: str,
    dataset: rasterio.DatasetReader,
    unit_m: float,
    progress: Progress,
) -> bool:
    """Copy a raster into the store, halved copies included; call inside a transaction.

    Elevations become float32 metres with NaN where there is no data; pictures stay uint8.

    Parameters
    ----------
    unit_m : metres of the elevations' unit

    Returns
    -------
    Whether any post holds data.
    """
    height, width = dataset.height, dataset.width
    picture = dataset.dtypes[0] == "uint8" and dataset.count >= 3
    any_data = False
    rows = range(0, height, BLOCK)
    for done, top in enumerate(rows):
        window = Window(0, top, width, min(BLOCK, height - top))
        strip = _picture(dataset, window) if picture else _posts(dataset, window, unit_m)
        any_data |= picture or bool(np.isfinite(strip).any())
        _write_strip(connection, source, 0, top // BLOCK, strip)
        progress(done + 1, len(rows), f"reading {source.split('@', maxsplit=1)[0]}")
    blocks = Blocks(connection, source, (height, width))
    for level in range(1, level_count(width, height)):
        _halve_level(connection, blocks, level)
    return any_data


def _picture(dataset: rasterio.DatasetReader, window: Window) -> NDArray[np.generic]:
    return np.asarray(np.moveaxis(dataset.read([1, 2, 3], window=window), 0, -1))


def _posts(
    dataset: rasterio.DatasetReader, window: Window, unit_m: float
) -> NDArray[np.generic]:
    stored = dataset.read(1, window=window).astype(np.float64)
    metres = (stored * dataset.scales[0] + dataset.offsets[0]) * unit_m
    valid = dataset.read_masks(1, window=window) > 0
    plausible = (metres > LOWEST_M) & (metres < HIGHEST_M)
    return np.where(valid & plausible, metres, np.nan).astype(np.float32)


def _write_strip(
    connection: sqlite3.Connection,
    source: str,
    level: int,
    row: int,
    strip: NDArray[np.generic],
) -> None:
    for col, left in enumerate(range(0, strip.shape[1], BLOCK)):
        block = np.ascontiguousarray(strip[:, left : left + BLOCK])
        body = zstd.compress(block.tobytes(), options=CHECKED)
        key = (source, level, row, col, body)
        connection.execute("INSERT OR REPLACE INTO raster_block VALUES(?,?,?,?,?)", key)


def _halve_level(connection: sqlite3.Connection, blocks: "Blocks", level: int) -> None:
    height, width = level_shape(blocks.width, blocks.height, level)
    for row, top in enumerate(range(0, height, BLOCK)):
        bottom = min(top + BLOCK, height)
        finer = blocks.window(level - 1, 2 * top, 2 * bottom, 0, 2 * width)
        _write_strip(connection, blocks.source, level, row, _halve(finer))


def _halve(finer: NDArray[np.generic]) -> NDArray[np.generic]:
    """Average 2 x 2 posts; where some hold no data, the others."""
    quads = np.stack([finer[r::2, c::2] for r in (0, 1) for c in (0, 1)]).astype(np.float32)
    known = np.isfinite(quads)
    total = np.where(known, quads, 0).sum(axis=0)
    with np.errstate(invalid="ignore"):
        mean = total / known.sum(axis=0)
    halved = np.rint(mean) if finer.dtype == np.uint8 else mean
    return np.asarray(halved.astype(finer.dtype))


class Blocks:
    """Windows of one source's levels, with a small cache of decoded blocks."""

    def __init__(
        self,
        connection: sqlite3.Connection,
        source: str,
        shape: tuple[int, int],
        *,
        wraps: bool = False,
    ) -> None:
        self.source, self.wraps = source, wraps
        self.height, self.width = shape
        self._connection = connection
        self._cache: OrderedDict[tuple[int, int, int], NDArray[np.generic]] = OrderedDict()
        first = self._block(0, 0, 0)
        self.bands = 3 if first.ndim == 3 else 1
        self.dtype = first.dtype

    def window(
        self, level: int, top: int, bottom: int, left: int, right: int
    ) -> NDArray[np.generic]:
        """Return posts [top, bottom) x [left, right) of a level.

        Rows and columns outside repeat the nearest one; columns of a raster that goes
        round the globe wrap.
        """
        height, width = level_shape(self.width, self.height, level)
        rows = np.clip(np.arange(top, bottom), 0, height - 1)
        cols = np.arange(left, right)
        cols = cols % width if self.wraps else np.clip(cols, 0, width - 1)
        shape = (len(rows), len(cols), 3)[: 2 + (self.bands == 3)]
        out = np.empty(shape, self.dtype)
        for r, c in self._touched(rows, cols):
            block = self._block(level, r, c)
            y, x = np.flatnonzero(rows // BLOCK == r), np.flatnonzero(cols // BLOCK == c)
            out[np.ix_(y, x)] = block[rows[y] - r * BLOCK][:, cols[x] - c * BLOCK]
        return out

    @staticmethod
    def _touched(
        rows: NDArray[np.int64], cols: NDArray[np.int64]
    ) -> Iterator[tuple[int, int]]:
        for r in np.unique(rows // BLOCK):
            for c in np.unique(cols // BLOCK):
                yield int(r), int(c)

    def _block(self, level: int, row: int, col: int) -> NDArray[np.generic]:
        key = (level, row, col)
        if key in self._cache:
            self._cache.move_to_end(key)
            return self._cache[key]
        found = self._connection.execute(
            "SELECT body FROM raster_block WHERE source=? AND level=? AND row=? AND col=?",
            (self.source, *key),
        ).fetchone()
        try:
            block = self._decode(level, row, col, zstd.decompress(found[0]))
        except (TypeError, ValueError, zstd.ZstdError) as error:
            advice = "ingest the source again"
            raise InputError(self.source, "its copy is damaged", advice) from error
        self._cache[key] = block
        if len(self._cache) > CACHE_BLOCKS:
            self._cache.popitem(last=False)
        return block

    def _decode(self, level: int, row: int, col: int, raw: bytes) -> NDArray[np.generic]:
        height, width = level_shape(self.width, self.height, level)
        rows, cols = min(BLOCK, height - row * BLOCK), min(BLOCK, width - col * BLOCK)
        if len(raw) == rows * cols * 4:
            return np.frombuffer(raw, np.float32).reshape(rows, cols)
        return np.frombuffer(raw, np.uint8).reshape(rows, cols, 3)
