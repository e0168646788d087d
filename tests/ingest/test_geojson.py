# SPDX-License-Identifier: Apache-2.0
"""GeoJSON: values as they stand there, broken features listed, others untouched."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio.raw
import pytest
import shapely

from ingest.footprints import Footprints
from ingest.rings import Rings
from tests.ingest.reading import read_footprints
from tiles.errors import InputError

RING = [[7.0, 43.0], [7.001, 43.0], [7.001, 43.001], [7.0, 43.0]]
HOLE = [[7.0005, 43.0002], [7.0006, 43.0002], [7.0006, 43.0003], [7.0005, 43.0002]]
GOOD: dict[str, Any] = {"type": "Polygon", "coordinates": [RING]}


def feature(geometry: Any = GOOD, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def read(tmp_path: Path, *features: Any, **members: Any) -> Footprints:
    text = json.dumps({"type": "FeatureCollection", **members, "features": features})
    return read_text(tmp_path, text)


def read_text(tmp_path: Path, text: str | bytes, name: str = "a.geojson") -> Footprints:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_footprints(path)


def test_geometries_are_those_that_gdal_reads(tmp_path: Path) -> None:
    far = [[x + 1, y] for x, y in RING]
    kinds: list[Any] = [
        GOOD,
        {"type": "Polygon", "coordinates": [RING, HOLE]},
        {"type": "MultiPolygon", "coordinates": [[RING, HOLE], [far]]},
        {"type": "MultiPolygon", "coordinates": [[far]]},
        {"type": "Point", "coordinates": [7, 43]},
        {"type": "GeometryCollection", "geometries": [GOOD]},
        None,
        {"type": "MultiPolygon", "coordinates": [[far], [RING]]},
    ]
    found = read(tmp_path, *map(feature, kinds))
    _, _, wkb, _ = pyogrio.raw.read(tmp_path / "a.geojson")
    for mine, theirs in zip(found.geometry, shapely.from_wkb(wkb), strict=True):
        if theirs is None:
            assert mine is None
        else:
            a = (
                mine.geoms[0]
                if mine.geom_type == "MultiPolygon" and len(mine.geoms) == 1
                else mine
            )
            assert a.normalize().equals(theirs.normalize())


def test_values_are_what_the_json_says(tmp_path: Path) -> None:
    values = {"a": 3, "b": 3.0, "c": True, "d": "x", "e": [1, {"f": None}], "g": 2**60 + 1}
    found = read(tmp_path, feature(**values), feature(a=None, h=1))
    first = {name: column[0] for name, column in found.columns.items()}
    assert first == {**values, "h": None}
    assert [type(first[name]) for name in "ab"] == [int, float]
    assert found.columns["a"][1] is None


def test_a_number_of_the_feature_becomes_an_attribute_unless_there_is_one(
    tmp_path: Path,
) -> None:
    named = {**feature(), "id": "way/5"}
    other = {**feature(id=7), "id": 3}
    assert read(tmp_path, named, other).columns["id"].tolist() == ["way/5", 7]


BROKEN = {
    "not a Feature": [None, 5, [], "x", {"type": "feature"}, {"type": ["Feature"]}],
    "a geometry that is no GeoJSON": [
        feature("POLYGON((0 0,1 1,2 2))"),
        feature({"type": "Polygon"}),
        feature({"type": "polygon", "coordinates": [RING]}),
        feature({"type": "Polygon", "coordinates": RING}),
        feature({"type": "Polygon", "coordinates": [[["7", "43"]] * 4]}),
        feature({"type": "Polygon", "coordinates": [[[7], [8], [9], [7]]]}),
        feature({"type": "Polygon", "coordinates": [[[7, None]] * 4]}),
        feature({"type": "GeometryCollection", "geometries": [None]}),
        feature({"type": {}, "coordinates": []}),
    ],
    "properties that are no object": [{**feature(), "properties": 5}],
}


@pytest.mark.parametrize("reason", BROKEN)
def test_a_broken_feature_is_listed_and_costs_itself_alone(
    tmp_path: Path, reason: str
) -> None:
    bad = BROKEN[reason]
    found = read(tmp_path, feature(height=1), *bad, feature(height=2))
    assert found.unreadable == tuple((k + 1, reason) for k in range(len(bad)))
    assert found.feature.tolist() == [0, len(bad) + 1]
    assert found.columns["height"].tolist() == [1, 2]


def test_broken_json_inside_a_feature_is_listed(tmp_path: Path) -> None:
    good = json.dumps(feature(height=3))
    parts = [
        good,
        good.replace('"height":', '"height";'),
        good,
        good[:-1] + ',"x":tru}',
        good,
    ]
    text = '{"type":"FeatureCollection","features":[' + ",".join(parts) + "]}"
    found = read_text(tmp_path, text)
    assert found.unreadable == ((1, "broken JSON"), (3, "broken JSON"))
    lines = read_text(tmp_path, "\n".join([*parts, good[:50], "", good]), "a.geojsonl")
    assert [number for number, _ in lines.unreadable] == [1, 3, 5]
    assert lines.feature.tolist() == [0, 2, 4, 7]


def test_what_python_writes_for_no_number_is_no_value(tmp_path: Path) -> None:
    text = json.dumps({"type": "FeatureCollection", "features": [feature(h=np.nan, k=1)]})
    assert "NaN" in text
    found = read_text(tmp_path, text)
    assert (found.columns["h"].tolist(), found.columns["k"].tolist()) == ([None], [1])


def test_text_of_other_encodings_is_read_with_a_word(tmp_path: Path) -> None:
    text = json.dumps(
        {"type": "FeatureCollection", "features": [feature(n="caf\u00e9")]},
        ensure_ascii=False,
    )
    found = read_text(tmp_path, text.encode("latin-1"))
    assert found.columns["n"].tolist() == ["caf\u00e9"]
    assert "ISO-8859-1" in found.warnings[0]
    half = read_text(tmp_path, text.replace("\u00e9", "\\ud800"))
    assert half.columns["n"].tolist() == ["caf?"]
    assert "halves of characters" in half.warnings[0]
    assert read_text(tmp_path, b"\xef\xbb\xbf" + text.encode()).warnings == ()


def test_a_feature_or_a_geometry_alone_is_a_file_too(tmp_path: Path) -> None:
    assert read_text(tmp_path, json.dumps(feature(a=1))).columns["a"].tolist() == [1]
    assert read_text(tmp_path, json.dumps(GOOD)).geometry[0].equals(shapely.Polygon(RING))


def test_records_after_separators_are_read(tmp_path: Path) -> None:
    text = "".join(f"\x1e{json.dumps(feature(a=k), indent=1)}\n" for k in range(3))
    assert read_text(tmp_path, text).columns["a"].tolist() == [0, 1, 2]


def test_rings_that_are_open_or_short_are_closed_or_left_to_the_repair(
    tmp_path: Path,
) -> None:
    found = read(
        tmp_path,
        feature({"type": "Polygon", "coordinates": [RING[:-1]]}),
        feature({"type": "Polygon", "coordinates": [RING, [HOLE[0]], []]}),
        feature({"type": "Polygon", "coordinates": [RING[:2]]}),
        feature({"type": "Polygon", "coordinates": []}),
    )
    assert found.geometry[0].equals(shapely.Polygon(RING))
    assert [shapely.get_num_interior_rings(one) for one in found.geometry[:3]] == [0, 1, 0]
    assert found.geometry[2].area == 0
    assert found.geometry[3] is None
    assert "were closed" in found.warnings[0]


def test_an_empty_collector_of_rings_gives_nothing() -> None:
    assert len(Rings().geometries()) == 0


@pytest.mark.parametrize(
    ("crs", "system"),
    [
        ("EPSG:3857", "EPSG:3857"),
        ("urn:ogc:def:crs:EPSG::3857", "EPSG:3857"),
        ("urn:ogc:def:crs:OGC:1.3:CRS84", "OGC:CRS84"),
    ],
)
def test_a_crs_that_the_file_names_holds(tmp_path: Path, crs: str, system: str) -> None:
    metres = system == "EPSG:3857"
    ring = [[x * 111_319.49, y * 1e5] for x, y in RING] if metres else RING
    named = {"type": "name", "properties": {"name": crs}}
    found = read(tmp_path, feature({"type": "Polygon", "coordinates": [ring]}), crs=named)
    assert found.crs == system
    assert found.geometry[0].bounds[0] == pytest.approx(7.0, abs=1e-5)


def test_a_crs_that_comes_last_or_says_nothing_has_to_be_named(tmp_path: Path) -> None:
    members = {"crs": {"type": "name", "properties": {"name": "EPSG:3857"}}}
    late = json.dumps({"type": "FeatureCollection", "features": [feature()], **members})
    with pytest.raises(InputError, match="only after its features; name it with --crs"):
        read_text(tmp_path, late)
    assert len(read_footprints(tmp_path / "a.geojson", crs="EPSG:4326").feature) == 1
    with pytest.raises(InputError, match="says no CRS"):
        read(tmp_path, feature(), crs=None)
    with pytest.raises(InputError, match="names no CRS"):
        read(tmp_path, feature(), crs={"type": "link"})


def test_many_names_share_a_column_and_none_is_lost(tmp_path: Path) -> None:
    features = [feature(**{f"key{k}": k, "common": 1}) for k in range(400)]
    features[399]["properties"]["height"] = 9
    found = read(tmp_path, *features)
    assert len(found.columns) <= 253
    assert found.columns["height"][399] == 9
    for k in range(400):
        rest = found.columns["other_attributes"][k] or {}
        own = {
            name: found.columns[name][k] for name in found.columns if name.startswith("key")
        }
        present = {name: value for name, value in own.items() if value is not None}
        assert {**rest, **present} == {f"key{k}": k}
