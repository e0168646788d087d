# SPDX-License-Identifier: Apache-2.0
"""Copy a source raster into the store: square blocks, and halved copies of itself.

The raster goes through memory in chunks, and each chunk is committed with a note of how
far the copy is. Whatever the raster's size, a copy holds no more than a few chunks.
"""

import secrets
import sqlite3
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.enums import ColorInterp
from rasterio.windows import Window

from ingest.geoid import ZeroSurface
from ingest.journal import Journal
from ingest.picture_copy import halve_colours, read_colours
from ingest.progress import Progress
from tiles.codec import zstd
from tiles.frames import Floats
from tiles.kernels import kernel
from tiles.raster_blocks import BLOCK, Blocks, level_count, level_shape

LOWEST_M, HIGHEST_M = -12000.0, 9500.0
"""Elevations beyond these are no data, whatever the file says."""
FILLER, DEEP_M = -9999.0, -9000.0
"""No data where the file does not say so, unless somewhere in it posts are as deep."""
VOIDS = -32768.0, -32767.0
"""No data in files of 16 bits, where the file does not say so"""
CHUNK_COLS = 16 * BLOCK
CHECKED = {int(zstd.CompressionParameter.checksum_flag): 1}
REASONS = (
    "no data",
    "no data, not declared",
    "not an elevation",
    "beyond the datum's grid",
    "beyond the edge of its map",
)


@dataclass(frozen=True, slots=True)
class Copied:
    """How far a copy is, as the journal holds it."""

    blocks: str
    """key of the copy"""
    chunks: int = 0
    stored: int = 0
    """posts that hold data"""
    skipped: tuple[int, ...] = (0,) * len(REASONS)
    """posts that do not, by reason"""

    def plus(self, counts: NDArray[np.int64]) -> "Copied":
        """Count one more chunk in."""
        skipped = tuple(int(a + b) for a, b in zip(self.skipped, counts[1:], strict=True))
        return replace(
            self,
            chunks=self.chunks + 1,
            stored=self.stored + int(counts[0]),
            skipped=skipped,
        )


@dataclass(frozen=True, slots=True)
class Chunk:
    """A part of one level that is copied at once."""

    level: int
    top: int
    left: int
    rows: int
    cols: int


def chunks_of(width: int, height: int) -> list[Chunk]:
    """Return a raster's chunks, each level after the finer one that it is made from."""
    found = []
    for level in range(level_count(width, height)):
        h, w = level_shape(width, height, level)
        found += [
            Chunk(level, top, left, min(BLOCK, h - top), min(CHUNK_COLS, w - left))
            for top in range(0, h, BLOCK)
            for left in range(0, w, CHUNK_COLS)
        ]
    return found


def copy_in(
    journal: Journal,
    name: str,
    dataset: rasterio.DatasetReader,
    planned: dict[str, Any],
    progress: Progress,
) -> Copied:
    """Copy a raster into the store, halved copies included, from where it was left.

    Elevations become heights above the ellipsoid, float32 m, NaN where there is no data;
    pictures stay uint8, with 0, 0, 0 where they are transparent.

    Parameters
    ----------
    name : of the copy in the journal; another for another file or other options
    planned : where the posts are, and what an elevation model's mean: unit_m, datum
    """
    key = f"copy {name}"
    source = str(planned.get("name", name))
    said = journal.said(key) or {"blocks": f"{source}@{secrets.token_hex(4)}"}
    copied = Copied(**{**said, "skipped": tuple(said.get("skipped", (0,) * len(REASONS)))})
    chunks = chunks_of(dataset.width, dataset.height)
    read = _reader(dataset, planned)
    connection = journal.writer.connection
    total, posts = sum(one.rows * one.cols for one in chunks), 0
    for number, chunk in enumerate(chunks):
        posts += chunk.rows * chunk.cols
        if number < copied.chunks:
            continue
        if chunk.level:
            made, counts = _halved(connection, copied.blocks, planned, chunk), _NONE
        else:
            made, counts = read(chunk)
        with journal.step():
            _write(connection, copied.blocks, chunk, made)
            copied = copied.plus(counts)
            journal.say(key, asdict(copied), copied.blocks)
        progress(posts, total, f"reading {source}")
    return copied


_NONE = np.zeros(1 + len(REASONS), np.int64)
Read = Callable[[Chunk], tuple[NDArray[np.generic], NDArray[np.int64]]]


def _reader(dataset: rasterio.DatasetReader, planned: dict[str, Any]) -> Read:
    """Return how chunks of the finest level are read, and their posts counted."""
    if dataset.dtypes[0] == "uint8" and dataset.count >= 3:

        def colours(chunk: Chunk) -> tuple[NDArray[np.generic], NDArray[np.int64]]:
            found, counts = read_colours(dataset, _window(chunk)), _NONE.copy()
            counts[0] = np.count_nonzero(found[..., 0])
            counts[1] = chunk.rows * chunk.cols - counts[0]
            return found, counts

        return colours
    zero = ZeroSurface({"spacing_m": 1.0, **planned, **_size(dataset)})
    unit_m = float(planned.get("unit_m", 1.0))
    scale, offset = dataset.scales[0] * unit_m, dataset.offsets[0] * unit_m
    is_deep = cache(lambda: _is_deep(dataset, scale, offset))

    def heights(chunk: Chunk) -> tuple[NDArray[np.generic], NDArray[np.int64]]:
        stored, mask = _posts(dataset, chunk)
        # Judged by the whole file, but only where it matters: all is read for it.
        meant = ((stored == FILLER) & (mask != 0)).any() and is_deep()
        filler = np.nan if meant else FILLER
        zero_m = zero.at(chunk.top, chunk.left, chunk.rows, chunk.cols)
        counts = _NONE.copy()
        return _heights(stored, mask, zero_m, scale, offset, filler, counts), counts

    return heights


