# SPDX-License-Identifier: Apache-2.0
"""Reading the source rasters that a store keeps: square blocks, and halved copies.

The store keeps what it was made from, so that a source can be replaced or removed and
the terrain made again, and what is drawn can be checked, without the original files.
Elevation models hold heights above the ellipsoid, float32 m, NaN where there is no data.
"""

import sqlite3
from collections import OrderedDict
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tiles.codec import zstd
from tiles.errors import InputError

BLOCK = 256
CACHE_BLOCKS = 1024


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


Key = tuple[str, int, int, int]


class BlockCache:
    """Decoded blocks of any number of sources of one store, those last used."""

    def __init__(self, most: int = CACHE_BLOCKS) -> None:
        self._most = most
        self._blocks: OrderedDict[Key, NDArray[np.generic]] = OrderedDict()

    def get(self, key: Key) -> NDArray[np.generic] | None:
        """Return a block that is there."""
        if key not in self._blocks:
            return None
        self._blocks.move_to_end(key)
        return self._blocks[key]

    def put(self, key: Key, block: NDArray[np.generic]) -> None:
        """Keep a block; the one that was not used for longest goes."""
        self._blocks[key] = block
        if len(self._blocks) > self._most:
            self._blocks.popitem(last=False)


class Blocks:
    """Windows of one source's levels; decoded blocks are kept in a cache."""

    def __init__(
        self,
        connection: sqlite3.Connection,
        source: str,
        shape: tuple[int, int],
        *,
        wraps: bool = False,
        cache: BlockCache | None = None,
    ) -> None:
        self.source, self.wraps = source, wraps
        self.height, self.width = shape
        self._connection = connection
        self._cache = BlockCache() if cache is None else cache
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
        if 0 <= top < bottom <= height and 0 <= left < right <= width:
            return self._inside(level, top, bottom, left, right)
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

    def posts_at(
        self, row: NDArray[np.int64], col: NDArray[np.int64]
    ) -> NDArray[np.generic]:
        """Return single posts of the raster as read, (n,); see `window` for outside."""
        row = np.clip(row, 0, self.height - 1)
        col = col % self.width if self.wraps else np.clip(col, 0, self.width - 1)
        unique, which = np.unique((row // BLOCK, col // BLOCK), axis=1, return_inverse=True)
        out = np.empty(len(row), self.dtype)
        for k, (r, c) in enumerate(unique.T.tolist()):
            at = np.flatnonzero(which == k)
            out[at] = self._block(0, r, c)[row[at] - r * BLOCK, col[at] - c * BLOCK]
        return out

    def _inside(
        self, level: int, top: int, bottom: int, left: int, right: int
    ) -> NDArray[np.generic]:
        """Read a window that lies in the raster."""
        shape = (bottom - top, right - left, 3)[: 2 + (self.bands == 3)]
        out = np.empty(shape, self.dtype)
        for r in range(top // BLOCK, (bottom - 1) // BLOCK + 1):
            up, low = max(top, r * BLOCK), min(bottom, (r + 1) * BLOCK)
            for c in range(left // BLOCK, (right - 1) // BLOCK + 1):
                west, east = max(left, c * BLOCK), min(right, (c + 1) * BLOCK)
                out[up - top : low - top, west - left : east - left] = self._block(
                    level, r, c
                )[up - r * BLOCK : low - r * BLOCK, west - c * BLOCK : east - c * BLOCK]
        return out

    @staticmethod
    def _touched(
        rows: NDArray[np.int64], cols: NDArray[np.int64]
    ) -> Iterator[tuple[int, int]]:
        for r in np.unique(rows // BLOCK):
            for c in np.unique(cols // BLOCK):
                yield int(r), int(c)

    def _block(self, level: int, row: int, col: int) -> NDArray[np.generic]:
        key = (self.source, level, row, col)
        known = self._cache.get(key)
        if known is not None:
            return known
        found = self._connection.execute(
            "SELECT body FROM raster_block WHERE source=? AND level=? AND row=? AND col=?",
            key,
        ).fetchone()
        try:
            block = self._decode(level, row, col, zstd.decompress(found[0]))
        except (TypeError, ValueError, zstd.ZstdError) as error:
            advice = "ingest the source again"
            raise InputError(self.source, "its copy is damaged", advice) from error
        self._cache.put(key, block)
        return block

    def _decode(self, level: int, row: int, col: int, raw: bytes) -> NDArray[np.generic]:
        height, width = level_shape(self.width, self.height, level)
        rows, cols = min(BLOCK, height - row * BLOCK), min(BLOCK, width - col * BLOCK)
        if len(raw) == rows * cols * 4:
            return np.frombuffer(raw, np.float32).reshape(rows, cols)
        return np.frombuffer(raw, np.uint8).reshape(rows, cols, 3)
