# SPDX-License-Identifier: Apache-2.0
"""Where a raster lies, in any CRS, and which files are not opened at all."""

import socket
from pathlib import Path

import numpy as np
import pyproj
import pytest
from affine import Affine

from ingest.dem import RasterInfo, describe, is_lon_lat
from ingest.raster_open import open_raster
from ingest.terrain import RasterOptions, ingest_rasters
from tests.ingest.rasters import hills, north_up, write
from tiles.errors import InputError

POSTS = hills((20, 40), 1.0, 100.0)


def info_of(path: Path, crs: str | None = None) -> RasterInfo:
    with open_raster(path) as dataset:
        return describe(path, dataset, crs)


def test_bounds_and_size_are_the_files(tmp_path: Path) -> None:
    info = info_of(
        write(tmp_path / "a.tif", POSTS, north_up(11, 46, 0.01), "EPSG:4326", -7)
    )
    assert info.bounds_deg == pytest.approx((11, 45.8, 11.4, 46))
    assert (info.width, info.height, info.bands, info.nodata) == (40, 20, 1, -7)
    assert not info.wraps


def test_bounds_of_a_projected_file_hold_all_its_posts(tmp_path: Path) -> None:
    where = north_up(6.2e5, 5.1e6, 2000.0)
    info = info_of(write(tmp_path / "a.tif", POSTS, where, "EPSG:32632"))
    back = pyproj.Transformer.from_crs(32632, 4326, always_xy=True)
    x, y = np.meshgrid(6.2e5 + 2000 * np.arange(41), 5.1e6 - 2000 * np.arange(21))
    lon, lat = back.transform(x, y)
    west, south, east, north = info.bounds_deg
    assert west <= lon.min() <= lon.max() <= east
    assert south <= lat.min() + 1e-4
    assert lat.max() <= north + 1e-4


def test_a_file_over_the_antimeridian_reaches_beyond_180(tmp_path: Path) -> None:
    where = north_up(2_800_000.0, 6_000_000.0, 30_000.0)
    info = info_of(write(tmp_path / "a.tif", POSTS, where, "EPSG:3832"))  # PDC Mercator
    west, _, east, _ = info.bounds_deg
    assert west < 180 < east < west + 360


def test_a_file_over_the_pole_reaches_it(tmp_path: Path) -> None:
    posts = hills((40, 40), 1.0, 10.0)
    info = info_of(write(tmp_path / "a.tif", posts, north_up(-1e5, 1e5, 5000), "EPSG:3413"))
    west, south, east, north = info.bounds_deg
    assert north == pytest.approx(90)
    assert east - west == pytest.approx(360)
    assert south < 89.2


def test_a_globe_wraps(tmp_path: Path) -> None:
    posts = hills((18, 36), 1.0, 10.0)
    assert info_of(write(tmp_path / "a.tif", posts, north_up(0, 90, 10), "EPSG:4326")).wraps
    part = write(tmp_path / "b.tif", posts, north_up(0, 90, 5), "EPSG:4326")
    assert not info_of(part).wraps


@pytest.mark.parametrize("step", [9.9999, 10.0001, 360 / 36])
def test_a_globe_whose_step_has_few_digits_closes(tmp_path: Path, step: float) -> None:
    posts = hills((18, 36), 1.0, 10.0)
    where = north_up(-180, 90, 10) @ Affine.scale(step / 10, 1.0)
    info = info_of(write(tmp_path / "a.tif", posts, where, "EPSG:4326"))
    assert info.wraps
    assert info.transform[0] * 36 == pytest.approx(360.0, abs=1e-12)


@pytest.mark.parametrize(
    ("west", "found"), [(541, 181), (-401, -41), (-190, 170), (-181, -181), (350, 350)]
)
def test_longitudes_are_brought_to_one_turn(
    tmp_path: Path, west: float, found: float
) -> None:
    info = info_of(write(tmp_path / "a.tif", POSTS, north_up(west, 46, 0.1), "EPSG:4326"))
    assert info.bounds_deg[0] == pytest.approx(found)
    assert info.transform[2] == pytest.approx(found)


def test_a_raster_far_outside_of_its_map_is_refused(tmp_path: Path) -> None:
    where = north_up(9e7, 5e6, 1000.0)
    with pytest.raises(InputError, match=r"no such places.*gdalwarp"):
        info_of(write(tmp_path / "a.tif", POSTS, where, "+proj=sinu"))


