# SPDX-License-Identifier: Apache-2.0
"""Hostile vector files: one line, or counted and listed; never a traceback or a hang."""

import io
import json
import random
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ingest import geojson, json_split
from ingest.footprints import read_parts
from ingest.heights import HeightRules, heights_of
from ingest.repair import repair
from tests.ingest.test_footprints import HOUSES, SUFFIX, write
from tests.ingest.test_osm import TOWN, pbf
from tests.ingest.test_wkt_table import SHAPE
from tiles.errors import InputError

RING = [[7, 43], [7.001, 43], [7.001, 43.001], [7, 43]]
GOOD = {"type": "Feature", "properties": {"height": "12 m"}, "geometry": {}}
GOOD["geometry"] = {"type": "Polygon", "coordinates": [RING]}


def taken(path: Path) -> tuple[int, int, dict[int, str]]:
    """Read all of a file; return features read, stored, and why the others are not."""
    read = stored = 0
    lost: dict[int, str] = {}
    for part in read_parts(path):
        found = repair(part.geometry)
        heights_of(path, part.columns, len(part.feature), HeightRules())
        kept = found.reason == ""
        read += len(kept) + len(part.unreadable)
        stored += int(kept.sum())
        lost |= dict(zip(part.feature[~kept].tolist(), found.reason[~kept], strict=True))
        lost |= dict(part.unreadable)
    return read, stored, lost


def collection(tmp_path: Path, *features: str) -> Path:
    path = tmp_path / "a.geojson"
    path.write_text(
        '{"type": "FeatureCollection", "features": [' + ",\n".join(features) + "]}"
    )
    return path


DEEP = 10_000
NESTED = {
    "collections": '{"type": "FeatureCollection", "features": [' * DEEP + "]}" * DEEP,
    "geometries": '{"type": "Feature", "properties": {}, "geometry": '
    + '{"type": "GeometryCollection", "geometries": [' * DEEP
    + "]}" * DEEP
    + "}",
    "properties": '{"type": "Feature", "properties": {"a": '
    + "[" * DEEP
    + "]" * DEEP
    + '}, "geometry": null}',
}


@pytest.mark.parametrize("what", NESTED)
def test_a_feature_nested_10000_deep_is_listed_and_the_next_is_read(
    tmp_path: Path, what: str
) -> None:
    path = collection(tmp_path, NESTED[what], json.dumps(GOOD))
    assert taken(path) == (2, 1, {0: "nested too deep"})


