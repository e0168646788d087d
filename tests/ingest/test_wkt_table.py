# SPDX-License-Identifier: Apache-2.0
"""CSV: outlines as WKT or WKB, other columns as attributes, bad rows listed."""

from pathlib import Path

import pytest
import shapely

from ingest.footprints import Footprints, read_parts
from ingest.repair import repair
from tests.ingest.reading import read_footprints
from tiles.errors import InputError

SHAPE = shapely.box(7, 43, 7.001, 43.001)


def read(tmp_path: Path, text: str, name: str = "a.csv", **named: str) -> Footprints:
    path = tmp_path / name
    path.write_bytes(text.encode("latin-1"))
    return read_footprints(path, **named)


@pytest.mark.parametrize("delimiter", [";", "\t", "|"])
@pytest.mark.parametrize("column", ["WKT", "geometry", "the_geom"])
def test_outlines_and_attributes_are_read(
    tmp_path: Path, delimiter: str, column: str
) -> None:
    rows = [["name", column, "height"], ["a", SHAPE.wkt, "12,5"], ["b", SHAPE.wkt, ""]]
    found = read(tmp_path, "\r\n".join(map(delimiter.join, rows)), "a.txt")
    assert [one.equals(SHAPE) for one in found.geometry] == [True, True]
    assert found.columns["name"].tolist() == ["a", "b"]
    assert found.columns["height"].tolist() == ["12,5", None]
    assert "taken as EPSG:4326" in found.warnings[0]


def test_hexadecimal_wkb_and_a_stated_srid_are_understood(tmp_path: Path) -> None:
    code = shapely.to_wkb(SHAPE, hex=True)
    assert read(tmp_path, f"geom,a\n{code},1\n").geometry[0].equals(SHAPE)
    metres = "SRID=3857;POLYGON((0 0,111319.49 0,111319.49 1000,0 0))"
    found = read(tmp_path, f'a,geom\n1,"{metres}"\n')
    assert (found.crs, found.warnings) == ("EPSG:3857", ())
    assert found.geometry[0].bounds[2] == pytest.approx(1.0)


def test_bad_rows_are_listed_and_short_ones_have_no_value(tmp_path: Path) -> None:
    text = (
        f'wkt;a;b\n"{SHAPE.wkt}";1\nPOLYGON((1 2;3;4\n;5;6\n\nxx;7;8\n"{SHAPE.wkt}";9;9;9\n'
    )
    found = read(tmp_path, text)
    assert [number for number, _ in found.unreadable] == [1, 4]
    assert found.feature.tolist() == [0, 2, 5]
    assert found.geometry[1] is None
    assert found.columns["b"].tolist() == [None, "6", "9"]


def test_a_number_beyond_all_bounds_is_left_to_the_repair(tmp_path: Path) -> None:
    huge = "POLYGON((7 43,1e999 43,7 44,7 43))"
    found = read(tmp_path, f'wkt;a\n"{SHAPE.wkt}";1\n"{huge}";2\n')
    reasons = repair(found.geometry).reason.tolist()
    lost = [reason for reason in reasons if reason] + [why for _, why in found.unreadable]
    assert len(lost) == 1


def test_parts_count_on(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("wkt;a\n" + "".join(f"{SHAPE.wkt};{k}\n" for k in range(7)))
    parts = list(read_parts(path, at_most=3))
    assert [part.feature.tolist() for part in parts] == [[0, 1, 2], [3, 4, 5], [6]]


def test_a_table_without_outlines_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"without a column of WKT .columns: lon, lat"):
        read(tmp_path, "lon,lat\n7,43\n")
    with pytest.raises(InputError, match="no features in layer"):
        read(tmp_path, "wkt,a\n")
    with pytest.raises(InputError, match="without polygons"):
        read(tmp_path, "wkt,a\nPOINT(7 43),1\n")
    with pytest.raises(InputError, match="not a GeoPackage"):
        read(tmp_path, "wkt,a\0\n")


def test_other_encodings_are_marked(tmp_path: Path) -> None:
    found = read(tmp_path, f'wkt;n\n"{SHAPE.wkt}";caf\u00e9\n')
    assert found.columns["n"].tolist() == ["caf\ufffd"]
    assert "no UTF-8" in " ".join(found.warnings)
