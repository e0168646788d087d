# SPDX-License-Identifier: Apache-2.0
"""What an unfinished ingest has done, so that the same command goes on where it was.

Notes stand in the store, each in the transaction that wrote what it tells of. They hold
for one generation: a swap of whatever index forgets them all, and what nobody came back
for goes with them.
"""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tiles.errors import InputError
from tiles.writer import Writer


class Journal:
    """The notes of a store at one generation."""

    def __init__(self, writer: Writer, generation: int | None = None) -> None:
        self.writer = writer
        now = int(writer.meta("generation"))
        self.generation = now if generation is None else generation

    def require(self) -> None:
        """Refuse to go on when another command changed the store in the meantime.

        Raises
        ------
        InputError
        """
        path = self.writer.path
        if not path.exists():
            raise InputError(path, "taken away meanwhile", "run this command again")
        if int(self.writer.meta("generation")) != self.generation:
            raise InputError(path, "another command changed it", "run this one again")

    @contextmanager
    def undisturbed(self) -> Iterator[None]:
        """Blame another command that came between for what went wrong inside."""
        try:
            yield
        except InputError:
            self.require()
            raise

    @contextmanager
    def step(self) -> Iterator[None]:
        """Commit everything inside, or nothing; `require` that nobody came between."""
        with self.writer.transaction():
            self.require()
            yield
        self.writer.trim_log()

    def said(self, key: str) -> dict[str, Any] | None:
        """Return what was noted under a key."""
        found = self.writer.noted(key).get("")
        said: dict[str, Any] | None = json.loads(found) if found else None
        return said

    def say(self, key: str, what: dict[str, Any], blocks: str | None = None) -> None:
        """Note something under a key; inside a step."""
        self.writer.note(key, json.dumps(what).encode(), blocks)


def digest(*what: object) -> str:
    """Return a short name for something that JSON can hold, equal only for the same."""
    text = json.dumps(what, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def stamp(paths: list[str]) -> str:
    """Return a name for files as they are now: paths, sizes and times of change."""
    there = [Path(path) for path in paths]
    stats = [(str(path.resolve()), path.stat()) for path in there if path.exists()]
    return digest([(path, one.st_size, one.st_mtime_ns) for path, one in stats])


def made_by(*folders: Path) -> str:
    """Return a name for the code in folders: another code may make other tiles."""
    whole = hashlib.sha256()
    for path in sorted(one for folder in folders for one in folder.glob("*.py")):
        whole.update(path.read_bytes())
    return whole.hexdigest()[:24]
