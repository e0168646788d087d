# SPDX-License-Identifier: Apache-2.0
"""A world in one SQLite file: read side.

Readers use autocommit statements, so they never pin the write-ahead log and fly on
while an ingest swaps index blocks. Thread: each thread opens its own `Store`.
"""

import json
import os
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.closing import Closing
from tiles.codec import checksum
from tiles.errors import InputError, ReadFault, TileFault
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.schema import APPLICATION_ID, FORMAT_VERSION

IDS_AT_ONCE = 500
"""SQLite takes at least 999 values in a statement."""


class Store(Closing):
    """Tiles, index blocks, sources and objects of one world, for one thread."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        require_file(self.path)
        # Where nothing can be written, SQLite can't share the file, nor need it.
        alone = not os.access(self.path.parent, os.W_OK) and not wal_bytes(self.path)
        mode = "immutable=1" if alone else "mode=ro"
        uri = f"file:{quote(str(self.path.absolute()))}?{mode}"
        self._connect(uri, uri=True)

    def _connect(self, name: str, **options: Any) -> None:
        """Open a file that must be a store.

        Raises
        ------
        InputError
        """
        self.connection = sqlite3.connect(name, isolation_level=None, **options)
        try:
            require_store(self.path, self.connection)
        except BaseException:
            self.connection.close()
            raise

    def index(self, lane: Lane) -> NDArray[np.void]:
        """Return all index records of a lane, (n,) INDEX, sorted by level then cell.

        Raises
        ------
        TileFault
            When an index block is not what was written.
        """
        rows = self.connection.execute(
            "SELECT root, body, checksum FROM index_block WHERE lane=? ORDER BY root",
            (int(lane),),
        ).fetchall()
        for root, body, check in rows:
            if checksum(lane, root, body) != check:
                raise TileFault(
                    lane.name, cells.text(root), "index block's checksum differs"
                )
        parts = [np.frombuffer(body, INDEX) for _, body, _ in rows]
        records = np.concatenate(parts) if parts else np.zeros(0, INDEX)
        return records[np.lexsort((records["cell"], cells.level(records["cell"])))]

    def body(self, row: int) -> bytes:
        """Return the stored body of a tile row, unchecked; empty when it is gone."""
        found = self.connection.execute(
            "SELECT body FROM tile WHERE row=?", (row,)
        ).fetchone()
        return bytes(found[0]) if found else b""

    def checked_body(self, lane: Lane, cell: int, row: int, check: int) -> bytes:
        """Return the body of a tile, as an index record names it.

        Raises
        ------
        ReadFault
            When it can't be read now: the file is busy, or the disk fails.
        TileFault
            When the tile is gone, or is not what was written.
        """
        try:
            body = self.body(row)
        except sqlite3.OperationalError as error:
            raise ReadFault(lane.name, cells.text(cell), str(error)) from error
        except sqlite3.DatabaseError as error:
            raise TileFault(lane.name, cells.text(cell), str(error)) from error
        if not body:
            raise TileFault(lane.name, cells.text(cell), "no such row")
        if checksum(lane, cell, body) != check:
            raise TileFault(lane.name, cells.text(cell), "checksum differs")
        return body

    def sources(self, kind: str | None = None) -> list[dict[str, Any]]:
        """Return the sources in order of first ingest: name, kind, and their details."""
        rows = self.connection.execute(
            "SELECT name, kind, details FROM source ORDER BY rank"
        )
        found = [
            {"name": name, "kind": k, **json.loads(details)} for name, k, details in rows
        ]
        return [source for source in found if kind in {None, source["kind"]}]

    def object_count(self) -> int:
        """Return the number of stored objects."""
        return int(self.connection.execute("SELECT COUNT(*) FROM object").fetchone()[0])

    def objects(self, ids: Sequence[int]) -> list[dict[str, Any]]:
        """Return objects of the object table with their attributes, in the given order."""
        names = ("id", "source", "lon_deg", "lat_deg", "base_m", "height_m", "dimension_m")
        found = {
            row[0]: dict(zip(names, row[:-1], strict=True))
            | {"attributes": json.loads(row[-1])}
            for row in self._by_id(", ".join((*names, "attributes")), ids)
        }
        return [found[one] for one in ids if one in found]

    def footprints(self, ids: Sequence[int]) -> list[tuple[int, bytes]]:
        """Return id and footprint, WKB in degrees, of objects of the object table."""
        return list(self._by_id("id, footprint", ids))

    def _by_id(self, columns: str, ids: Sequence[int]) -> Iterator[tuple[Any, ...]]:
        """Yield columns of some objects, each once, in no order."""
        for first in range(0, len(ids), IDS_AT_ONCE):
            some = list(ids[first : first + IDS_AT_ONCE])
            marks = ",".join("?" * len(some))
            ask = f"SELECT {columns} FROM object WHERE id IN ({marks})"
            yield from self.connection.execute(ask, some)

    def meta(self, key: str, default: str = "") -> str:
        """Return a value of the meta table."""
        found = self.connection.execute(
            "SELECT value FROM meta WHERE key=?", (key,)
        ).fetchone()
        return str(found[0]) if found else default

    def close(self) -> None:
        """Close the file."""
        self.connection.close()


def require_file(path: Path) -> None:
    """Check that there is a file.

    Raises
    ------
    InputError
    """
    if not path.is_file():
        reason = "is a folder" if path.is_dir() else "no such store"
        raise InputError(path, reason, "make a store with `geopage ingest terrain`")


def require_store(path: Path, connection: sqlite3.Connection) -> None:
    """Check that `path` is a whole store of a version that this code reads.

    Asked of SQLite: a process that opens and closes the file itself loses the locks of
    all its connections, and a writer elsewhere then takes their log away.

    Raises
    ------
    InputError
    """
    try:
        application, version, pages, page = (
            int(connection.execute(f"PRAGMA {name}").fetchone()[0])
            for name in ("application_id", "user_version", "page_count", "page_size")
        )
    except sqlite3.DatabaseError as error:
        raise _unreadable(path, error) from error
    if application != APPLICATION_ID:
        raise InputError(path, "not a geopage store", "name a .geopage file")
    if version > FORMAT_VERSION:
        raise InputError(path, f"store version {version} is newer", "update geopage")
    if version < FORMAT_VERSION:
        reason = f"store version {version} is older than {FORMAT_VERSION}"
        raise InputError(path, reason, "ingest its sources into a new store")
    # After a crash the missing pages may still be in the write-ahead log.
    if path.stat().st_size < pages * page and not wal_bytes(path):
        raise InputError(path, "truncated store", "copy it again or ingest again")


def _unreadable(path: Path, error: sqlite3.DatabaseError) -> Exception:
    """Say what is wrong with a file, or that another process is in the way."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_NOTADB:
        return InputError(path, "not a geopage store", "name a .geopage file")
    if code == sqlite3.SQLITE_CORRUPT:
        return InputError(path, "truncated store", "copy it again or ingest again")
    if code in {sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM}:
        return InputError(path, f"can't be read ({error})", "check its permissions")
    return error


def wal_bytes(path: Path) -> int:
    """Return the size of a store's write-ahead log, 0 where there is none."""
    log = Path(f"{path}-wal")
    return log.stat().st_size if log.exists() else 0