@pytest.mark.parametrize("text", [NESTED["collections"], '{"a":' * DEEP, "[" * DEEP])
def test_a_file_nested_10000_deep_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "deep.geojson"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        taken(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("name", ["a.geojson", "a.geojsonl"])
def test_one_broken_among_many_is_listed_in_bounded_memory(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    count, good = 12_000, json.dumps(GOOD)
    path = tmp_path / name
    with path.open("w") as file:
        lines = name.endswith("l")
        file.write("" if lines else '{"type": "FeatureCollection", "features": [\n')
        between = "\n" if lines else ",\n"
        file.write(between.join([good] * 6_000))
        file.write(between + good.replace('"type"', '"type" type', 1) + between)
        file.write(between.join([good] * (count - 6_001)))
        file.write("" if lines else "]}")
    monkeypatch.setattr(json_split, "_BLOCK_BYTES", 1 << 16)
    monkeypatch.setattr(geojson, "_BLOCK_BYTES", 1 << 16)
    parts = read_parts(path, at_most=500)
    tracemalloc.start()
    try:
        found = [(len(part.feature), part.unreadable) for part in parts]
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert sum(held for held, _ in found) == count - 1
    assert [one for _, lost in found for one in lost] == [(6_000, "broken JSON")]
    assert peak_bytes < 1.2e6


def test_odd_polygons_add_up(tmp_path: Path) -> None:
    def square(x: float, y: float, side: float) -> list[list[float]]:
        return [[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]

    house = square(7, 43, 1e-3)
    shapes: dict[str, Any] = {
        "": [
            [house],
            [house[::-1]],  # wrong winding
            [house, square(7.0002, 43.0002, 1e-4)],  # hole of the same winding
            [[house[0], house[2], house[1], house[3], house[0]]],  # bow tie
            [[*house[:2], [7.005, 43], *house[1:]]],  # spike
            [house, square(8, 43, 1e-3)],  # hole outside
            [[*house, *house]],  # twice round
            [[[*corner, 12.5] for corner in house]],  # with heights
        ],
        "no geometry": [[], [[]]],
        "no area left after repair": [[house[:2]], [[house[0]] * 5], [[[7, 43], [8, 43]]]],
        "smaller than 0.5 m2": [[square(7, 43, 5e-6)]],
        "wider than 5 km": [[square(7, 43, 0.1)]],
        "outside longitude +-360, latitude +-90": [[square(7, 90, 1e-3)]],
    }
    order = [(reason, one) for reason, found in shapes.items() for one in found]
    texts = [
        json.dumps({**GOOD, "geometry": {"type": "Polygon", "coordinates": rings}})
        for _, rings in order
    ]
    read, stored, lost = taken(collection(tmp_path, *texts))
    assert (read, stored) == (len(order), len(shapes[""]))
    assert lost == {k: reason for k, (reason, _) in enumerate(order) if reason}


def test_a_broken_geometry_in_a_geopackage_is_listed(tmp_path: Path) -> None:
    path = write(tmp_path / "a.gpkg", [*HOUSES, *HOUSES], "GPKG", SPATIAL_INDEX="NO")
    body = bytearray(path.read_bytes())
    wkb = shapely.to_wkb(HOUSES[0])
    at = body.find(wkb[5:60]) + 4  # the number of corners
    assert at > 4
    body[at : at + 4] = b"\xff\xff\xff\x7f"
    path.write_bytes(body)
    read, stored, lost = taken(path)
    assert (read, stored) == (4, 3)
    assert len(lost) == 1


def seeds(folder: Path) -> list[Path]:
    """One small good file of each format."""
    made = [write(folder / f"a{SUFFIX[one]}", HOUSES, one) for one in SUFFIX]
    texts = {"a.csv": f"wkt;h\n{SHAPE.wkt};3\n{SHAPE.wkt};4\n", "a.osm": TOWN}
    for name, text in texts.items():
        (folder / name).write_text(text)
    (folder / "a.osm.pbf").write_bytes(pbf())
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(made[0], "a.gpkg")
    (folder / "a.zip").write_bytes(packed.getvalue())
    return [
        *made,
        *(folder / name for name in texts),
        folder / "a.osm.pbf",
        folder / "a.zip",
    ]


BITS = [b"{", b"}", b"[", b"]", b",", b'"', b"null", b"1e999", b"NaN", b"\\ud800", b"\xff"]


def spoiled(body: bytes, dice: random.Random) -> bytes:
    text = bytearray(body)
    for _ in range(dice.randint(1, 3)):
        at = dice.randrange(len(text))
        how = dice.random()
        if how < 0.4:
            text[at : at + dice.randint(0, 4)] = dice.choice(BITS)
        elif how < 0.7:
            text[at] = dice.randrange(256)
        else:
            del text[at : at + dice.randint(1, 30)]
    return bytes(text)


def test_files_spoiled_at_random_end_in_one_line_or_a_count(tmp_path: Path) -> None:
    dice = random.Random(7)
    for path in seeds(tmp_path):
        body = path.read_bytes()
        for _ in range(8):
            path.write_bytes(spoiled(body, dice))
            try:
                read, stored, lost = taken(path)
            except InputError as error:
                assert "\n" not in str(error)  # noqa: PT017 - both ends are good
            else:
                assert read >= stored + len(lost) > 0


def test_disguised_files_open_nothing_else(tmp_path: Path) -> None:
    secret = tmp_path / "secret.csv"
    secret.write_text(f'wkt,word\n"{SHAPE.wkt}",password\n')
    vrt = (
        "<OGRVRTDataSource><OGRVRTLayer name='secret'>"
        f"<SrcDataSource>{secret}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>"
    )
    for name in ("a.geojson", "a.gpkg", "a.osm", "a.csv", "a.shp", "a.vrt"):
        for text in (vrt, f"<osm></osm>{vrt}", f"<osm>{vrt}</osm>"):
            path = tmp_path / name
            path.write_text(text)
            with pytest.raises(InputError):
                taken(path)


def test_heights_that_are_no_numbers_do_not_stop_the_reading() -> None:
    values = [[1], {"a": 2}, True, 1, "12 m", np.nan, None, 10_000, -3, "~10"]
    column = np.empty(len(values), object)
    column[:] = values
    found = heights_of("x", {"height": column}, len(values), HeightRules())
    assert found.top_m.tolist() == [6, 6, 6, 1, 12, 6, 6, 6, 6, 10]
    assert ((found.how >> 3) & 1).tolist() == [1, 1, 1, 0, 0, 0, 0, 1, 1, 0]