def test_a_map_of_the_whole_globe_has_corners_beyond_its_edge(tmp_path: Path) -> None:
    posts = hills((20, 40), 1.0, 100.0)
    where = north_up(-2e7, 1e7, 1e6)
    assert info_of(write(tmp_path / "a.tif", posts, where, "+proj=sinu")).width == 40


def test_a_stated_crs_replaces_the_files(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", POSTS, north_up(6.2e5, 5.1e6, 200.0), None)
    assert (
        info_of(path, "EPSG:32633").bounds_deg[0]
        > info_of(path, "EPSG:32632").bounds_deg[0]
    )


def test_a_compound_system_keeps_its_horizontal_part(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", POSTS, north_up(11, 46, 0.01), "EPSG:4326")
    assert pyproj.CRS(info_of(path, "EPSG:9707").crs).to_epsg() == 4326


@pytest.mark.parametrize(
    ("code", "plain"),
    [(4326, True), (4979, True), (4258, True), (4269, True), (4267, False), (4807, False),
     (32632, False), (4978, False)],
)  # fmt: skip
def test_only_degrees_on_the_ellipsoid_of_wgs84_are_taken_as_they_are(
    code: int,
    plain: bool,  # noqa: FBT001 - a table of cases
) -> None:
    assert is_lon_lat(pyproj.CRS.from_epsg(code)) is plain


def test_complex_numbers_are_no_heights(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", POSTS.astype(np.complex64), north_up(1, 2, 0.1), None)
    with pytest.raises(InputError, match="complex"):
        open_raster(path)


def test_a_message_is_one_line_however_gdal_puts_it(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(b"II*\0" + bytes(100))
    with pytest.raises(InputError) as refusal:
        open_raster(path)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("crs", "x", "y", "step", "spacing_m"),
    [
        ("EPSG:3857", 1.2e6, 8.4e6, 100.0, 50.0),  # Web Mercator at 60 degrees north
        ("EPSG:32632", 6.2e5, 5.1e6, 30.0, 30.0),
        ("EPSG:2263", 9.8e5, 2.0e5, 100.0, 30.48),  # feet
    ],
)
def test_spacing_is_what_it_is_on_the_earth(
    crs: str, x: float, y: float, step: float, spacing_m: float, tmp_path: Path
) -> None:
    info = info_of(write(tmp_path / "a.tif", POSTS, north_up(x, y, step), crs))
    assert info.spacing_m == pytest.approx(spacing_m, rel=0.01)


@pytest.mark.parametrize(
    "name", ["/vsicurl/http://127.0.0.1:9/x.tif", "http://127.0.0.1/x"]
)
def test_a_vrt_opens_nothing_over_a_network(name: str, tmp_path: Path) -> None:
    path = tmp_path / "net.vrt"
    path.write_text(
        '<VRTDataset rasterXSize="4" rasterYSize="4"><VRTRasterBand dataType="Int16"'
        f' band="1"><SimpleSource><SourceFilename>{name}</SourceFilename>'
        "</SimpleSource></VRTRasterBand></VRTDataset>"
    )
    with pytest.raises(InputError, match="names a file on a network"):
        open_raster(path)


def test_a_vrt_in_a_vrt_opens_nothing_over_a_network(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as far:
        far.settimeout(0.2)
        name = f"/vsicurl/http://127.0.0.1:{far.getsockname()[1]}/x.tif"
        for path, inner in (("inner.vrt", name), ("outer.vrt", "inner.vrt")):
            source = f'<SourceFilename relativeToVRT="1">{inner}</SourceFilename>'
            (tmp_path / path).write_text(
                '<VRTDataset rasterXSize="4" rasterYSize="4"><SRS>EPSG:4326</SRS>'
                "<GeoTransform>7, 1, 0, 44, 0, -1</GeoTransform>"
                '<VRTRasterBand dataType="Int16" band="1"><SimpleSource>'
                f"{source}</SimpleSource></VRTRasterBand></VRTDataset>"
            )
        file = tmp_path / "outer.vrt"
        with pytest.raises(InputError, match="names a file on a network"):
            ingest_rasters(
                tmp_path / "w.geopage", [(file, RasterOptions(datum="ellipsoid"))]
            )
        with pytest.raises(TimeoutError):
            far.accept()


@pytest.mark.parametrize(
    ("name", "advice"), [("height.hgt", "N43E007.hgt"), ("dem.tif.gz", "unpack")]
)
def test_what_can_not_be_read_is_told_what_to_do(
    name: str, advice: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(bytes(2 * 1201 * 1201))
    with pytest.raises(InputError, match=advice):
        open_raster(tmp_path / name)
