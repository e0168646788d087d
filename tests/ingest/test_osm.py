# SPDX-License-Identifier: Apache-2.0
"""OpenStreetMap files: ways and relations that are buildings, with all their tags."""

import gzip
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import pytest
import shapely

from ingest import osm
from ingest.footprints import read_parts
from tests.ingest.reading import read_footprints
from tiles.errors import InputError

CORNERS = [(7.0, 43.0), (7.001, 43.0), (7.001, 43.001), (7.0, 43.001)]
YARD = [(7.0003, 43.0003), (7.0006, 43.0003), (7.0006, 43.0006)]
NODES = "".join(
    f'<node id="{k + 1}" lon="{lon}" lat="{lat}"/>'
    for k, (lon, lat) in enumerate(CORNERS + YARD)
)


def way(number: int, nodes: Sequence[int], **tags: str) -> str:
    return (
        f'<way id="{number}">'
        + "".join(f'<nd ref="{k}"/>' for k in nodes)
        + told(tags)
        + "</way>"
    )


def told(tags: dict[str, str]) -> str:
    return "".join(f'<tag k="{k.replace("__", ":")}" v="{v}"/>' for k, v in tags.items())


SQUARE, TRIANGLE = (1, 2, 3, 4, 1), (5, 6, 7, 5)
TOWN = (
    "<?xml version='1.0' encoding='UTF-8'?>\n<!-- made by hand -->\n<osm version='0.6'>"
    + NODES
    + way(
        10,
        SQUARE,
        building="yes",
        building__levels="4",
        height="12 m",
        name="A, &quot;b&quot;",
    )
    + way(11, TRIANGLE, building__part="yes", min_height="3")
    + way(12, SQUARE, landuse="forest")
    + way(13, SQUARE, building="no")
    + way(14, SQUARE)
    + way(15, TRIANGLE)
    + '<relation id="20"><member type="way" ref="14" role="outer"/>'
    + '<member type="way" ref="15" role="inner"/>'
    + told({"type": "multipolygon", "building": "house"})
    + "</relation></osm>"
)


def write(tmp_path: Path, text: str, name: str = "town.osm") -> Path:
    path = tmp_path / name
    path.write_bytes(gzip.compress(text.encode()) if name.endswith("gz") else text.encode())
    return path


@pytest.mark.parametrize("name", ["town.osm", "town.xml", "town.osm.gz"])
def test_buildings_and_their_parts_are_read_and_nothing_else(
    tmp_path: Path, name: str
) -> None:
    found = read_footprints(write(tmp_path, TOWN, name))
    rows = dict(zip(found.feature.tolist(), found.geometry, strict=True))
    assert set(rows) == {10, 11, -20}
    assert rows[10].equals(shapely.Polygon(CORNERS))
    assert rows[-20].equals(shapely.Polygon(CORNERS, [YARD]))
    place = found.feature.tolist().index(10)
    tags = {name: column[place] for name, column in found.columns.items()}
    assert {name: value for name, value in tags.items() if value is not None} == {
        "building": "yes",
        "building:levels": "4",
        "height": "12 m",
        "name": 'A, "b"',
        "osm_id": "way/10",
    }
    assert "relation/20" in found.columns["osm_id"].tolist()
    assert found.crs == "EPSG:4326"


def test_parts_of_a_file_are_the_file_and_too_many_buildings_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = list(read_parts(write(tmp_path, TOWN), at_most=2))
    assert [len(part.feature) for part in parts] == [2, 1]
    numbers = [number for part in parts for number in part.feature]
    assert sorted(numbers) == [-20, 10, 11]
    heights = [value for part in parts for value in part.columns["height"]]
    assert dict(zip(numbers, heights, strict=True)) == {-20: None, 10: "12 m", 11: None}
    monkeypatch.setattr(osm, "MAX_BUILDINGS", 2)
    with pytest.raises(InputError, match="more than 2 buildings; cut it"):
        list(read_parts(tmp_path / "town.osm"))


def field(number: int, value: int | bytes) -> bytes:
    """A field of a protocol buffer."""
    if isinstance(value, bytes):
        return varint(number << 3 | 2) + varint(len(value)) + value
    return varint(number << 3) + varint(value)


def varint(value: int) -> bytes:
    *low, last = [value >> k & 127 for k in range(0, max(value.bit_length(), 1), 7)]
    return bytes([*(one | 128 for one in low), last])


def zigzag(values: Sequence[int]) -> bytes:
    steps = [b - a for a, b in zip((0, *values), values, strict=False)]
    return b"".join(varint(2 * one if one >= 0 else -2 * one - 1) for one in steps)


def blob(kind: bytes, body: bytes) -> bytes:
    data = field(2, len(body)) + field(3, zlib.compress(body))
    head = field(1, kind) + field(3, len(data))
    return struct.pack(">I", len(head)) + head + data


def pbf() -> bytes:
    head = field(4, b"OsmSchema-V0.6") + field(4, b"DenseNodes")
    texts = b"".join(field(1, one) for one in (b"", b"building", b"yes", b"height", b"9"))
    lats = [round(lat * 1e7) for _, lat in CORNERS]
    lons = [round(lon * 1e7) for lon, _ in CORNERS]
    dense = field(1, zigzag([1, 2, 3, 4])) + field(8, zigzag(lats)) + field(9, zigzag(lons))
    one = field(1, 30) + field(2, bytes([1, 3])) + field(3, bytes([2, 4]))
    ways = field(3, one + field(8, zigzag(SQUARE)))
    groups = field(2, field(2, dense)) + field(2, ways)
    return blob(b"OSMHeader", head) + blob(b"OSMData", field(1, texts) + groups)


def test_a_pbf_is_read(tmp_path: Path) -> None:
    path = tmp_path / "town.osm.pbf"
    path.write_bytes(pbf())
    found = read_footprints(path)
    assert found.geometry[0].equals_exact(
        shapely.MultiPolygon([shapely.Polygon(CORNERS)]), 1e-7
    )
    assert found.columns["height"].tolist() == ["9"]
    path.write_bytes(pbf()[:-20])
    with pytest.raises(InputError, match=r"town\.osm\.pbf: can't be read"):
        read_footprints(path)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"<osm version='0.6'>{NODES}</osm>", "no area is tagged building"),
        (TOWN[:900], "can't be read"),
        ("<osm></osm><OGRVRTDataSource/>", "not a GeoPackage"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><osm></osm>', "not a GeoPackage"),
    ],
)
def test_what_has_no_buildings_or_is_something_else_is_refused(
    tmp_path: Path, text: str, reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        read_footprints(write(tmp_path, text))


def test_another_layer_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no layer named lines; the layer is"):
        read_footprints(write(tmp_path, TOWN), layer="lines")
