# SPDX-License-Identifier: Apache-2.0
"""City models that are broken: one line, or skipped and counted, never a traceback."""

import copy
import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ingest.city_models import read_city_model
from tests.ingest.city_samples import (
    RD,
    box,
    building,
    city_gml,
    document,
    gable,
    plain_solid,
    write,
)
from tiles.errors import InputError

WHOLE = document(gable(), box(5, 5, 5).moved(30, 0, 0))
SOLID = plain_solid(gable().moved(*RD), 2)


def outcome(path: Path) -> tuple[int, list[str]]:
    """Return how many buildings were read, and the reasons of those that were not."""
    parts = list(read_city_model(path))
    for part in parts:
        assert len(part.geometry) == len(part.feature) == len(part.solid)
        assert all(len(column) == len(part.feature) for column in part.columns.values())
        json.dumps([column.tolist() for column in part.columns.values()], allow_nan=False)
    read = sum(len(part.feature) for part in parts)
    return read, [reason for part in parts for _, reason in part.unreadable]


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        outcome(path)
    line = str(caught.value)
    assert "\n" not in line
    assert path.name in line
    return line


def settled(path: Path) -> int | str:
    """Return how many buildings were read or skipped, or that the file was refused."""
    try:
        read, reasons = outcome(path)
    except InputError as error:
        return "refused" if "\n" not in str(error) else str(error)
    return read + len(reasons)


def changed(tmp_path: Path, *keys: str | int, to: Any) -> Path:
    """Write the sample with one value changed."""
    whole = copy.deepcopy(WHOLE)
    inner: Any = whole
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = to
    return write(tmp_path / "a.json", whole)


GEOMETRY = ("CityObjects", "b0", "geometry", 0)
RING = (*GEOMETRY, "boundaries", 0, 0, 0)


@pytest.mark.parametrize(
    ("keys", "value", "reason"),
    [
        ((*RING, 0), -1, "a vertex that is not there"),
        ((*RING, 0), 10**6, "a vertex that is not there"),
        ((*RING, 0), 10**30, "rings of vertices"),
        ((*RING, 0), 1.5, "rings of vertices"),
        ((*RING, 0), "1", "rings of vertices"),
        ((*RING, 0), None, "rings of vertices"),
        (RING, 7, "rings of vertices"),
        ((*GEOMETRY, "boundaries"), {"a": 1}, "no geometry"),
        ((*GEOMETRY, "boundaries"), [], "no geometry"),
        ((*GEOMETRY, "boundaries"), [[[[0, 1]]]], "no face with an area"),
        ((*GEOMETRY, "boundaries"), [[[[0, 1, 5, 4]]]], "only upright faces"),
        ((*GEOMETRY, "type"), "GeometryInstance", "no geometry"),
        ((*GEOMETRY, "type"), ["Solid"], "no geometry"),
        (("CityObjects", "b0"), "a house", "no type: not a building"),
        (("CityObjects", "b0", "type"), {}, "no type: not a building"),
        (("vertices", 0), [0, 0], "not three numbers"),
        (("vertices", 0), [0, 0, float("nan")], "not three numbers"),
        (("vertices", 0), [0, 0, "x"], "not three numbers"),
        (("vertices", 0), [10**400, 0, 0], "not three numbers"),
        (("vertices", 0), [10**18, 0, 0], "wider than 5 km"),
        (("vertices", 0), [0, 0, -(10**8)], "higher than 1000 m"),
    ],
)
def test_one_broken_building_leaves_the_others(
    tmp_path: Path, keys: tuple[str | int, ...], value: Any, reason: str
) -> None:
    read, reasons = outcome(changed(tmp_path, *keys, to=value))
    assert read == 1
    assert reason in reasons[0]


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        ((*GEOMETRY, "semantics"), [1]),
        ((*GEOMETRY, "semantics", "values"), [[0]]),
        ((*GEOMETRY, "semantics", "values", 0, 0), 99),
        ((*GEOMETRY, "semantics", "surfaces"), [None] * 9),
        ((*GEOMETRY, "lod"), "high"),
        ((*GEOMETRY, "lod"), float("inf")),
        (("CityObjects", "b0", "attributes"), [1, 2]),
        (("CityObjects", "b0", "attributes", "x"), float("nan")),
        (("CityObjects", "b0", "attributes", "\ud800"), "\udfff"),
        (("CityObjects", "b0", "parents"), ["b0", 7, "nobody"]),
        (("CityObjects", "b0", "children"), "b1"),
        (("metadata", "geographicalExtent"), "everywhere"),
        (("version",), 7),
    ],
)
def test_what_is_not_needed_may_be_broken(
    tmp_path: Path, keys: tuple[str | int, ...], value: Any
) -> None:
    assert outcome(changed(tmp_path, *keys, to=value)) == (2, [])


