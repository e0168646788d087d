# SPDX-License-Identifier: Apache-2.0
"""`geopage ingest` and `remove`: what can't be used is refused in one line, exit code 2."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp

from geopage.cli import main
from ingest.cli import Bars
from ingest.terrain import ingest_rasters
from tests.ingest.rasters import EGM96, coarse, hills, north_up, write
from tiles.errors import InputError, is_interrupt
from tiles.lanes import Lane
from tiles.store import Store
from tiles.writer import make_store

WHERE = north_up(11.0, 46.5, 0.01)
POSTS = hills((20, 20), 1.0, 100.0)
Make = Callable[[Path], Path]


def dem(path: Path) -> Path:
    return write(path, POSTS, WHERE, "EPSG:4326")


def all_nodata(path: Path) -> Path:
    return write(path, np.full((9, 9), -5, np.int16), WHERE, "EPSG:4326", -5)


def all_nan(path: Path) -> Path:
    return write(path, np.full((9, 9), np.nan, np.float32), WHERE, "EPSG:4326")


def rgb(path: Path) -> Path:
    return write(path, np.zeros((3, 9, 9), np.uint8), WHERE, "EPSG:4326")


def rgb16(path: Path) -> Path:
    posts = np.zeros((3, 9, 9), np.uint16)
    return write(path, posts, WHERE, "EPSG:4326", colorinterp=COLOURS)


def palette(path: Path) -> Path:
    write(path, np.zeros((9, 9), np.uint8), WHERE, "EPSG:4326")
    with rasterio.open(path, "r+") as out:
        out.write_colormap(1, {0: (255, 0, 0, 255)})
    return path


def disguised_vrt(path: Path) -> Path:
    inner = dem(path.with_name("inner.tif"))
    path.write_text(
        '<VRTDataset rasterXSize="20" rasterYSize="20"><SRS>EPSG:4326</SRS>'
        "<GeoTransform>11,0.01,0,46.5,0,-0.01</GeoTransform>"
        '<VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
        f"<SourceFilename>{inner}</SourceFilename><SourceBand>1</SourceBand>"
        "</SimpleSource></VRTRasterBand></VRTDataset>"
    )
    return path


def text(path: Path) -> Path:
    path.write_text("this is no raster\n" * 50)
    return path


def truncated(path: Path) -> Path:
    raw = dem(path).read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    return path


def points(path: Path) -> Path:
    feature = {
        "type": "Feature",
        "properties": {"h": 3},
        "geometry": {"type": "Point", "coordinates": [11, 46]},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


def squares(path: Path) -> Path:
    ring = [[11, 46], [11.001, 46], [11.001, 46.001], [11, 46.001], [11, 46]]
    feature = {
        "type": "Feature",
        "properties": {"h": 3},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


COLOURS = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
DATUM = ("--datum", "egm96")
REFUSED: list[tuple[str, str, Make | None, tuple[str, ...], str]] = [
    ("terrain", "missing.tif", None, DATUM, "no such file"),
    (
        "terrain",
        "a.tif",
        lambda p: write(p, POSTS, WHERE, None),
        DATUM,
        "has no CRS; .*--crs",
    ),
    (
        "terrain",
        "a.tif",
        lambda p: write(p, POSTS, None, "EPSG:4326"),
        DATUM,
        "no georeference",
    ),
    ("terrain", "a.tif", dem, ("--crs", "EPSG:999999", *DATUM), "unknown CRS"),
    ("terrain", "a.tif", all_nodata, DATUM, "holds no data"),
    ("terrain", "a.tif", all_nan, DATUM, "holds no data"),
    ("terrain", "a.tif", dem, (), "vertical datum not known; .*--datum"),
    ("terrain", "a.tif", dem, ("--datum", "egm2008"), "no grid for vertical datum egm2008"),
    ("terrain", "a.tif", dem, ("--datum", "moon"), "unknown vertical datum"),
    ("terrain", "a.tif", rgb, DATUM, "is a picture; use .*imagery"),
    ("terrain", "a.tif", palette, DATUM, "palette"),
    ("terrain", "a.tif", disguised_vrt, DATUM, "can't be read as a raster"),
    ("terrain", "a.tif", text, DATUM, "can't be read as a raster"),
    ("terrain", "a.tif", truncated, DATUM, "can't be read as a raster"),
    ("terrain", "a.hgt", text, DATUM, "can't be read as a raster"),
    ("terrain", "a.zip", text, DATUM, "can't be read as a raster"),
    ("terrain", "a.tif", lambda p: p.mkdir() or p, DATUM, "is a folder"),
    ("terrain", "a.geojson", squares, DATUM, "not a raster; use .*buildings"),
    ("buildings", "a.tif", dem, (), "a raster.*; use .*terrain"),
    ("buildings", "a.geojson", lambda p: p.mkdir() or p, (), "is a folder"),
    ("imagery", "a.tif", dem, (), "is not an RGB picture; use .*terrain"),
    ("imagery", "a.tif", rgb16, (), "uint16 colours"),
    ("buildings", "a.geojson", points, (), "polygon"),
    ("buildings", "a.geojson", squares, ("--height", "storeys"), "storeys"),
    ("buildings", "missing.geojson", None, (), "no such file"),
]


def refuse(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must end with 2, one line on stderr and nothing on stdout."""
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1, err
    assert err.startswith("geopage: ")
    return err


