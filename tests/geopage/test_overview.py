# SPDX-License-Identifier: Apache-2.0
"""What a store holds, in numbers and in words."""

from pathlib import Path

import pytest

from geopage.overview import overview, overview_lines
from tests.geopage.worlds import deep_globe, object_records, write_store
from tiles import cells
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


def test_lines_name_sources_and_levels(path: Path) -> None:
    with Store(path) as store:
        lines = overview_lines(overview(store))
    assert str(path) in lines[0]
    assert any("alps: 30.0 m, datum egm96" in line for line in lines)
    assert sum(line.startswith(("terrain", "objects")) for line in lines) == 2


def test_an_empty_store_has_an_overview(tmp_path: Path) -> None:
    Writer(tmp_path / "empty.geopage").close()
    with Store(tmp_path / "empty.geopage") as store:
        found = overview(store)
    assert found["objects"] == 0
    assert found["lanes"] == {"terrain": [], "objects": []}
    assert len(overview_lines(found)) == 1
