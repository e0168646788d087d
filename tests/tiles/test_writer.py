# SPDX-License-Identifier: Apache-2.0
"""Writing a store: all or nothing, and readers fly on."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tiles import cells
from tiles.codec import checksum
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.store import Store, wal_bytes
from tiles.writer import Writer

ROOTS = [int(cells.make(zone, 0, 0, 0)) for zone in range(4)]


def swap(writer: Writer, text: str, lane: Lane = Lane.TERRAIN) -> None:
    """Give every cell a new tile."""
    bodies = [f"{text}{cell}".encode() for cell in ROOTS]
    records: NDArray[np.void] = np.zeros(len(ROOTS), INDEX)
    records["cell"] = ROOTS
    pairs = list(zip(ROOTS, bodies, strict=True))
    records["row"] = writer.add_tiles(lane, pairs)
    records["check"] = [checksum(lane, *pair) for pair in pairs]
    writer.replace_index(lane, records)


def read_all(store: Store, records: NDArray[np.void]) -> list[str]:
    keys = ((int(r["cell"]), int(r["row"]), int(r["check"])) for r in records)
    return [store.checked_body(Lane.TERRAIN, *key).decode() for key in keys]


def bodies(text: str) -> list[str]:
    return [f"{text}{cell}" for cell in ROOTS]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "world.geopage"
    with Writer(path) as writer, writer.transaction():
        swap(writer, "first")
    return path


def half_done(writer: Writer) -> None:
    with writer.transaction():
        swap(writer, "second")
        writer.put_source("s", "terrain", {})
        raise KeyboardInterrupt


def test_a_failed_transaction_changes_nothing(path: Path) -> None:
    before = path.read_bytes()
    with Writer(path) as writer:
        with pytest.raises(KeyboardInterrupt):
            half_done(writer)
        assert read_all(writer, writer.index(Lane.TERRAIN)) == bodies("first")
        assert writer.sources() == []
    assert path.read_bytes() == before


def test_readers_see_nothing_of_an_open_transaction(path: Path) -> None:
    with Writer(path) as writer, Store(path) as reader:
        with writer.transaction():
            swap(writer, "second")
            assert read_all(reader, reader.index(Lane.TERRAIN)) == bodies("first")
        assert read_all(reader, reader.index(Lane.TERRAIN)) == bodies("second")


def test_a_reader_of_the_old_index_flies_on_for_one_generation(path: Path) -> None:
    with Writer(path) as writer, Store(path) as reader:
        held = reader.index(Lane.TERRAIN)
        with writer.transaction():
            swap(writer, "second")
        assert read_all(reader, held) == bodies("first")
        with writer.transaction():
            swap(writer, "third")
        with pytest.raises(Exception, match="no such row"):
            read_all(reader, held)
        assert read_all(reader, reader.index(Lane.TERRAIN)) == bodies("third")


def test_swapping_one_lane_leaves_the_other(path: Path) -> None:
    with Writer(path) as writer:
        for text in "abc":
            with writer.transaction():
                swap(writer, text, Lane.OBJECTS)
        assert read_all(writer, writer.index(Lane.TERRAIN)) == bodies("first")


def test_a_store_does_not_grow_with_swaps(path: Path) -> None:
    with Writer(path) as writer:
        for text in "abcdefgh":
            with writer.transaction():
                swap(writer, text)
        count = writer.connection.execute("SELECT COUNT(*) FROM tile").fetchone()[0]
    assert count == 2 * len(ROOTS)  # the newest and the generation before


def test_index_blocks_hold_at_most_eight_levels(path: Path) -> None:
    chain = [int(cells.cell_at(0.3, 0.4, level)) for level in range(20)]
    records = np.zeros(20, INDEX)
    records["cell"] = chain
    with Writer(path) as writer:
        with writer.transaction():
            writer.replace_index(Lane.OBJECTS, records[::-1])
        blocks = writer.connection.execute(
            "SELECT root, body FROM index_block WHERE lane=1"
        ).fetchall()
        assert sorted(int(cells.level(root)) for root, _ in blocks) == [0, 8, 16]
        for root, body in blocks:
            held = np.frombuffer(body, INDEX)["cell"]
            assert np.ptp(cells.level(held)) < 8
            assert cells.contains(root, held).all()
            assert (np.diff(held) > 0).all()
        np.testing.assert_array_equal(writer.index(Lane.OBJECTS)["cell"], chain)


def test_sources_keep_their_order_and_take_their_blocks_along(path: Path) -> None:
    with Writer(path) as writer:
        writer.put_source("b", "terrain", {"blocks": "b@1"})
        writer.put_source("a", "imagery", {"blocks": "a@1"})
        writer.put_source("b", "terrain", {"blocks": "b@2"})
        assert [s["name"] for s in writer.sources()] == ["b", "a"]
        assert [s["name"] for s in writer.sources("imagery")] == ["a"]
        for key in ("a@1", "b@1", "b@2", "lost@1"):
            row = (key, 0, 0, 0, b"x")
            writer.connection.execute("INSERT INTO raster_block VALUES(?,?,?,?,?)", row)
        writer.replace_sources([s for s in writer.sources() if s["name"] == "b"])
        held = writer.connection.execute("SELECT source FROM raster_block").fetchall()
        assert held == [("b@2",)]
        assert [s["name"] for s in writer.sources()] == ["b"]


def note_all(writer: Writer) -> list[int]:
    """Write two tiles and a copy that nobody names, and note them."""
    with writer.transaction():
        rows = writer.add_tiles(Lane.TERRAIN, [(ROOTS[0], b"x"), (ROOTS[1], b"y")])
        writer.note("part a 1", b"first", rows=rows)
        row = ("new@1", 0, 0, 0, b"x")
        writer.connection.execute("INSERT INTO raster_block VALUES(?,?,?,?,?)", row)
        writer.note("copy a", b"second", blocks="new@1")
    return rows


def test_notes_are_found_by_how_they_begin(path: Path) -> None:
    with Writer(path) as writer:
        note_all(writer)
    with Writer(path) as writer:
        assert writer.noted("part a ") == {"1": b"first"}
        assert writer.noted("copy a") == {"": b"second"}
        assert writer.noted("part _ ") == {}


@pytest.mark.parametrize("lane", list(Lane))
def test_a_swap_takes_away_what_was_noted_and_is_not_named(path: Path, lane: Lane) -> None:
    with Writer(path) as writer:
        rows = note_all(writer)
        with writer.transaction():
            swap(writer, "second", lane)
        ask = writer.connection.execute
        assert not {row for (row,) in ask("SELECT row FROM tile")} & set(rows)
        assert ask("SELECT COUNT(*) FROM raster_block").fetchone() == (0,)
        assert writer.noted("") == {}
        with writer.transaction():
            swap(writer, "third", lane)
        held = read_all(writer, writer.index(Lane.TERRAIN))
        assert held == bodies("third" if lane is Lane.TERRAIN else "first")


def test_a_swap_keeps_what_was_noted_and_is_named_now(path: Path) -> None:
    with Writer(path) as writer:
        first, second = note_all(writer)
        records: NDArray[np.void] = np.zeros(1, INDEX)
        records["cell"], records["row"] = ROOTS[0], first
        with writer.transaction():
            writer.replace_sources([{"name": "s", "kind": "terrain", "blocks": "new@1"}])
            writer.replace_index(Lane.TERRAIN, records)
        assert (writer.body(first), writer.body(second)) == (b"x", b"")
        count = writer.connection.execute("SELECT COUNT(*) FROM raster_block").fetchone()
        assert count == (1,)
        for _ in range(2):
            with writer.transaction():
                writer.replace_index(Lane.TERRAIN, records)
        assert writer.body(first) == b"x"


def test_retiring_tiles_does_not_write_them_again(path: Path) -> None:
    """The log holds the swap, not the bodies of what goes."""
    with Writer(path) as writer:
        records: NDArray[np.void] = np.zeros(0, INDEX)
        with writer.transaction():
            many = ((cell, bytes(50_000)) for cell in range(100))
            writer.add_tiles(Lane.TERRAIN, many)
        writer.connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        for _ in range(2):
            with writer.transaction():
                writer.replace_index(Lane.TERRAIN, records)
        assert Path(f"{path}-wal").stat().st_size < 1_000_000
        assert writer.connection.execute("SELECT COUNT(*) FROM tile").fetchone() == (0,)


def test_the_log_is_emptied_as_soon_as_readers_let_it(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tiles.writer.LOG_BYTES", 1_000_000)
    monkeypatch.setattr("tiles.writer.TRIM_MS", 1)

    def write(writer: Writer) -> int:
        with writer.transaction():
            writer.add_tiles(Lane.TERRAIN, [(1, bytes(100_000))])
        writer.trim_log()
        return wal_bytes(path)

    with Writer(path) as writer, Store(path) as reader:
        read = reader.connection.execute("SELECT row FROM tile")
        assert write(writer) < write(writer)
        held = [write(writer) for _ in range(25)]
        assert held == sorted(held)  # what it reads must stay
        assert held[-1] > 2_000_000
        read.close()
        assert min(write(writer) for _ in range(25)) < 1_000_000
        busy_ms = writer.connection.execute("PRAGMA busy_timeout").fetchone()[0]
        assert busy_ms == 10_000


def test_a_store_that_can_not_be_made_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "world.geopage"
    with pytest.raises(sqlite3.OperationalError):
        Writer(tmp_path / "none" / "world.geopage")
    Writer(folder).close()
    assert [one.name for one in tmp_path.iterdir()] == ["world.geopage"]
