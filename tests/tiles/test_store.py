# SPDX-License-Identifier: Apache-2.0
"""Reading a store: what is no whole store of this version is refused in one line."""

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tiles.errors import InputError, TileFault
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.store import Store
from tiles.writer import Writer


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A small store with one tile."""
    path = tmp_path / "a b#c%20.geopage"
    with Writer(path) as writer, writer.transaction():
        writer.add_tiles(Lane.TERRAIN, [(1, bytes(200_000))])
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as found:
        Store(path)
    message = str(found.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert ";" in message  # reason; advice
    return message


def test_any_file_name_will_do(path: Path) -> None:
    with Store(path) as store:
        assert store.body(1) == bytes(200_000)
        assert store.body(2) == b""


def test_what_is_no_store_is_refused(tmp_path: Path) -> None:
    assert "no such store" in refusal(tmp_path / "missing.geopage")
    assert "is a folder" in refusal(tmp_path)
    for name, content in (
        ("empty", b""),
        ("text", b"hello" * 100),
        ("short", b"SQLite format 3\0"),
        ("other", b"SQLite format 3\0" + bytes(2000)),
    ):
        file = tmp_path / name
        file.write_bytes(content)
        assert "not a geopage store" in refusal(file)


@pytest.mark.parametrize(
    ("version", "said"), [(1, "version 1 is older"), (99, "version 99 is newer")]
)
def test_another_version_is_refused(path: Path, version: int, said: str) -> None:
    raw = bytearray(path.read_bytes())
    raw[60:64] = struct.pack(">I", version)
    path.write_bytes(bytes(raw))
    assert said in refusal(path)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_truncated_store_is_refused(path: Path, share: float) -> None:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    assert "truncated store" in refusal(path)


def test_a_store_whose_pages_are_still_in_its_log_is_whole(tmp_path: Path) -> None:
    """Killed in mid-checkpoint: the file is short, the log has what it lacks."""
    path, copy = tmp_path / "a.geopage", tmp_path / "b.geopage"
    with Writer(path) as writer:
        before = path.read_bytes()
        writer.connection.execute("PRAGMA wal_autocheckpoint=0")
        with writer.transaction():
            writer.add_tiles(Lane.TERRAIN, [(1, bytes(300_000))])
        log = Path(f"{path}-wal").read_bytes()
        copy.write_bytes(before[:28] + struct.pack(">I", 10**6) + before[32:])
        Path(f"{copy}-wal").write_bytes(log)
        with Store(copy) as store:
            assert store.body(1) == bytes(300_000)


OTHER = """
import sys
from tiles.writer import Writer
with Writer(sys.argv[1]) as writer, writer.transaction():
    writer.set_meta("generation", sys.argv[2])
"""


def test_a_reader_beside_another_sees_what_other_processes_write(path: Path) -> None:
    """Opening a store a second time must not take the first one's locks."""
    with Store(path) as first, Store(path) as second:
        for generation in ("5", "6"):
            words = [sys.executable, "-c", OTHER, str(path), generation]
            subprocess.run(words, cwd=Path(__file__).parents[2], check=True)
            assert first.meta("generation") == second.meta("generation") == generation


def test_a_changed_index_block_is_a_fault(path: Path) -> None:
    with Writer(path) as writer:
        record = np.zeros(1, INDEX)
        record["cell"] = 1
        with writer.transaction():
            writer.replace_index(Lane.TERRAIN, record)
        writer.connection.execute("UPDATE index_block SET checksum = checksum + 1")
        with pytest.raises(TileFault, match="checksum"):
            writer.index(Lane.TERRAIN)
        assert len(writer.index(Lane.OBJECTS)) == 0


def test_a_store_on_a_read_only_medium_can_be_read(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tiles.store.os.access", lambda folder, mode: False)
    with Store(path) as store:
        assert len(store.body(1)) == 200_000
    assert [p.name for p in path.parent.iterdir()] == [path.name]
