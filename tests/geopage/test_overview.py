# SPDX-License-Identifier: Apache-2.0
"""What a store holds, in numbers and in words."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest

from geopage.overview import SAMPLE, overview, overview_lines
from tests.geopage.worlds import deep_globe, object_records, write_store
from tiles import cells, terrain
from tiles.geodesy import cell_edge_m
from tiles.lanes import Lane
from tiles.store import Store
from tiles.writer import Writer


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "world.geopage"
    write_store(path, deep_globe(), object_records())
    with Writer(path) as writer:
        details = {"path": "dem.tif", "datum": "egm96", "spacing_m": 30.0, "secret": 1}
        writer.put_source("alps", "terrain", details)
    return path


def test_numbers_are_those_of_the_index(path: Path) -> None:
    with Store(path) as store:
        found = overview(store)
    land = deep_globe()
    rows = found["lanes"]["terrain"]
    assert [row["level"] for row in rows] == sorted({*cells.level(land["cell"]).tolist()})
    assert sum(row["cells"] for row in rows) == len(land)
    assert found["sources"] == [
        {
            "name": "alps",
            "kind": "terrain",
            "path": "dem.tif",
            "datum": "egm96",
            "spacing_m": 30,
        }
    ]


def test_triangles_and_bounds_are_those_of_the_tiles(path: Path) -> None:
    """Oracle: every tile unpacked."""
    with Store(path) as store:
        rows = overview(store)["lanes"]["terrain"]
        records = store.index(Lane.TERRAIN)
        counts = np.array(
            [
                terrain.decode(store.body(int(row))).surface_index_count // 3
                for row in records["row"]
            ]
        )
    level = cells.level(records["cell"])
    for row in rows:
        here = level == row["level"]
        assert row["triangles"] == counts[here].sum() > 0
        assert row["tiles"] == here.sum()
        assert row["tiles_read"] == min(row["tiles"], SAMPLE)
        bound_m = cell_edge_m(records["cell"][here]) / 256
        assert row["bound_m"] == pytest.approx(np.median(bound_m))
        assert row["over_bound"] == (records["error_m"][here] > bound_m * 1.000001).sum()


def test_of_many_tiles_a_part_is_read(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Store(path) as store:
        exact = overview(store)["lanes"]["terrain"]
        monkeypatch.setattr("geopage.overview.SAMPLE", 10)
        rows = overview(store)["lanes"]["terrain"]
        lines = overview_lines(overview(store))
    many = [row for row in rows if row["tiles"] > 10]
    assert many
    assert all(row["tiles_read"] == 10 for row in many)
    # The tiles of this world are alike.
    assert [r["triangles"] for r in rows] == [r["triangles"] for r in exact]
    assert any(f"~{many[0]['triangles']} " in line for line in lines)


def test_a_damaged_tile_does_not_keep_the_rest_from_being_told(path: Path) -> None:
    with Store(path) as store:
        row = int(store.index(Lane.TERRAIN)["row"][0])
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE tile SET body=x'00' WHERE row=?", (row,))
    connection.close()
    with Store(path) as store:
        first = overview(store)["lanes"]["terrain"][0]
    assert first["tiles_read"] == first["tiles"] - 1


def test_lines_name_sources_and_levels(path: Path) -> None:
    with Store(path) as store:
        lines = overview_lines(overview(store))
    assert str(path) in lines[0]
    assert any("alps: 30.0 m, datum egm96" in line for line in lines)
    assert sum(line.startswith(("terrain", "objects")) for line in lines) == 2


def test_a_line_says_what_a_source_meets_over_which_distance(path: Path) -> None:
    with Writer(path) as writer:
        met = {"spacing_m": 10.0, "reach_m": 18553.2, "meets": "earth"}
        writer.put_source("city", "terrain", met)
        writer.put_source("bare", "terrain", {**met, "meets": ""})
    with Store(path) as store:
        text = "\n".join(overview_lines(overview(store)))
    assert "city: 10.0 m, meets earth over 18.6 km" in text
    assert "bare: 10.0 m, meets sea level over 18.6 km" in text


def test_an_empty_store_has_an_overview(tmp_path: Path) -> None:
    Writer(tmp_path / "empty.geopage").close()
    with Store(tmp_path / "empty.geopage") as store:
        found = overview(store)
    assert found["objects"] == 0
    assert found["lanes"] == {"terrain": [], "objects": []}
    assert len(overview_lines(found)) == 1
