# SPDX-License-Identifier: Apache-2.0
"""`geopage check` reports every change of what was written."""

import json
from pathlib import Path

import numpy as np
import pytest

from geopage.cli import main
from tiles import cells, geodesy
from tiles.check import faults_of, warnings_of
from tiles.codec import checksum
from tiles.frames import Ecef
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import VERTEX, Mesh
from tiles.objects import OBJECT, PROXY, ObjectTile, encode
from tiles.store import Store
from tiles.writer import Writer


@pytest.fixture
def store(nested_folder: Path, tmp_path: Path) -> Path:
    path = tmp_path / "world.geopage"
    path.write_bytes((nested_folder / "world.geopage").read_bytes())
    return path


def faults(path: Path) -> list[str]:
    with Store(path) as opened:
        return list(faults_of(opened))


def run(path: Path, statement: str, *values: object) -> None:
    with Writer(path) as writer:
        assert writer.connection.execute(statement, values).rowcount > 0


def test_a_whole_store_has_no_faults(store: Path) -> None:
    assert faults(store) == []


def test_every_single_changed_byte_of_a_tile_is_reported(
    store: Path, rng: np.random.Generator
) -> None:
    with Writer(store) as writer:
        get, put = "SELECT body FROM tile WHERE row=?", "UPDATE tile SET body=? WHERE row=?"
        index = writer.index(Lane.TERRAIN)
        forest_rows = index["row"]
        for flip in range(200):
            k = int(rng.integers(len(forest_rows)))
            row = int(forest_rows[k])
            body = writer.connection.execute(get, (row,)).fetchone()[0]
            at = int(rng.integers(len(body))) if flip > 20 else flip % 2 * (len(body) - 1)
            changed = bytearray(body)
            changed[at] ^= int(rng.integers(1, 256))
            writer.connection.execute(put, (bytes(changed), row))
            found = list(faults_of(writer)) if flip % 20 == 0 else None
            name = cells.text(int(index["cell"][k]))
            if found is None:
                key = int(index["cell"][k]), row, int(index["check"][k])
                with pytest.raises(Exception, match="checksum differs"):
                    writer.checked_body(Lane.TERRAIN, *key)
            else:
                assert found == [f"TERRAIN tile {name}: checksum differs"]
            writer.connection.execute(put, (body, row))
    assert faults(store) == []


def test_every_changed_byte_of_an_index_block_is_reported(
    store: Path, rng: np.random.Generator
) -> None:
    with Writer(store) as writer:
        rows = writer.connection.execute("SELECT root, body FROM index_block").fetchall()
        put = "UPDATE index_block SET body=? WHERE root=?"
        for _ in range(60):
            root, body = rows[int(rng.integers(len(rows)))]
            changed = bytearray(body)
            changed[int(rng.integers(len(body)))] ^= int(rng.integers(1, 256))
            writer.connection.execute(put, (bytes(changed), root))
            assert any("checksum differs" in line for line in faults_of(writer))
            writer.connection.execute(put, (body, root))
    assert faults(store) == []


def test_a_missing_tile_is_reported(store: Path) -> None:
    run(store, "DELETE FROM tile WHERE row=5")
    assert [line.split(": ")[1] for line in faults(store)] == ["no such row"]


def test_swapped_tiles_are_reported(store: Path) -> None:
    run(store, "UPDATE tile SET row=-1 WHERE row=4")
    run(store, "UPDATE tile SET row=4 WHERE row=5")
    run(store, "UPDATE tile SET row=5 WHERE row=-1")
    assert len(faults(store)) == 2


