# SPDX-License-Identifier: Apache-2.0
"""A world in one SQLite file: write side.

Tile rows are immutable and may be committed early: nobody sees them until
`replace_index` swaps the index blocks in one transaction. Rows that the new index no
longer names are kept for one generation, for readers that still hold the old index.
What an ingest has done so far is noted beside what it wrote, so that it can go on after
it was killed; the next swap of whatever index takes away what nobody came back for.
"""

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.codec import checksum
from tiles.index_tree import BLOCK_LEVELS
from tiles.lanes import Lane
from tiles.schema import APPLICATION_ID, FORMAT_VERSION, TABLES
from tiles.store import Store, require_file, wal_bytes

BUSY_S, TRIM_MS = 10, 500
"""How long to wait for another writer, and for readers of the log"""
LOG_BYTES = 32 << 20
"""A longer write-ahead log is emptied."""


class Writer(Store):
    """The one writer of a store. Thread: the one that made it."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.made_here = not self.path.exists() and make_store(self.path)
        require_file(self.path)
        self._connect(str(self.path), timeout=BUSY_S)
        self._longest_log_bytes = LOG_BYTES
        self.connection.execute("PRAGMA synchronous=NORMAL")
        # Where SQLite is built to, it would overwrite all that is deleted with zeros.
        self.connection.execute("PRAGMA secure_delete=OFF")

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

    def trim_log(self) -> None:
        """Empty the write-ahead log once it is long; outside a transaction.

        SQLite does so by itself, but not while some reader is always reading.
        """
        if wal_bytes(self.path) > self._longest_log_bytes:
            run = self.connection.execute
            run(f"PRAGMA busy_timeout={TRIM_MS}")
            held = run("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
            run(f"PRAGMA busy_timeout={1000 * BUSY_S}")
            # Not again at once where a reader held it up.
            more = wal_bytes(self.path) if held else 0
            self._longest_log_bytes = more + LOG_BYTES

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
        self._forget_unfinished()
        old = "FROM retired WHERE lane=? AND generation < ?"
        run(f"DELETE FROM tile WHERE row IN (SELECT row {old})", (int(lane), generation))
        run(f"DELETE {old}", (int(lane), generation))
        # In a table of its own: an UPDATE would write every retired body again.
        run(
            "INSERT INTO retired SELECT row, lane, ? FROM tile WHERE lane=?"
            " AND row NOT IN (SELECT row FROM named)"
            " AND row NOT IN (SELECT row FROM retired)",
            (generation, int(lane)),
        )

    def _forget_unfinished(self) -> None:
        """Drop the notes, and what was written for them unless it is named by now."""
        run = self.connection.execute
        kept = {source.get("blocks") for source in self.sources()}
        ask = "SELECT blocks, first_row, last_row FROM unfinished"
        for blocks, first, last in run(ask).fetchall():
            if blocks is not None and blocks not in kept:
                run("DELETE FROM raster_block WHERE source=?", (blocks,))
            lost = "row BETWEEN ? AND ? AND row NOT IN (SELECT row FROM named)"
            run(f"DELETE FROM tile WHERE {lost}", (first, last))
        run("DELETE FROM unfinished")

    def note(
        self, key: str, body: bytes, blocks: str | None = None, rows: Sequence[int] = ()
    ) -> None:
        """Note what an unfinished ingest has done; call in the transaction that does it.

        Parameters
        ----------
        blocks : key of raster blocks that were written and that no source names yet
        rows : consecutive rows of tiles that were written and that no index names yet
        """
        ends = (rows[0], rows[-1]) if rows else (None, None)
        self.connection.execute(
            "INSERT OR REPLACE INTO unfinished VALUES(?,?,?,?,?)",
            (key, body, blocks, *ends),
        )

    def noted(self, start: str) -> dict[str, bytes]:
        """Return the notes whose keys begin with `start`, by the rest of the key."""
        found = self.connection.execute(
            "SELECT key, body FROM unfinished WHERE substr(key, 1, ?) = ?",
            (len(start), start),
        )
        return {key[len(start) :]: bytes(body) for key, body in found.fetchall()}

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


def make_store(path: Path) -> bool:
    """Make an empty store; whenever this is killed, there is a whole one or none.

    Returns
    -------
    Whether it is the one; another command's may have come before.
    """
    new = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with closing(sqlite3.connect(new, isolation_level=None)) as connection:
            connection.executescript(
                f"PRAGMA page_size=8192; PRAGMA application_id={APPLICATION_ID};"
                f"PRAGMA user_version={FORMAT_VERSION}; PRAGMA journal_mode=WAL;"
                f"BEGIN; {TABLES} COMMIT;"
            )
        try:
            path.hardlink_to(new)
        except FileExistsError:
            return False
        except OSError:  # a file system without links
            new.rename(path)
        return True
    finally:
        for tail in ("", "-wal", "-shm"):
            Path(f"{new}{tail}").unlink(missing_ok=True)
