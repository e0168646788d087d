# SPDX-License-Identifier: Apache-2.0
"""GeoParquet: the same as other formats where pyarrow is there, else one line."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ingest.footprints import read_parts
from tests.ingest.reading import read_footprints
from tiles.errors import InputError

SHAPES = [shapely.box(7 + k / 100, 43, 7.001 + k / 100, 43.001) for k in range(5)]
ABOUT: dict[str, Any] = {"encoding": "WKB", "geometry_types": ["Polygon"]}


def write(tmp_path: Path, about: dict[str, Any] | None, **columns: Any) -> Path:
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    wkb = shapely.to_wkb(np.array(SHAPES, object)).tolist()
    table = arrow.table({"where": wkb, **columns})
    if about is not None:
        geo = {"version": "1.1.0", "primary_column": "where", "columns": {"where": about}}
        table = table.replace_schema_metadata({"geo": json.dumps(geo)})
    path = tmp_path / "a.parquet"
    parquet.write_table(table, path, row_group_size=2)
    return path


def test_geometries_and_values_are_what_was_written(tmp_path: Path) -> None:
    values: dict[str, Any] = {
        "whole": [1, None, 2**60 + 1, 4, 5],
        "real": [1.5, 2.0, 3.0, 4.0, 5.0],
        "text": ["a", None, "c", "d", "e"],
        "names": [{"primary": "x"}, None, {"primary": "y"}, None, None],
        "nothing": [None] * 5,
    }
    path = write(tmp_path, ABOUT, **values, bbox=[{"xmin": 1.0}] * 5)
    found = read_footprints(path)
    assert [a.equals(b) for a, b in zip(found.geometry, SHAPES, strict=True)] == [True] * 5
    assert {name: column.tolist() for name, column in found.columns.items()} == values
    assert found.columns["real"].dtype == np.float64
    assert found.crs == "OGC:CRS84"
    parts = [part.feature.tolist() for part in read_parts(path, at_most=2)]
    assert sorted(number for part in parts for number in part) == [0, 1, 2, 3, 4]
    assert max(map(len, parts)) <= 2


def test_the_crs_is_that_of_the_column(tmp_path: Path) -> None:
    utm = {"crs": {"type": "ProjectedCRS", "id": {"authority": "EPSG", "code": 32632}}}
    with pytest.raises(InputError, match="unknown CRS"):
        read_footprints(write(tmp_path, ABOUT | utm))
    with pytest.raises(InputError, match="says no CRS"):
        read_footprints(write(tmp_path, ABOUT | {"crs": None}))
    assert read_footprints(tmp_path / "a.parquet", crs="EPSG:4326").crs == "EPSG:4326"


def test_what_is_no_geoparquet_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a Parquet file that is no GeoParquet"):
        read_footprints(write(tmp_path, None))
    with pytest.raises(InputError, match="geometries encoded as polygon"):
        read_footprints(write(tmp_path, ABOUT | {"encoding": "polygon"}))
    path = write(tmp_path, ABOUT)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="can't be read"):
        read_footprints(path)


def test_without_pyarrow_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.parquet"
    path.write_bytes(b"PAR1" + bytes(100))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install geopage\[geoparquet\]"):
        read_footprints(path)
