# SPDX-License-Identifier: Apache-2.0
"""Packed files: read like plain ones; bombs, broken and odd ones refused in one line."""

import gzip
import json
import zipfile
from pathlib import Path

import pytest

from ingest import unpacking
from tests.ingest.reading import read_footprints
from tests.ingest.test_footprints import HOUSES, SQUARE, SUFFIX, write
from tiles.errors import InputError

ONE = json.dumps({"type": "Feature", "properties": {"a": 1}, "geometry": SQUARE})
TABLE = "wkt,a\n" + '"POLYGON((1 2,1.1 2,1.1 2.1,1 2))",1\n'
SIDES = (".shp", ".shx", ".dbf", ".prj", ".cpg")


def zipped(path: Path, **members: bytes | str) -> Path:
    """Members by name, with __ for the dot."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, body in members.items():
            archive.writestr(name.replace("__", "."), body)
    return path


@pytest.mark.parametrize(
    ("name", "text"),
    [("a.geojson", ONE), ("a.geojsonl", ONE + "\n" + ONE), ("a.csv", TABLE)],
)
def test_a_text_is_read_through_gzip_and_out_of_a_zip(
    tmp_path: Path, name: str, text: str
) -> None:
    plain, packed = tmp_path / name, tmp_path / f"{name}.gz"
    plain.write_text(text)
    packed.write_bytes(gzip.compress(text.encode()))
    archive = zipped(tmp_path / "a.zip", **{f"town/{name}": text, "town/README": "x"})
    expected = read_footprints(plain)
    for path in (packed, archive):
        found = read_footprints(path)
        assert found.path == path
        assert [one.wkt for one in found.geometry] == [one.wkt for one in expected.geometry]
        assert found.columns.keys() == expected.columns.keys()


@pytest.mark.parametrize("driver", ["GPKG", "FlatGeobuf"])
def test_a_binary_file_is_read_out_of_a_zip_whatever_its_name(
    tmp_path: Path, driver: str
) -> None:
    plain = write(tmp_path / f"a{SUFFIX[driver]}", HOUSES, driver)
    archive = zipped(tmp_path / "really.gpkg", **{plain.name: plain.read_bytes()})
    assert len(read_footprints(archive).feature) == 2


def test_a_shapefile_is_read_out_of_a_zip_with_all_that_belongs_to_it(
    tmp_path: Path,
) -> None:
    plain = write(tmp_path / "a.shp", HOUSES, "ESRI Shapefile", crs="EPSG:4258")
    parts = {f"x/A{side}": plain.with_suffix(side).read_bytes() for side in SIDES}
    found = read_footprints(zipped(tmp_path / "a.zip", **parts))
    assert found.columns["height"].tolist() == [3.5, 4.5]
    assert found.crs == "EPSG:4258"
    parts.pop("x/A.prj")
    with pytest.raises(InputError, match=r"b\.zip: says no CRS; .*--crs"):
        read_footprints(zipped(tmp_path / "b.zip", **parts))


def test_a_copy_out_of_a_zip_is_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    archive = zipped(tmp_path / "a.zip", a__geojson=ONE)
    read_footprints(archive)
    zipped(archive, a__geojson=ONE[:40])
    with pytest.raises(InputError, match=r"a\.zip: can't be read"):
        read_footprints(archive)
    assert list(tmp_path.iterdir()) == [archive]


def test_odd_zips_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpacking, "SLACK_BYTES", 1 << 20)
    cases = {
        "without a vector file": zipped(tmp_path / "none.zip", a__txt="x"),
        "2 vector files in it .a.json, b.csv": zipped(
            tmp_path / "two.zip", a__json=ONE, b__csv=TABLE
        ),
        "a zip file; unpack it": zipped(
            tmp_path / "nest.zip",
            a__gpkg=zipped(tmp_path / "x.zip", a__json=ONE).read_bytes(),
        ),
        "more than 300 times": zipped(tmp_path / "bomb.zip", a__json=b" " * (3 << 20)),
        "empty file": zipped(tmp_path / "empty.zip", a__json=b"  "),
    }
    whole = (tmp_path / "x.zip").read_bytes()
    for name, body in (("cut", whole[:-9]), ("odd", whole[:45] + b"\xff" * 9 + whole[54:])):
        path = tmp_path / f"{name}.zip"
        path.write_bytes(body)
        with pytest.raises(InputError, match="broken ZIP"):
            read_footprints(path)
    for reason, path in cases.items():
        with pytest.raises(InputError, match=reason) as caught:
            read_footprints(path)
        assert "\n" not in str(caught.value)


def test_a_gzip_bomb_ends_within_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacking, "SLACK_BYTES", 1 << 20)
    path = tmp_path / "bomb.geojson.gz"
    text = b'{"type": "FeatureCollection", "features": [' + b" " * (3 << 20)
    path.write_bytes(gzip.compress(text))
    with pytest.raises(InputError, match="unpacks to more than 300 times its size"):
        read_footprints(path)
    monkeypatch.setattr(unpacking, "MAX_RATIO", 2000)
    with pytest.raises(InputError, match="ends too early"):
        read_footprints(path)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b"BZh91AY", "a bzip2 file; unpack it"),
        (b"7z\xbc\xaf\x27\x1c", "a 7-Zip file"),
        (gzip.compress(b"SQLite format 3\0" + bytes(52) + b"GP10"), "a gzip of GeoPackage"),
        (gzip.compress(b"words"), "gzip of what is not a GeoPackage"),
        (gzip.compress(b""), "empty file"),
        (gzip.compress(ONE.encode())[:-9], "can't be read"),
    ],
)
def test_other_packings_are_refused(tmp_path: Path, body: bytes, reason: str) -> None:
    path = tmp_path / "a.geojson"
    path.write_bytes(body)
    with pytest.raises(InputError, match=reason):
        read_footprints(path)


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder; name a file"):
        read_footprints(tmp_path)
