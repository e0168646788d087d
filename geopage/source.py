# SPDX-License-Identifier: Apache-2.0
"""Where a server gets a tile's bytes from, and how slow that may be made."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from geopage.settings import MIB, Throttle
from tiles import objects, terrain
from tiles.lanes import Lane
from tiles.objects import ObjectTile
from tiles.store import Store
from tiles.terrain import TerrainTile

Decode = Callable[[bytes], TerrainTile | ObjectTile]


DECODERS: dict[Lane, Decode] = {
    Lane.TERRAIN: terrain.decode,
    Lane.OBJECTS: objects.decode,
}
"""What makes tiles of stored bodies."""


class TileSource(Protocol):
    """Stored bodies, for one server. Thread: the one that reads."""

    def free_s(self, now_s: float) -> float:
        """Say from when on a tile may be asked for: sooner would only be a longer queue."""

    def ready_s(self, record: np.void, now_s: float) -> float:
        """Say when a tile, named by its INDEX record and asked for now, can be read."""

    def read(self, record: np.void) -> bytes:
        """Return the stored body; TileFault when it is not what was written."""

    def close(self) -> None:
        """Let go of files; the next read opens them again."""


class StoreSource:
    """Tiles of a lane from a store, which is opened by the thread that first reads."""

    def __init__(self, path: str | Path, lane: Lane) -> None:
        self._path = path
        self._lane = lane
        self._store: Store | None = None

    def free_s(self, now_s: float) -> float:
        """Return `now_s`: the disk is asked when it is read."""
        return now_s

    def ready_s(self, record: np.void, now_s: float) -> float:  # noqa: ARG002 (the protocol's)
        """Return `now_s`: nothing to wait for but the disk itself."""
        return now_s

    def read(self, record: np.void) -> bytes:
        """Return the checked body of a tile."""
        if self._store is None:
            self._store = Store(self._path)
        cell, row, check = int(record["cell"]), int(record["row"]), int(record["check"])
        return self._store.checked_body(self._lane, cell, row, check)

    def close(self) -> None:
        """Close the store."""
        if self._store is not None:
            self._store.close()
        self._store = None


class SizeSource:
    """Bodies of the right size without content, for paging that nobody draws."""

    def free_s(self, now_s: float) -> float:
        """Return `now_s`: there is nothing to wait for."""
        return now_s

    def ready_s(self, record: np.void, now_s: float) -> float:  # noqa: ARG002 (the protocol's)
        """Return `now_s`: there is nothing to wait for."""
        return now_s

    def read(self, record: np.void) -> bytes:
        """Return as many zeros as the stored body has bytes."""
        return bytes(int(record["tile_bytes"]))

    def close(self) -> None:
        """Do nothing: nothing is open."""


class Line:
    """A disk or a network line that all throttled sources share: one transfer at a time.

    What has been asked for comes through the line, even if nobody wants it any more. The
    latency of one request passes while the bytes of another come. Thread: any.
    """

    def __init__(self, throttle: Throttle) -> None:
        self.carried_bytes = 0
        """of all transfers that have been booked"""
        self._bytes_per_s = throttle.mib_per_s * MIB
        self._latency_s = throttle.latency_ms / 1000
        self.free_s = -np.inf
        """when the last byte of all that has been booked is on its way"""
        self._lock = threading.Lock()

    def arrives_s(self, size_bytes: int, now_s: float) -> float:
        """Book a transfer and return when its last byte arrives."""
        with self._lock:
            self.carried_bytes += size_bytes
            self.free_s = max(self.free_s, now_s) + size_bytes / self._bytes_per_s
            return float(self.free_s + self._latency_s)


class ThrottledSource:
    """Any source, behind a slow line. It says how long to wait; it does not wait."""

    def __init__(self, source: TileSource, line: Line) -> None:
        self._source = source
        self._line = line

    def free_s(self, now_s: float) -> float:
        """Return when the line has carried what it was asked for."""
        return max(self._line.free_s, self._source.free_s(now_s))

    def ready_s(self, record: np.void, now_s: float) -> float:
        """Return when the tile's stored bytes have come through the line."""
        arrives_s = self._line.arrives_s(int(record["tile_bytes"]), now_s)
        return max(arrives_s, self._source.ready_s(record, now_s))

    def read(self, record: np.void) -> bytes:
        """Return what the wrapped source returns."""
        return self._source.read(record)

    def close(self) -> None:
        """Close the wrapped source."""
        self._source.close()