@pytest.mark.parametrize("fresh", ["--bare", "earth", "existing"])
@pytest.mark.parametrize(("kind", "name", "make", "options", "says"), REFUSED)
def test_bad_input_is_refused_and_nothing_is_left(  # noqa: PLR0913 - a table of cases
    fresh: str,
    kind: str,
    name: str,
    make: Make | None,
    options: tuple[str, ...],
    says: str,
    tmp_path: Path,
    nested_folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source, store = tmp_path / name, tmp_path / "world.geopage"
    if make:
        make(source)
    if fresh == "existing":
        store.write_bytes((nested_folder / "world.geopage").read_bytes())
    held = sorted(tmp_path.iterdir())
    bare = ["--bare"] if fresh == "--bare" else []
    before = seen(store)
    error = refuse(["ingest", kind, str(store), str(source), *options, *bare], capsys)
    assert str(source) in error
    assert re.search(says, error), error
    assert seen(store) == before
    if fresh != "existing":
        assert sorted(tmp_path.iterdir()) == held


def seen(path: Path) -> object:
    """What readers see of a store."""
    if not path.exists():
        return None
    with Store(path) as store:
        return [store.index(lane).tobytes() for lane in Lane], store.sources()


def test_a_refused_ingest_leaves_a_store_that_another_command_made_meanwhile(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "a.geopage"

    def refuse(*_: object) -> None:
        make_store(store)
        raise InputError("dem.tif", "has no CRS", "name it with --crs")

    monkeypatch.setattr("ingest.cli.ingest_rasters", refuse)
    words = ["ingest", "terrain", "--bare", str(store), str(dem(tmp_path / "dem.tif"))]
    assert main(words) == 2
    assert "has no CRS" in capsys.readouterr().err
    assert store.exists()


@pytest.mark.parametrize("content", [b"", b"junk" * 100, None])
def test_a_file_that_is_no_store_stays_as_it_is(
    content: bytes | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, store = dem(tmp_path / "a.tif"), tmp_path / "world.geopage"
    if content is None:
        store.mkdir()
    else:
        store.write_bytes(content)
    error = refuse(["ingest", "terrain", str(store), str(source), *DATUM], capsys)
    assert str(store) in error
    assert store.is_dir() if content is None else store.read_bytes() == content


def test_a_folder_that_does_not_exist_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, store = dem(tmp_path / "a.tif"), tmp_path / "no" / "world.geopage"
    error = refuse(["ingest", "terrain", str(store), str(source), *DATUM], capsys)
    assert "folder does not exist" in error


@pytest.mark.parametrize(
    "words",
    [
        ["ingest"],
        ["ingest", "clouds", "a", "b"],
        ["ingest", "terrain", "a.geopage"],
        ["ingest", "terrain", "a.geopage", "b.tif", "--dtum", "x"],
        ["ingest", "buildings", "a.geopage", "b.gpkg", "--units", "miles"],
        ["remove"],
    ],
)
def test_a_wrong_command_line_is_one_line(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1


def test_json_is_one_object_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    store = str(tmp_path / "world.geopage")
    words = ["ingest", "terrain", store, str(dem(tmp_path / "a.tif")), *DATUM, "--bare"]
    assert main([*words, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["read"] == report["stored"] + report["merged"] + report["skipped"] == 400
    (source,) = report["sources"]
    assert (source["name"], source["datum"], source["datum_from"]) == (
        "a",
        "egm96",
        "stated",
    )
    assert source["datum_here"].startswith("egm96: heights are 49.5 to 49.7 m above")
    assert source["reach_m"] == 10 * source["spacing_m"]
    assert source["meets"] == "", "the sea level: the store holds nothing else"
    assert report["posts_per_s"] > 0
    assert set(report["seconds_by_stage"]) >= {"read", "mesh", "swap"}
    assert report["tiles"] >= 32
    assert main(["remove", store, "a", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["removed"] == "a"


def test_remove_names_what_there_is(
    nested_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(nested_folder / "world.geopage")
    error = refuse(["remove", store, "alps"], capsys)
    assert "has no source 'alps'; it has coarse, inset" in error
    assert "no such store" in refuse(["remove", f"{store}x", "alps"], capsys)


def test_buildings_on_a_bare_store_and_away_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(tmp_path / "town.geopage")
    source = str(squares(tmp_path / "town.geojson"))
    assert main(["ingest", "buildings", store, source, "--height", "h", "--bare"]) == 0
    assert main(["remove", store, "town"]) == 0
    assert main(["check", store]) == 0
    with Store(store) as opened:
        assert opened.object_count() == 0
        assert opened.sources() == []
    capsys.readouterr()


def test_strict_is_1_when_a_footprint_was_skipped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    town = squares(tmp_path / "town.geojson")
    words = ["ingest", "buildings", str(tmp_path / "a.geopage"), str(town), "--bare"]
    assert main([*words, "--strict", "--height", "h"]) == 0
    data = json.loads(town.read_text())
    data["features"].append({"type": "Feature", "properties": {}, "geometry": None})
    town.write_text(json.dumps(data))
    assert main([*words, "--height", "h"]) == 0
    assert main([*words, "--strict", "--height", "h", "--json"]) == 1
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["skipped_by_reason"] == {"no geometry": 1}
    assert report["read"] == report["stored"] + report["merged"] + report["skipped"]


def test_an_interrupted_ingest_of_buildings_leaves_the_store_as_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    store, town = str(tmp_path / "a.geopage"), str(squares(tmp_path / "town.geojson"))
    words = ["ingest", "buildings", store, town, "--height", "h", "--bare"]
    assert main(words) == 0
    with Store(store) as opened:
        before = list(opened.connection.iterdump())

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("ingest.object_branches.make_branch", interrupt)
        assert main(words) == 130
    assert capsys.readouterr().err.endswith("run the same command again to go on\n")
    with Store(store) as opened:
        assert list(opened.connection.iterdump()) == before
    assert main(words) == 0


def test_what_interrupts_compiled_code_is_an_interrupt() -> None:
    inner, outer = SystemError("returned a result"), SystemError("with an exception set")
    outer.__cause__, inner.__cause__ = inner, KeyboardInterrupt()
    assert is_interrupt(KeyboardInterrupt())
    assert is_interrupt(outer)
    assert not is_interrupt(SystemError("a fault of its own"))


def test_the_report_says_where_buildings_lie(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    town = squares(tmp_path / "town.geojson")
    words = ["ingest", "buildings", str(tmp_path / "a.geopage"), str(town), "--bare"]
    assert main([*words, "--height", "h", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["lies_at_deg"]
    outline = [one["geometry"] for one in json.loads(town.read_text())["features"]]
    lon, lat = np.array(outline[0]["coordinates"][0])[:4].mean(axis=0)
    assert found["west"] == found["east"] == pytest.approx(lon)
    assert found["south"] == found["north"] == pytest.approx(lat)


@pytest.mark.parametrize("height", ["0", "-3", "nan", "tall", "1e6"])
def test_a_default_height_that_is_none_is_refused(
    height: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["ingest", "buildings", str(tmp_path / "a.geopage"), "town.geojson"]
    assert main([*words, f"--default-height={height}"]) == 2
    assert "expected metres above 0" in capsys.readouterr().err


def test_files_on_a_fresh_store_are_checked_before_the_earth_is_meshed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ingest.cli_buildings.ingest_rasters", pytest.fail)
    good, bad = squares(tmp_path / "town.geojson"), tmp_path / "bad.geojson"
    bad.write_text('{"type": "FeatureCollection", "features": []}')
    words = ["ingest", "buildings", str(tmp_path / "a.geopage"), str(good), str(bad)]
    assert main(words) == 2
    assert "bad.geojson" in capsys.readouterr().err
    assert not (tmp_path / "a.geopage").exists()


def test_terrain_under_buildings_grounds_them_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    store = tmp_path / "town.geopage"
    town = str(squares(tmp_path / "town.geojson"))
    assert main(["ingest", "buildings", str(store), town, "--height", "h", "--bare"]) == 0
    ingest_rasters(store, [(coarse(tmp_path / "coarse.tif"), EGM96)], workers=1)
    dem_path = write(
        tmp_path / "flat.tif",
        np.full((20, 20), 500, np.int16),
        north_up(10.9, 46.1, 0.01),
        "EPSG:4326",
    )
    assert (
        main(["ingest", "terrain", str(store), str(dem_path), "--datum", "ellipsoid"]) == 0
    )
    with Store(store) as opened:
        (base,) = (one["base_m"] for one in opened.objects([1]))
    # Walls reach below the coarser cells that they are drawn with, too.
    assert base == pytest.approx(500, abs=10)
    capsys.readouterr()


def test_a_removal_broken_off_before_buildings_are_grounded_goes_on_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    store = tmp_path / "town.geopage"
    ingest_rasters(store, [(coarse(tmp_path / "coarse.tif"), EGM96)], workers=1)
    town = str(squares(tmp_path / "town.geojson"))
    assert main(["ingest", "buildings", str(store), town, "--height", "h"]) == 0

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("ingest.cli.reground", stop)
        assert main(["remove", str(store), "coarse"]) == 130
    assert main(["remove", str(store), "coarse"]) == 0
    with Store(store) as opened:
        (base,) = (one["base_m"] for one in opened.objects([1]))
    assert base < 100, "not where the mountain was"
    capsys.readouterr()
    assert "has no source 'coarse'" in refuse(["remove", str(store), "coarse"], capsys)


def test_bars_say_posts_and_tiles_a_second(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ingest.cli.QUIET_S", 0.0)
    bars = Bars()
    for what in ("reading alps", "meshing terrain", "grounded"):
        for done in (1, 2):
            bars(done, 2, what)
    bars.close()
    shown = capsys.readouterr().err
    for text in ("reading alps: 100%", " posts/s", "meshing terrain: 100%", " tiles/s"):
        assert text in shown
