# SPDX-License-Identifier: Apache-2.0
"""Awkward rasters: each is handled right, or refused in one line before it is read."""

import os
import re
import resource
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import pytest
import rasterio
from rasterio import shutil as rasterio_shutil
from rasterio.errors import NotGeoreferencedWarning
from rasterio.transform import Affine

from geopage.cli import main
from ingest.mosaic import Mosaic
from ingest.raster_plan import RasterOptions, plan, plan_all, said_of
from ingest.terrain import copy, editing
from tests.ingest.rasters import (
    EGM96,
    Floats,
    geoid_m,
    hills,
    north_up,
    source_height_m,
    write,
)
from tiles.check import faults_of
from tiles.errors import InputError
from tiles.store import Store
from tiles.surface import Surface

POSTS = hills((40, 60), 1.0, 200.0)
WHERE = north_up(11.0, 46.5, 0.01)
ELLIPSOID = RasterOptions(datum="ellipsoid")
Make = Callable[[Path], Path]


def rotated(path: Path) -> Path:
    where = Affine(80.0, 60.0, 6.2e5, 60.0, -80.0, 5.1e6)
    return write(path, POSTS, where, "EPSG:32632")


def rotated_degrees(path: Path) -> Path:
    return write(path, POSTS, Affine(8e-3, 6e-3, 11.0, 6e-3, -8e-3, 46.5), "EPSG:4326")


def degrees_called_metres(path: Path) -> Path:
    return write(path, POSTS, WHERE, "EPSG:32632")


def south_up(path: Path) -> Path:
    return write(path, POSTS, Affine(0.01, 0.0, 11.0, 0.0, 0.01, 46.0), "EPSG:4326")


def east_to_west(path: Path) -> Path:
    return write(path, POSTS, Affine(-0.01, 0.0, 11.9, 0.0, -0.01, 46.5), "EPSG:4326")


def turned_globe(path: Path) -> Path:
    """0 to 360 degrees."""
    return write(path, hills((36, 72), 1.0, 200.0), north_up(0, 90, 5), "EPSG:4326")


def beyond_180(path: Path) -> Path:
    return write(path, POSTS, north_up(179.7, 10.0, 0.01), "EPSG:4326")


def before_180(path: Path) -> Path:
    return write(path, POSTS, north_up(-180.3, 10.0, 0.01), "EPSG:4326")


def over_the_antimeridian(path: Path) -> Path:
    return write(path, POSTS, north_up(3.31e6, 2e6, 2000.0), "EPSG:3832")


def over_the_pole(path: Path) -> Path:
    return write(path, POSTS, north_up(-1.4e5, 1.1e5, 5000.0), "EPSG:3413")


def feet(path: Path) -> Path:
    write(path, POSTS / np.float32(0.3048), WHERE, "EPSG:4326")
    with rasterio.open(path, "r+") as out:
        out.units = ("ft",)
    return path


def scaled(path: Path) -> Path:
    write(path, (POSTS * 10).astype(np.int16), WHERE, "EPSG:4326")
    with rasterio.open(path, "r+") as out:
        out.scales, out.offsets = (0.1,), (5.0,)
    return path


METRES = {feet: (0.3048, 0.0), scaled: (0.1, 5.0)}


