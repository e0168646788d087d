# SPDX-License-Identifier: Apache-2.0
"""Reading footprints: every format gives the same polygons, every bad file one line."""

import gzip
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio.raw
import pyproj
import pytest
import shapely

from ingest.footprints import read_parts
from tests.ingest.reading import read_footprints
from tiles.errors import InputError

HOUSES = [
    shapely.box(7.42, 43.73, 7.4202, 43.7301),
    shapely.Polygon(
        [(7.43, 43.73), (7.431, 43.73), (7.431, 43.731), (7.43, 43.731)],
        [[(7.4303, 43.7303), (7.4306, 43.7303), (7.4306, 43.7306)]],
    ),
]
SUFFIX = {
    "GPKG": ".gpkg",
    "GeoJSON": ".geojson",
    "GeoJSONSeq": ".geojsonl",
    "FlatGeobuf": ".fgb",
    "ESRI Shapefile": ".shp",
}


def write(path: Path, shapes: list[Any], driver: str, **options: str | bool) -> Path:
    kind = options.pop("geometry_type", "Polygon")
    crs = options.pop("crs", "EPSG:4326")
    height = np.arange(len(shapes)) + 3.5
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.array(shapes, object)),
        [height],
        ["height"],
        driver=driver,
        geometry_type=kind,
        crs=crs,
        **options,
    )
    return path


def collection(*geometries: dict[str, Any] | None) -> str:
    features = [{"type": "Feature", "properties": {}, "geometry": g} for g in geometries]
    return json.dumps({"type": "FeatureCollection", "features": features})


@pytest.mark.parametrize("driver", SUFFIX)
def test_every_format_gives_the_same_polygons_and_attributes(
    tmp_path: Path, driver: str
) -> None:
    read = read_footprints(write(tmp_path / f"city{SUFFIX[driver]}", HOUSES, driver))
    order = np.argsort(read.columns["height"])  # FlatGeobuf sorts by place
    pairs = zip(read.geometry[order], HOUSES, strict=True)
    same = [a.normalize().equals_exact(b.normalize(), 1e-7) for a, b in pairs]
    assert all(same)
    assert read.columns["height"][order].tolist() == [3.5, 4.5]
    assert len(set(read.feature.tolist())) == 2


def test_a_compressed_geojson_is_read(tmp_path: Path) -> None:
    plain = write(tmp_path / "a.geojson", HOUSES, "GeoJSON")
    packed = tmp_path / "a.geojson.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    assert len(read_footprints(packed).geometry) == 2


def test_projected_coordinates_become_degrees(tmp_path: Path) -> None:
    turn = pyproj.Transformer.from_crs(4326, 32632, always_xy=True)
    metres = shapely.transform(HOUSES[0], turn.transform, interleaved=False)
    path = write(tmp_path / "utm.gpkg", [metres], "GPKG", crs="EPSG:32632")
    assert read_footprints(path).geometry[0].equals_exact(HOUSES[0], 1e-9)


def test_a_named_crs_overrides_the_files(tmp_path: Path) -> None:
    turn = pyproj.Transformer.from_crs(4326, 3857, always_xy=True)
    metres = shapely.transform(HOUSES[0], turn.transform, interleaved=False)
    path = write(tmp_path / "mislabelled.fgb", [metres], "FlatGeobuf")
    with pytest.raises(InputError, match=r"outside longitude.*--crs"):
        read_footprints(path)
    read = read_footprints(path, crs="EPSG:3857")
    assert read.geometry[0].equals_exact(HOUSES[0], 1e-9)


def test_a_file_without_crs_needs_one(tmp_path: Path) -> None:
    path = write(tmp_path / "a.shp", HOUSES, "ESRI Shapefile")
    path.with_suffix(".prj").unlink()
    with pytest.raises(InputError, match=r"a\.shp: says no CRS; .*--crs"):
        read_footprints(path)
    assert len(read_footprints(path, crs="EPSG:4326").geometry) == 2
    with pytest.raises(InputError, match="unknown CRS 'EPSG:nonsense'"):
        read_footprints(path, crs="EPSG:nonsense")


@pytest.mark.parametrize("driver", SUFFIX)
def test_parts_of_a_file_are_the_file(tmp_path: Path, driver: str) -> None:
    shapes = [shapely.box(7 + k / 1000, 43, 7.0005 + k / 1000, 43.0005) for k in range(23)]
    path = write(tmp_path / f"row{SUFFIX[driver]}", shapes, driver)
    parts = list(read_parts(path, at_most=5))
    assert [len(part.feature) for part in parts] == [5, 5, 5, 5, 3]
    whole = read_footprints(path)
    assert np.concatenate([part.feature for part in parts]).tolist() == list(whole.feature)
    heights = np.concatenate([part.columns["height"] for part in parts])
    assert sorted(heights.tolist()) == [k + 3.5 for k in range(23)]
    order = np.argsort(heights)
    west = np.concatenate([shapely.bounds(part.geometry)[:, 0] for part in parts])[order]
    np.testing.assert_allclose(west, 7 + np.arange(23) / 1000, atol=1e-9)