def test_an_index_that_contradicts_itself_is_reported(store: Path) -> None:
    """Rewritten with right checksums: what was written can be wrong as well."""

    def broken(change: str) -> list[str]:
        path = store.with_name(f"{change}.geopage")
        path.write_bytes(store.read_bytes())
        with Writer(path) as writer:
            records = writer.index(Lane.TERRAIN).copy()
            level = cells.level(records["cell"])
            deepest = int(np.argmax(level))
            if change == "orphan":
                records = np.delete(records, np.flatnonzero(level == level[deepest] - 1))
            elif change == "zone":
                records = np.delete(records, 0)
            elif change == "error":
                records["error_m"][deepest] = 1e9
            elif change == "children":
                records["children"][deepest] = 1
            with writer.transaction():
                writer.replace_index(Lane.TERRAIN, records.astype(INDEX))
        return faults(path)

    assert any("has no parent" in line for line in broken("orphan"))
    assert any("does not cover all zones" in line for line in broken("zone"))
    assert any("larger error than its parent" in line for line in broken("error"))
    assert any("names children" in line for line in broken("children"))


def test_a_damaged_copy_of_a_source_is_reported(store: Path) -> None:
    with Writer(store) as writer:
        first = "level=0 AND row=0 AND col=0"
        get = f"SELECT source, body FROM raster_block WHERE {first}"
        name, body = writer.connection.execute(get).fetchone()
        changed = bytearray(body)
        changed[len(body) // 2] ^= 255
        put = f"UPDATE raster_block SET body=? WHERE source=? AND {first}"
        writer.connection.execute(put, (bytes(changed), name))
    assert any(line.startswith(f"copy of {name}") for line in faults(store))


def test_objects_in_no_tile_and_in_several_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "town.geopage"
    corners = np.zeros(3, VERTEX)
    mesh = Mesh(Ecef(np.zeros(3)), 1.0, corners, np.arange(3, dtype="<u2"))
    things = np.zeros(2, OBJECT)
    things["id"] = (1, 3)
    roots = [int(cells.make(zone, 0, 0, 0)) for zone in (4, 9)]
    with Writer(path) as writer, writer.transaction():
        bodies = [encode(ObjectTile(c, mesh, things, np.zeros(0, PROXY))) for c in roots]
        records = np.zeros(2, INDEX)
        records["cell"] = roots
        pairs = list(zip(roots, bodies, strict=True))
        records["row"] = writer.add_tiles(Lane.OBJECTS, pairs)
        records["check"] = [checksum(Lane.OBJECTS, *pair) for pair in pairs]
        writer.replace_index(Lane.OBJECTS, records)
        for one in (1, 2):
            row = (one, "s", 1, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, b"", None, "{}")
            marks = ",".join("?" * len(row))
            writer.connection.execute(f"INSERT INTO object VALUES({marks})", row)
    assert set(faults(path)) == {
        "object 2 is in no tile",
        "object 1 is in several tiles",
        "object 3 is in several tiles",
        "object 3 is in a tile but not in the object table",
    }


def test_damage_to_the_file_itself_ends_in_exit_code_1_and_a_list(
    store: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = bytearray(store.read_bytes())
    for at in rng.integers(8192, len(raw), 4000):
        raw[at] ^= 0x5A
    store.write_bytes(bytes(raw))
    assert main(["check", str(store)]) == 1
    out, err = capsys.readouterr()
    assert "faults" in out
    assert err == ""


def test_the_command_says_so(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(store)]) == 0
    assert "sound" in capsys.readouterr().out
    run(store, "DELETE FROM tile WHERE row=5")
    assert main(["check", str(store), "--json"]) == 1
    assert '"ok": false' in capsys.readouterr().out


def test_an_inner_cell_beyond_its_bound_is_a_warning_and_no_fault(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Writer(store) as writer:
        assert list(warnings_of(writer)) == []
        index = writer.index(Lane.TERRAIN)
        inner = np.flatnonzero(index["children"])
        worst = inner[cells.level(index["cell"][inner]).argmin()]
        edge_m = float(geodesy.cell_edge_m(index["cell"][worst]))
        index["error_m"][worst] = 1.5 * edge_m / 256
        writer.replace_index(Lane.TERRAIN, index)
    assert main(["check", str(store)]) == 0
    out = capsys.readouterr().out
    assert f"1 of {len(inner)} inner cells" in out
    assert "1.50 times" in out
    assert main(["check", str(store), "--json"]) == 0
    assert "1.50 times" in json.loads(capsys.readouterr().out)["warnings"][0]
