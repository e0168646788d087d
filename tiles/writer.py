# SPDX-License-Identifier: Apache-2.0
"""A world in one SQLite file: write side.

Tile rows are immutable and may be committed early: nobody sees them until
`replace_index` swaps the index blocks in one transaction. Rows that the new index no
longer names are kept for one generation, for readers that still hold the old index.
"""

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.codec import checksum
from tiles.index_tree import BLOCK_LEVELS
from tiles.lanes import Lane
from tiles.schema import APPLICATION_ID, FORMAT_VERSION, TABLES
from tiles.store import Store, require_store


class Writer(Store):
    """The one writer of a store. Thread: the one that made it."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        fresh = not self.path.exists()
        if not fresh:
            require_store(self.path)
        self.connection = sqlite3.connect(self.path, isolation_level=None, timeout=10)
        if fresh:
            self._make_tables()
        self.connection.execute("PRAGMA synchronous=NORMAL")

    def _make_tables(self) -> None:
        self.connection.executescript(
            f"PRAGMA page_size=8192; PRAGMA application_id={APPLICATION_ID};"
            f"PRAGMA user_version={FORMAT_VERSION}; PRAGMA journal_mode=WAL;"
            f"BEGIN; {TABLES} COMMIT; PRAGMA wal_checkpoint(TRUNCATE);"
        )

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit everything inside, or nothing."""
        self.connection.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self.connection.execute("ROLLBACK")
            raise
        self.connection.execute("COMMIT")

    def add_tiles(self, lane: Lane, tiles: Iterable[tuple[int, bytes]]) -> list[int]:
        """Insert (cell, body) pairs and return their rows; not visible to readers yet."""
        insert = "INSERT INTO tile(lane, cell, body) VALUES(?,?,?)"
        added = [
            self.connection.execute(insert, (int(lane), cell, body)) for cell, body in tiles
        ]
        return [int(cursor.lastrowid or 0) for cursor in added]

    def replace_index(self, lane: Lane, records: NDArray[np.void]) -> None:
        """Make `records`, (n,) INDEX, the lane's whole index; call inside a transaction."""
        run = self.connection.execute
        level = cells.level(records["cell"])
        roots = cells.ancestor(records["cell"], level - level % BLOCK_LEVELS)
        order = np.lexsort((records["cell"], roots))
        records, roots = records[order], roots[order]
        run("DELETE FROM index_block WHERE lane=?", (int(lane),))
        starts = np.flatnonzero(np.r_[True, roots[1:] != roots[:-1]][: len(roots)])
        blocks = np.split(records, starts[1:]) if len(starts) else []
        for block, start in zip(blocks, starts, strict=True):
            root, body = int(roots[start]), block.tobytes()
            row = (int(lane), root, body, checksum(lane, root, body))
            run("INSERT INTO index_block VALUES(?,?,?,?)", row)
        self._retire(lane, records["row"])

    def _retire(self, lane: Lane, named: NDArray[np.int32]) -> None:
        run = self.connection.execute
        generation = int(self.meta("generation")) + 1
        self.set_meta("generation", str(generation))
        run("CREATE TEMP TABLE IF NOT EXISTS named(row INTEGER PRIMARY KEY)")
        run("DELETE FROM named")
        rows = ((int(row),) for row in np.unique(named))
        self.connection.executemany("INSERT INTO named VALUES(?)", rows)
        run("DELETE FROM tile WHERE lane=? AND retired < ?", (int(lane), generation))
        run(
            "UPDATE tile SET retired=? WHERE lane=? AND retired IS NULL"
            " AND row NOT IN (SELECT row FROM named)",
            (generation, int(lane)),
        )

    def put_source(self, name: str, kind: str, details: Mapping[str, Any]) -> None:
        """Add a source, or replace the details of the one with this name."""
        self.connection.execute(
            "INSERT INTO source VALUES(?,?,(SELECT COALESCE(MAX(rank),0)+1 FROM source),?)"
            " ON CONFLICT(name) DO UPDATE SET kind=excluded.kind, details=excluded.details",
            (name, kind, json.dumps(details)),
        )

    def replace_sources(self, sources: Iterable[Mapping[str, Any]]) -> None:
        """Make these the store's sources; drop blocks and objects of all others."""
        wanted = {str(source["name"]): source for source in sources}
        for held in self.sources():
            if held["name"] not in wanted:
                self.drop_source(held["name"])
        for name, source in wanted.items():
            details = {key: source[key] for key in source if key not in {"name", "kind"}}
            self.put_source(name, source["kind"], details)
        keys = {str(source["blocks"]) for source in wanted.values() if "blocks" in source}
        ask = "SELECT DISTINCT source FROM raster_block"
        for (key,) in self.connection.execute(ask).fetchall():
            if key not in keys:
                self.connection.execute("DELETE FROM raster_block WHERE source=?", (key,))

    def drop_source(self, name: str) -> None:
        """Take a source and its objects out; index and raster blocks are the caller's."""
        self.connection.execute("DELETE FROM source WHERE name=?", (name,))
        self.connection.execute("DELETE FROM object WHERE source=?", (name,))

    def set_meta(self, key: str, value: str) -> None:
        """Set a value of the meta table."""
        self.connection.execute("INSERT OR REPLACE INTO meta VALUES(?,?)", (key, value))