def test_a_circle_of_parents_is_one_building(tmp_path: Path) -> None:
    whole = copy.deepcopy(WHOLE)
    for one, other in (("b0", "b1"), ("b1", "b0")):
        whole["CityObjects"][one] |= {"parents": [other], "type": "BuildingPart"}
    found = list(read_city_model(write(tmp_path / "a.json", whole)))
    assert found[0].columns["parts"].tolist() == [1]


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("type",), "FeatureCollection", "not CityJSON"),
        (("transform",), {"scale": [1, 1]}, "transform"),
        (("transform", "scale"), [float("inf")] * 3, "transform"),
        (("transform", "translate"), [1e300, 1e300, 0], "can't be in EPSG:28992"),
        (("metadata", "referenceSystem"), None, "--crs"),
        (("metadata", "referenceSystem"), 7415, "--crs"),
        (("metadata", "referenceSystem"), "EPSG:99999999", "unknown CRS"),
        (("metadata", "referenceSystem"), "EPSG:5709", "no map or geographic CRS"),
        (("metadata", "referenceSystem"), "x" * 100_000, "unknown CRS"),
        (("CityObjects",), [], "no CityObjects"),
        (("CityObjects",), {}, "without buildings"),
        (("vertices",), "none", "a vertex that is not there"),
    ],
)
def test_a_file_that_says_nothing_is_refused_in_one_line(
    tmp_path: Path, keys: tuple[str | int, ...], value: Any, words: str
) -> None:
    assert words in refusal(changed(tmp_path, *keys, to=value))


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b'{"type": "CityJSON"',
        b'{"a": ' * 100_000,
        b'{"type": "CityJSON", "CityObjects": {}, "vertices": ' + b"[" * 100_000,
        b'{"type": "CityJSON", "version": ' + b"9" * 10_000 + b"}",
        b'{"type": "CityJSON", "name": "\xff"}',
        b"\x1f\x8b\x08\x00garbage",
        gzip.compress(b'{"type": "CityJSON"}' * 100)[:-9],
        b"<",
        b"<a>",
        b"<?xml version='1.0' encoding='no-such'?><a/>",
        b"<a/>",
        "<?xml version='1.0'?><a b='\u00e4'/>".encode("latin-1"),
    ],
)
def test_what_is_no_city_model_is_refused_in_one_line(tmp_path: Path, body: bytes) -> None:
    path = tmp_path / "a.city"
    path.write_bytes(body)
    refusal(path)


def test_a_broken_line_in_the_middle_is_one_line_skipped(tmp_path: Path) -> None:
    head = {**WHOLE, "CityObjects": {}, "vertices": []}
    good = {**WHOLE, "type": "CityJSONFeature"}
    lines = [json.dumps(line) for line in (head, good, good)]
    for broken in (b"{", b"[" * 100_000, b"[]", b'"', b"\xff\xfe", b'{"type": 1}'):
        body = b"\n".join([*(line.encode() for line in lines[:2]), broken, b"", b" ",
                           lines[2].encode()])  # fmt: skip
        path = tmp_path / "a.city.jsonl"
        path.write_bytes(body)
        assert outcome(path) == (4, ["a line that is no CityJSONFeature"])


