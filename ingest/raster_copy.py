# SPDX-License-Identifier: Apache-2.0
"""Copy a source raster into the store: square blocks, and halved copies of itself."""

import sqlite3
from collections.abc import Callable
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.windows import Window

from ingest.datum import undulation_m
from tiles.codec import zstd
from tiles.placement import Placement
from tiles.raster_blocks import BLOCK, Blocks, level_count, level_shape

LOWEST_M, HIGHEST_M = -12000.0, 9500.0
"""Elevations beyond these are no data, whatever the file says."""
CHECKED = {int(zstd.CompressionParameter.checksum_flag): 1}
Progress = Callable[[int, int, str], None]


def copy_in(
    connection: sqlite3.Connection,
    source: str,
    dataset: rasterio.DatasetReader,
    planned: dict[str, Any],
    progress: Progress,
) -> bool:
    """Copy a raster into the store, halved copies included; call inside a transaction.

    Elevations become heights above the ellipsoid, float32 m, NaN where there is no data;
    pictures stay uint8.

    Parameters
    ----------
    source : key of the copy
    planned : where the posts are, and what an elevation model's mean: unit_m, datum

    Returns
    -------
    Whether any post holds data.
    """
    height, width = dataset.height, dataset.width
    picture = dataset.dtypes[0] == "uint8" and dataset.count >= 3
    any_data = False
    unit_m = float(planned.get("unit_m", 1.0))
    rows = range(0, height, BLOCK)
    for done, top in enumerate(rows):
        window = Window(0, top, width, min(BLOCK, height - top))
        strip = (
            _picture(dataset, window)
            if picture
            else above_ellipsoid(_posts(dataset, window, unit_m), planned, top)
        )
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
) -> NDArray[np.float32]:
    stored = dataset.read(1, window=window).astype(np.float64)
    metres = (stored * dataset.scales[0] + dataset.offsets[0]) * unit_m
    valid = dataset.read_masks(1, window=window) > 0
    plausible = (metres > LOWEST_M) & (metres < HIGHEST_M)
    return np.where(valid & plausible, metres, np.nan).astype(np.float32)


def above_ellipsoid(
    elevation_m: NDArray[np.float32], planned: dict[str, Any], top: int
) -> NDArray[np.float32]:
    """Turn elevations of whole rows, the first being `top`, into heights."""
    if planned["datum"] == "ellipsoid":
        return elevation_m
    rows, cols = elevation_m.shape
    col, row = np.meshgrid(np.arange(cols, dtype=float), np.arange(top, top + rows) + 0.0)
    lon, lat = Placement(planned).places(col.ravel(), row.ravel())
    zero_m = undulation_m(planned["datum"], lon, lat).reshape(rows, cols)
    return (elevation_m + zero_m).astype(np.float32)


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