@pytest.mark.parametrize(
    "make",
    [rotated, rotated_degrees, south_up, east_to_west, turned_globe, beyond_180,
     before_180, over_the_antimeridian, over_the_pole, feet, scaled],
)  # fmt: skip
def test_heights_are_the_files_wherever_its_posts_are(
    make: Make, tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Along the earth, as here; flat triangles have a test of their own.
    monkeypatch.setattr("ingest.layer.CURVED_M", np.inf)
    path = make(tmp_path / "a.tif")
    lon, lat, truth = truth_of(path, rng)
    scale, offset = METRES.get(make, (1.0, 0.0))
    with editing(tmp_path / "a.geopage") as writer:
        source = copy(writer, plan(path, ELLIPSOID), lambda done, total, what: None)
        mosaic = Mosaic(writer.connection, [source])
        found = mosaic.heights(np.radians(lon), np.radians(lat), 0.0)
    np.testing.assert_allclose(found, truth * scale + offset, atol=2e-2)


def truth_of(path: Path, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Return 200 places in a file, and what its own triangles say there."""
    with rasterio.open(path) as dataset:
        a, b, c, d, e, f = tuple(dataset.transform)[:6]
        col = rng.uniform(1, dataset.width - 1, 200)
        row = rng.uniform(1, dataset.height - 1, 200)
        x, y = a * col + b * row + c, d * col + e * row + f
        lon, lat = rasterio.warp.transform(dataset.crs, "EPSG:4326", x, y)
    return np.array(lon), np.array(lat), source_height_m(path, np.array(lon), np.array(lat))


@pytest.mark.parametrize("filler", [-9999.0, -32768.0, -32767.0, -3.4028235e38, np.nan])
def test_what_stands_for_no_data_is_no_data_also_undeclared(
    filler: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    posts = POSTS.copy()
    posts[10:20, 10:30] = filler
    path = write(tmp_path / "a.tif", posts, WHERE, "EPSG:4326")
    with editing(tmp_path / "a.geopage") as writer:
        source = copy(writer, plan(path, EGM96), lambda done, total, what: None)
    why = "no data" if np.isnan(filler) else "no data, not declared"
    assert source["posts"] == {"stored": 2200, "skipped": {why: 200}}
    capsys.readouterr()


def test_strict_minds_only_what_the_file_does_not_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    posts = POSTS.copy()
    posts[10:20, 10:30] = -9999.0
    ends = []
    for k, nodata in enumerate((-9999.0, None)):
        path = write(tmp_path / f"{k}.tif", posts, WHERE, "EPSG:4326", nodata)
        store = str(tmp_path / f"{k}.geopage")
        words = ["ingest", "terrain", store, str(path), "--datum", "egm96", "--bare"]
        ends.append(main([*words, "--strict"]))
    assert ends == [0, 1]
    assert capsys.readouterr().out.count("skipped: 200\n") == 2


def one_row(path: Path) -> Path:
    return write(path, POSTS[:1], WHERE, "EPSG:4326")


def one_pixel(path: Path) -> Path:
    return write(path, POSTS[:1, :1], WHERE, "EPSG:4326")


def no_area(path: Path) -> Path:
    return write(path, POSTS, Affine(0.01, 0.0, 11.0, 0.01, 0.0, 46.5), "EPSG:4326")


def metres_as_degrees(path: Path) -> Path:
    return write(path, POSTS, north_up(6.2e5, 5.1e6, 80.0), "EPSG:4326")


def off_the_map(path: Path) -> Path:
    return write(path, POSTS, north_up(6.2e12, 5.1e12, 80.0), "EPSG:32632")


def no_map(path: Path) -> Path:
    crs = 'LOCAL_CS["site",UNIT["metre",1]]'
    return write(path, POSTS, north_up(0, 0, 1.0), crs)


def control_points(path: Path) -> Path:
    write(path, POSTS, None, None)
    corner = rasterio.control.GroundControlPoint
    corners = [
        corner(r, c, 11 + c / 100, 46 - r / 100) for r, c in ((0, 0), (0, 9), (9, 0))
    ]
    with catch_warnings():
        simplefilter("ignore", NotGeoreferencedWarning)
        out = rasterio.open(path, "r+")
    with out:
        out.gcps = corners, rasterio.crs.CRS.from_epsg(4326)
    return path


def camera(path: Path) -> Path:
    write(path, POSTS, None, None)
    numbers = dict.fromkeys(("height_off", "lat_off", "line_off", "long_off"), 1.0)
    numbers |= dict.fromkeys(("height_scale", "lat_scale", "line_scale"), 1.0)
    numbers |= dict.fromkeys(("long_scale", "samp_off", "samp_scale"), 1.0)
    rows = {f"{one}_coeff": [1.0] * 20 for one in ("line_num", "line_den")}
    rows |= {f"{one}_coeff": [1.0] * 20 for one in ("samp_num", "samp_den")}
    with catch_warnings():
        simplefilter("ignore", NotGeoreferencedWarning)
        out = rasterio.open(path, "r+")
    with out:
        out.rpcs = rasterio.rpc.RPC(**numbers, **rows)
    return path


def kelvin(path: Path) -> Path:
    write(path, POSTS, WHERE, "EPSG:4326")
    with rasterio.open(path, "r+") as out:
        out.units = ("K",)
    return path


def bomb(path: Path) -> Path:
    """One strip of 20,000 x 20,000 posts in 2 kB."""
    return sparse(path, 20_000, 20_000, blockysize=20_000, compress="deflate")


def all_but_empty(path: Path) -> Path:
    return sparse(path, 400_000, 200_000, tiled=True, blockxsize=4096, blockysize=4096)


def sparse(path: Path, width: int, height: int, **more: Any) -> Path:
    profile = {"driver": "GTiff", "width": width, "height": height, "count": 1}
    profile |= {"dtype": "float32", "crs": "EPSG:4326", "sparse_ok": True, **more}
    step = 100.0 / width
    with rasterio.open(path, "w", **profile, transform=north_up(1, 50, step)):
        pass
    return path


def bomb_in_a_vrt(path: Path) -> Path:
    return made_of(bomb(path.with_name("inner.tif")), path.with_suffix(".vrt"))


def bomb_by_another_name(path: Path) -> Path:
    return made_of(bomb(path.with_name("inner.dat")), path.with_suffix(".vrt"))


def bomb_deep_in_vrts(path: Path) -> Path:
    return made_of(bomb_by_another_name(path), path.with_name("outer.vrt"))


def vast_vrt(path: Path) -> Path:
    inner = write(path.with_name("inner.tif"), POSTS, WHERE, "EPSG:4326")
    path = made_of(inner, path.with_suffix(".vrt"))
    vast = path.read_text().replace("20000", "2000000").replace("0.001", "0.00001")
    path.write_text(vast)
    return path


def vrt_of_itself(path: Path) -> Path:
    path = path.with_suffix(".vrt")
    return made_of(path, path)


def vrt_of_what_is_gone(path: Path) -> Path:
    return made_of(path.with_name("gone.tif"), path.with_suffix(".vrt"))


def vrt_of_a_service(path: Path) -> Path:
    service = path.with_name("service.xml")
    service.write_text(
        '<GDAL_WMS><Service name="TMS"><ServerUrl>http://127.0.0.1:9/${z}</ServerUrl>'
        "</Service><DataWindow><SizeX>64</SizeX><SizeY>64</SizeY></DataWindow></GDAL_WMS>"
    )
    return made_of(service, path.with_suffix(".vrt"))


def made_of(inner: Path, path: Path) -> Path:
    path.write_text(
        '<VRTDataset rasterXSize="20000" rasterYSize="20000"><SRS>EPSG:4326</SRS>'
        "<GeoTransform>1,0.001,0,50,0,-0.001</GeoTransform>"
        '<VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
        f"<SourceFilename>{inner}</SourceFilename><SourceBand>1</SourceBand>"
        "</SimpleSource></VRTRasterBand></VRTDataset>"
    )
    return path


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (one_row, "60 x 1 posts, no surface; give at least 2 x 2"),
        (one_pixel, "1 x 1 posts, no surface"),
        (no_area, "georeference that spans no area"),
        (metres_as_degrees, "reaches beyond the earth .* degrees.*; .* --crs"),
        (off_the_map, "reaches beyond its map projection"),
        (no_map, "is no map's; .*--crs"),
        (degrees_called_metres, "numbers look like degrees; .*--crs EPSG:4326"),
        (control_points, "but ground control points; warp it with `gdalwarp -r .*a.tif"),
        (camera, "but a camera's coefficients .RPC.; warp it with `gdalwarp -rpc "),
        (kelvin, "unknown unit 'K'; .*-units m"),
        (bomb, "has blocks of 1525 MiB; .*TILED"),
        (all_but_empty, "all but empty for its 400000 x 200000 posts; .*-projwin"),
        (bomb_in_a_vrt, "has blocks of 1525 MiB; .*TILED"),
        (bomb_by_another_name, "has blocks of 1525 MiB; .*TILED"),
        (bomb_deep_in_vrts, "has blocks of 1525 MiB; .*TILED"),
        (vast_vrt, "all but empty for its 2000000 x 2000000 posts; .*-projwin"),
        (vrt_of_itself, "a VRT of VRTs of VRTs; name the innermost"),
        (vrt_of_what_is_gone, "made of .*gone.tif, which is not there; "),
        (vrt_of_a_service, "made of .*service.xml, which can't be read as a raster"),
    ],
)
def test_what_can_not_be_used_is_refused_before_it_is_read(
    make: Make, says: str, tmp_path: Path
) -> None:
    path = make(tmp_path / "a.tif")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun_s = time.monotonic()
    with pytest.raises(InputError) as refusal:
        plan_all([(path, EGM96)])
    message = str(refusal.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert re.search(says, message), message
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000
    assert time.monotonic() - begun_s < 5


def test_random_bytes_are_refused_in_one_line(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """A small TIFF with one to ten bytes changed: refused, or ingested."""
    path = tmp_path / "a.tif"
    whole = write(path, POSTS, WHERE, "EPSG:4326", compress="deflate").read_bytes()
    refused: list[str] = []
    for _ in range(60):
        raw = bytearray(whole)
        for at in rng.integers(len(raw), size=rng.integers(1, 11)):
            raw[at if rng.random() < 0.3 else at % 400] = rng.integers(256)
        path.write_bytes(raw)
        store = tmp_path / "a.geopage"
        try:
            with editing(store) as writer:
                copy(writer, plan(path, EGM96), lambda done, total, what: None)
        except InputError as error:
            refused.append(str(error))
        store.unlink(missing_ok=True)
    assert len(refused) > 10
    assert all(one.startswith(str(path)) for one in refused)
    assert max(len(one.splitlines()) for one in refused) == 1


@pytest.mark.slow
def test_files_of_all_kinds_in_one_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Degrees, UTM, a zipped HGT and a VRT of two files; the finest wins everywhere."""
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    wide = write(
        tmp_path / "wide.tif", hills((80, 80), 1, 90), north_up(10, 47, 0.02), "EPSG:4326"
    )
    utm = write(
        tmp_path / "utm.tif",
        hills((90, 90), 1, 60),
        north_up(6.2e5, 5.13e6, 50.0),
        "EPSG:32632",
    )
    mosaic = vrt(tmp_path / "mosaic.vrt")
    zipped = hgt(tmp_path / "N45E010.hgt.zip")
    files = [wide, utm, zipped, mosaic]
    store = tmp_path / "world.geopage"
    words = [
        "ingest",
        "terrain",
        str(store),
        *map(str, files),
        "--datum",
        "egm96",
        "--bare",
    ]
    assert main(words) == 0
    out = capsys.readouterr().out
    for name in ("wide", "utm", "N45E010", "mosaic"):
        assert f"source {name}: egm96: heights are " in out
    with Store(store) as opened:
        assert list(faults_of(opened)) == []
        surface = Surface(opened)
        for path, lon, lat in (
            (wide, 10.1, 46.9),
            (utm, 10.57, 46.3),
            (mosaic, 10.205, 46.295),
        ):
            place = np.array([lon]), np.array([lat])
            truth = source_height_m(path, *place) + geoid_m(*place)
            height, error_m = surface.heights(*np.radians(place))
            assert abs(height[0] - truth[0]) <= error_m[0] + 0.01, path


def vrt(path: Path) -> Path:
    """Write two files side by side and what makes one of them."""
    parts = []
    for k in range(2):
        posts = hills((50, 25), 1.0, 50.0) + np.float32(k)
        where = north_up(10.2 + 0.05 * k, 46.3, 0.002)
        parts.append(write(path.with_name(f"part{k}.tif"), posts, where, "EPSG:4326"))
    sources = "".join(
        f'<SimpleSource><SourceFilename relativeToVRT="1">{part.name}</SourceFilename>'
        '<SourceBand>1</SourceBand><SrcRect xOff="0" yOff="0" xSize="25" ySize="50"/>'
        f'<DstRect xOff="{25 * k}" yOff="0" xSize="25" ySize="50"/></SimpleSource>'
        for k, part in enumerate(parts)
    )
    path.write_text(
        '<VRTDataset rasterXSize="50" rasterYSize="50"><SRS>EPSG:4326</SRS>'
        "<GeoTransform>10.2,0.002,0,46.3,0,-0.002</GeoTransform>"
        f'<VRTRasterBand dataType="Float32" band="1">{sources}</VRTRasterBand>'
        "</VRTDataset>"
    )
    return path


def hgt(path: Path) -> Path:
    """Write a zipped tile of SRTM, three seconds, all sea but for one hill."""
    posts = np.full((1201, 1201), -32768, ">i2")
    posts[600:640, 600:640] = 100
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr(path.stem, posts.tobytes())
    return path


def test_a_vrt_is_another_when_one_of_its_files_is(tmp_path: Path) -> None:
    path = vrt(tmp_path / "mosaic.vrt")
    before = plan(path, EGM96)["stamp"]
    assert plan(path, EGM96)["stamp"] == before
    part = tmp_path / "part1.tif"
    part.write_bytes(part.read_bytes() + b"\0")
    assert plan(path, EGM96)["stamp"] != before


@pytest.mark.parametrize("deep", [1, 2])
def test_a_vrt_is_known_by_all_that_it_is_made_of(deep: int, tmp_path: Path) -> None:
    """Also by what the VRTs in it name, which GDAL does not list."""
    path = vrt(tmp_path / "0.vrt")
    for k in range(deep):
        path = made_of(path, tmp_path / f"{k + 1}.vrt")
    stamps = {plan(path, EGM96)["stamp"]}
    for part in ("part0.tif", "part1.tif", "0.vrt"):
        os.utime(tmp_path / part, ns=(1, 1))
        stamps.add(plan(path, EGM96)["stamp"])
    assert len(stamps) == 4
    assert plan(path, EGM96)["stamp"] in stamps


def test_a_datum_that_is_stated_or_found_is_told_apart(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", POSTS, WHERE, "EPSG:4326")
    assert plan(path, EGM96)["datum_from"] == "stated"
    found = plan(path, RasterOptions(crs="EPSG:9707"))
    assert (found["datum"], found["datum_from"]) == ("egm96", "file")


def test_a_stated_datum_that_a_file_contradicts_is_said(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", POSTS, WHERE, "EPSG:4326+3855")
    text = said_of(plan(path, EGM96))["datum_here"]
    assert text.startswith("egm96: ")
    assert text.endswith("as stated (the file says egm2008)")


def test_elevations_in_raw_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.bil"
    rasterio_shutil.copy(
        write(tmp_path / "a.tif", POSTS, WHERE, "EPSG:4326"), path, driver="EHdr"
    )
    assert plan(path, EGM96)["width"] == POSTS.shape[1]