def _is_deep(dataset: rasterio.DatasetReader, scale: float, offset: float) -> bool:
    """Say whether a raster holds posts about as deep as the number for no data."""
    for chunk in chunks_of(dataset.width, dataset.height):
        if chunk.level:
            break
        stored, mask = _posts(dataset, chunk)
        metres = stored * scale + offset
        near = (metres > LOWEST_M) & (metres < DEEP_M) & (mask != 0)
        if (near & ~np.isin(stored, (FILLER, *VOIDS))).any():
            return True
    return False


def _size(dataset: rasterio.DatasetReader) -> dict[str, int]:
    return {"width": dataset.width, "height": dataset.height}


def _window(chunk: Chunk) -> Window:
    return Window(chunk.left, chunk.top, chunk.cols, chunk.rows)


def _posts(
    dataset: rasterio.DatasetReader, chunk: Chunk
) -> tuple[Floats, NDArray[np.uint8]]:
    """Read a chunk of the finest level as it is stored, and what is known of it."""
    window = _window(chunk)
    stored = dataset.read(1, window=window).astype(np.float64)
    mask = dataset.read_masks(1, window=window)
    # GDAL itself heeds an alpha band beside 8 bits, or 16 without a sign, only.
    if ColorInterp.alpha in dataset.colorinterp[1:]:
        alpha = 1 + dataset.colorinterp.index(ColorInterp.alpha)
        mask *= dataset.read(alpha, window=window) != 0
    return stored, mask


@kernel
def _heights(
    stored: Floats,
    mask: NDArray[np.uint8],
    zero_m: Floats,
    scale: float,
    offset: float,
    filler: float,
    counts: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Turn elevations to heights above the ellipsoid, (rows, cols), and count them.

    Parameters
    ----------
    filler : stands for no data though the file does not say so; NaN for none
    """
    out = np.empty(stored.shape, np.float32)
    for i in range(stored.shape[0]):
        for j in range(stored.shape[1]):
            value = stored[i, j]
            metres = value * scale + offset
            height = np.float32(metres + zero_m[i, j])
            known = LOWEST_M < metres < HIGHEST_M and not _is_void(value, metres)
            why = 0
            if mask[i, j] == 0 or np.isnan(value):
                why = 1
            elif value == filler or (not known and _is_filler(value)):
                why = 2
            elif not known:
                why = 3
            elif not np.isfinite(height):
                why = 5 if np.isinf(zero_m[i, j]) else 4
            counts[why] += 1
            out[i, j] = height if why == 0 else np.nan
    return out


@kernel
def _is_void(value: float, metres: float) -> bool:
    """Say whether a number is a 16-bit file's for no data, though as feet it is a depth."""
    return value == VOIDS[0] or (value == VOIDS[1] and metres < DEEP_M)


@kernel
def _is_filler(value: float) -> bool:
    """Say whether a number that is no elevation is one that stands for no data."""
    return value in (VOIDS[0], VOIDS[1], -99999.0) or abs(value) > 1e30


def _write(
    connection: sqlite3.Connection,
    source: str,
    chunk: Chunk,
    posts: NDArray[np.generic],
) -> None:
    row = chunk.top // BLOCK
    for left in range(0, chunk.cols, BLOCK):
        block = np.ascontiguousarray(posts[:, left : left + BLOCK])
        body = zstd.compress(block.tobytes(), options=CHECKED)
        key = (source, chunk.level, row, (chunk.left + left) // BLOCK, body)
        connection.execute("INSERT OR REPLACE INTO raster_block VALUES(?,?,?,?,?)", key)


def _halved(
    connection: sqlite3.Connection, source: str, planned: dict[str, Any], chunk: Chunk
) -> NDArray[np.generic]:
    """Average the finer level's posts in a chunk two by two."""
    shape = (int(planned["height"]), int(planned["width"]))
    # Opened for each chunk: its cache would grow to all that was ever read.
    blocks = Blocks(connection, source, shape)
    top, left = 2 * chunk.top, 2 * chunk.left
    finer = blocks.window(
        chunk.level - 1, top, top + 2 * chunk.rows, left, left + 2 * chunk.cols
    )
    return halve(finer)


def halve(finer: NDArray[np.generic]) -> NDArray[np.generic]:
    """Average 2 x 2 posts; where some hold no data, the others."""
    if finer.ndim == 2:
        return _halve_heights(finer.astype(np.float32, copy=False))
    return halve_colours(finer.astype(np.uint8, copy=False))


@kernel
def _halve_heights(finer: NDArray[np.float32]) -> NDArray[np.float32]:
    out = np.empty((finer.shape[0] // 2, finer.shape[1] // 2), np.float32)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total, known = np.float32(0.0), np.float32(0.0)
            for k in range(4):
                height = finer[2 * i + k // 2, 2 * j + k % 2]
                if not np.isnan(height):
                    total += height
                    known += np.float32(1.0)
            out[i, j] = total / known if known > 0 else np.float32(np.nan)
    return out