def test_a_field_of_the_first_part_is_in_every_part(tmp_path: Path) -> None:
    features = [
        {"type": "Feature", "properties": {name: 5}, "geometry": SQUARE}
        for name in ("height", "name", "floors")
    ]
    path = tmp_path / "sparse.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    found = [part.columns for part in read_parts(path, at_most=1)]
    assert [list(columns) for columns in found] == [
        ["height"],
        ["name", "height"],
        ["floors", "height", "name"],
    ]
    assert found[2]["height"].tolist() == [None]


def test_a_layer_called_buildings_is_taken_before_others(tmp_path: Path) -> None:
    path = tmp_path / "town.gpkg"
    write(path, HOUSES, "GPKG", layer="restaurants")
    write(path, HOUSES, "GPKG", layer="Buildings_2020", append=True)
    assert read_footprints(path).layer == "Buildings_2020"


def test_a_city_model_is_left_to_its_own_reader(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text('{"type": "CityJSON", "version": "2.0", "CityObjects": {}}')
    with pytest.raises(InputError, match=r"model\.json: ") as caught:
        read_footprints(path)
    assert "not GeoJSON" not in str(caught.value)


def test_heights_of_corners_are_dropped_with_a_word(tmp_path: Path) -> None:
    high = [shapely.force_3d(house, 12.0) for house in HOUSES]
    for driver in ("GPKG", "GeoJSON"):
        path = tmp_path / f"high{SUFFIX[driver]}"
        write(path, high, driver, geometry_type="Polygon Z")
        read = read_footprints(path)
        assert not shapely.has_z(read.geometry).any()
        assert read.geometry[0].normalize().equals_exact(HOUSES[0].normalize(), 1e-7)
        assert "heights in the coordinates" in read.warnings[0]


def test_text_that_is_no_utf8_is_read_with_a_word(tmp_path: Path) -> None:
    path = write(tmp_path / "old.shp", HOUSES, "ESRI Shapefile", encoding="ISO-8859-1")
    words = np.array(["Caf\u00e9", "x"], object)
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.array(HOUSES, object)),
        [words],
        ["name"],
        driver="ESRI Shapefile",
        geometry_type="Polygon",
        crs="EPSG:4326",
        encoding="ISO-8859-1",
    )
    assert read_footprints(path).columns["name"].tolist() == ["Caf\u00e9", "x"]
    path.with_suffix(".cpg").write_text("UTF-8")
    read = read_footprints(path)
    assert read.columns["name"].tolist() == ["Caf\u00e9", "x"]
    assert "ISO-8859-1" in read.warnings[0]


def test_the_first_polygon_layer_is_taken_and_an_unknown_one_named(tmp_path: Path) -> None:
    path = tmp_path / "layers.gpkg"
    points = [shapely.Point(7.4, 43.7)]
    write(path, points, "GPKG", layer="trees", geometry_type="Point")
    write(path, HOUSES, "GPKG", layer="huts", append=True)
    write(path, HOUSES[:1], "GPKG", layer="sheds", append=True)
    read = read_footprints(path)
    assert (read.layer, len(read.geometry)) == ("huts", 2)
    assert "sheds" in read.warnings[0]
    assert read_footprints(path, layer="sheds").layer == "sheds"
    with pytest.raises(
        InputError, match="no layer named roads; the layers are: trees, huts"
    ):
        read_footprints(path, layer="roads")
    with pytest.raises(InputError, match="a vector without polygons"):
        read_footprints(path, layer="trees")


SQUARE = {"type": "Polygon", "coordinates": [[[1, 2], [1.1, 2], [1.1, 2.1], [1, 2]]]}
WHOLE = collection(*[SQUARE] * 900).encode() + bytes(range(256))

BAD = {
    "nothing.geojson": (b"", "empty file"),
    "words.geojson": (b"a line of words\n", "not a GeoPackage"),
    "broken.geojson": (b'{"type": "FeatureCollection", "features": [', "can't be read"),
    "other.geojson": (b'{"type": "Spam"}', "can't be read|without polygons"),
    "none.geojson": (collection().encode(), "no features"),
    "null.geojson": (collection(None).encode(), "without polygons"),
    "line.geojson": (
        collection({"type": "LineString", "coordinates": [[1, 2], [3, 4]]}).encode(),
        "without polygons",
    ),
    "cut.geojson.gz": (gzip.compress(WHOLE)[:-40], "can't be read"),
    "csv.gz": (gzip.compress(b"a,b\n1,2\n"), "gzip of what is not a GeoPackage"),
    "fake.gpkg": (b"SQLite format 3\0" + bytes(84), "not a GeoPackage"),
    "cut.fgb": (b"fgb\x03fgb\x01" + bytes(40), "can't be read"),
    "disguised.geojson": (
        b"<OGRVRTDataSource><OGRVRTLayer name='x'/></OGRVRTDataSource>",
        "not a GeoPackage",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_in_one_line_that_names_it(tmp_path: Path, name: str) -> None:
    body, reason = BAD[name]
    path = tmp_path / name
    path.write_bytes(body)
    with pytest.raises(InputError, match=reason) as caught:
        read_footprints(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert ";" in str(caught.value)


def test_a_missing_file_and_a_zip_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_footprints(tmp_path / "absent.gpkg")
    path = tmp_path / "shapes.gpkg"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.txt", "x")
    with pytest.raises(InputError, match="a ZIP file without a vector file"):
        read_footprints(path)
