# SPDX-License-Identifier: Apache-2.0
"""What the servers of a pager read from, and how they run by a virtual clock."""

from collections.abc import Callable, Iterable, Mapping, MutableSequence
from dataclasses import dataclass
from pathlib import Path

from geopage.priority_queue import PriorityQueue
from geopage.residency import Residency
from geopage.server import TileServer
from geopage.source import (
    DECODERS,
    Line,
    SizeSource,
    StoreSource,
    ThrottledSource,
    TileSource,
)
from tiles.forest import Forest
from tiles.lanes import Lane


@dataclass(frozen=True, slots=True)
class Supply:
    """Where tiles come from."""

    path: Path
    line: Line | None
    """that all reads share; None: nothing but the disk"""
    dry: bool
    """Read nothing: bodies are as long as the index says, and there is nothing in them."""

    def source(self, lane: Lane) -> TileSource:
        """Return what one lane's server reads from."""
        source: TileSource = SizeSource() if self.dry else StoreSource(self.path, lane)
        return ThrottledSource(source, self.line) if self.line else source

    def decode(self, lane: Lane) -> Callable[[bytes], object]:
        """Return what makes one lane's tiles."""
        return (lambda body: body) if self.dry else DECODERS[lane]


def servers_of(
    supply: Supply,
    forests: Mapping[Lane, Forest],
    queue: PriorityQueue,
    residency: Residency,
    faults: MutableSequence[str],
) -> dict[Lane, TileServer]:
    """Return a server for each lane; see `TileServer`."""
    return {
        lane: TileServer(
            lane,
            forests[lane].records,
            supply.source(lane),
            supply.decode(lane),
            queue,
            residency,
            faults,
        )
        for lane in Lane
    }


def serve_until(servers: Iterable[TileServer], now_s: float, end_s: float) -> None:
    """Do by a virtual clock what the servers' threads would do until `end_s`.

    Reading and decoding take no time by that clock; waiting for a throttled line does.
    """
    servers = list(servers)
    while now_s <= end_s:
        waits = [wait_s for one in servers if (wait_s := one.step(now_s)) is not None]
        if not waits:
            return
        now_s += min(waits)
