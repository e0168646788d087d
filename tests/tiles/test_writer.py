# SPDX-License-Identifier: Apache-2.0
"""Writing a store: all or nothing, and readers fly on."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tiles import cells
from tiles.codec import checksum
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.store import Store
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