@pytest.mark.parametrize(
    "prolog",
    [
        '<!DOCTYPE a [<!ENTITY b "ha"><!ENTITY c "&b;&b;&b;&b;">]>',
        '<!DOCTYPE a SYSTEM "file:///etc/passwd">',
        "<!-- " + "x" * 200_000 + " --><!DOCTYPE a>",
    ],
)
def test_a_document_type_is_refused(tmp_path: Path, prolog: str) -> None:
    path = tmp_path / "a.gml"
    text = city_gml(building(SOLID))
    head, _, rest = text.partition("?>")
    path.write_text(f"{head}?>{prolog}{rest}")
    assert "DOCTYPE" in refusal(path)


@pytest.mark.parametrize(
    ("inside", "reason"),
    [
        ("", "no geometry"),
        ("<bldg:lod2Solid/>", "no geometry"),
        ("<bldg:lod2Solid><gml:Polygon/></bldg:lod2Solid>", "polygons without rings"),
        (SOLID.replace(" ", "   ", 1).replace("85000", "x"), "no list of points"),
        (SOLID.replace("85000", "NaN"), "no list of points"),
        (SOLID.replace("85000 447000", "85000"), "no list of points"),
        (SOLID.replace("<gml:posList>", "<gml:posList srsDimension='2'>"), "heights"),
        ("<bldg:lod2Solid xlink:href='#b0'/>", "no geometry"),
        ("<bldg:lod2Solid xlink:href='http://x/y'/>", "no geometry"),
    ],
)
def test_one_broken_building_of_citygml_leaves_the_others(
    tmp_path: Path, inside: str, reason: str
) -> None:
    path = tmp_path / "a.gml"
    broken, good = building(inside), building(SOLID, "b1")
    path.write_text(city_gml(broken, "<tran:Road/>", good))
    read, reasons = outcome(path)
    assert read == 1
    assert reason in reasons[0]
    assert reasons[1] == "Road: not a building"


def test_xml_may_not_be_deep(tmp_path: Path) -> None:
    path = tmp_path / "a.gml"
    path.write_text(city_gml(building("<a>" * 100_000 + "</a>" * 100_000)))
    assert "deeper" in refusal(path)


JUNK = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3),
    st.lists(st.integers(-2, 20), max_size=4), st.builds(dict), st.builds(lambda: [[]]),
    st.dictionaries(st.sampled_from(["type", "lod", "x"]), st.text(max_size=3), max_size=2),
)  # fmt: skip


@settings(
    max_examples=60, deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
@given(data=st.data())
def test_junk_anywhere_is_refused_or_skipped(tmp_path: Path, data: st.DataObject) -> None:
    whole = copy.deepcopy(WHOLE)
    for _ in range(data.draw(st.integers(1, 3))):
        inner: Any = whole
        while True:
            keys = list(inner) if isinstance(inner, dict) else list(range(len(inner)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            deeper = inner[key]
            if not isinstance(deeper, dict | list) or data.draw(st.integers(0, 3)) == 0:
                inner[key] = data.draw(JUNK)
                break
            inner = deeper
    path = write(tmp_path / "a.json", whole)
    assert settled(path) in {1, 2, "refused"}


@settings(
    max_examples=200, deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
@given(seed=st.integers(0, 2**32))
def test_a_damaged_citygml_is_refused_or_skipped(tmp_path: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    text = bytearray(city_gml(building(SOLID), building(SOLID, "b1")).encode())
    for _ in range(random.integers(1, 4)):
        at = int(random.integers(0, len(text)))
        text[at : at + int(random.integers(0, 30))] = random.choice(
            [b"", b" ", b"<", b">", b"&", b"9", b"e9", b"-", b"\x00", b"</gml:Polygon>"]
        )
    path = tmp_path / "a.gml"
    path.write_bytes(bytes(text))
    assert settled(path) in {1, 2, "refused"}
