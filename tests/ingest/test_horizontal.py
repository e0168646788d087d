# SPDX-License-Identifier: Apache-2.0
"""How far off places may be is said, or the file is refused; oracle: PROJ's own lists."""

import warnings
from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely
from pyproj.aoi import AreaOfInterest
from pyproj.transformer import TransformerGroup

from geopage.cli import main
from ingest.degrees import ToDegrees
from ingest.raster_plan import plan
from tests.ingest.rasters import ELLIPSOID, hills, north_up, post_places_deg, write
from tiles.errors import InputError
from tiles.placement import Placement

HERE = {
    "EPSG:31467": (9.0, 50.0),  # DHDN
    "EPSG:27700": (-2.0, 52.0),  # OSGB36
    "EPSG:26710": (-122.0, 37.5),  # NAD27
    "EPSG:28992": (5.0, 52.0),  # Amersfoort, whose grid changes little
}
CAMACUPA = "EPSG:22032"


def raster(path: Path, crs: str, place: tuple[float, float], step_m: float) -> Path:
    """Write 12 x 12 posts whose north-western corner is at a place."""
    corner = pyproj.Transformer.from_crs(4326, crs, always_xy=True).transform(*place)
    return write(path, hills((12, 12), 1.0, 50.0), north_up(*corner, step_m), crs)


def said(path: Path, crs: str, place: tuple[float, float], step_m: float) -> str:
    return str(plan(raster(path, crs, place, step_m), ELLIPSOID)["doubt"])


@pytest.mark.parametrize("crs", HERE)
def test_how_far_off_places_may_be_is_said_and_what_grid_would_do(
    crs: str, tmp_path: Path
) -> None:
    lon, lat = HERE[crs]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        area = AreaOfInterest(lon, lat - 1e-3, lon + 1e-3, lat)
        ways = TransformerGroup(crs, 4326, area_of_interest=area, allow_ballpark=False)
    off_m = ways.transformers[0].accuracy
    better = [way for way in ways.unavailable_operations if way.accuracy < off_m]
    text = said(tmp_path / "fine.tif", crs, HERE[crs], 1.0)
    assert text.startswith(f"fine.tif: places may be {off_m:g} m off (by ")
    assert ("install" in text) == bool(better)
    if better:
        best = min(better, key=lambda way: way.accuracy)
        assert f"for {best.accuracy:g} m" in text
        assert all(grid.short_name in text for grid in best.grids)
    assert "\n" not in text
    assert said(tmp_path / "wide.tif", crs, HERE[crs], 2.0 * off_m) == ""


GOOD = dict.fromkeys(["EPSG:32631", "EPSG:25831", "EPSG:3857", "EPSG:3413"], (3.0, 60.0))
NAD83 = {"EPSG:3978": (-100.0, 55.0), "EPSG:26910": (-122.0, 37.5)}


@pytest.mark.parametrize(("crs", "place"), (GOOD | NAD83).items())
def test_of_good_systems_nothing_is_said(
    crs: str, place: tuple[float, float], tmp_path: Path
) -> None:
    assert said(tmp_path / "a.tif", crs, place, 10.0) == ""


@pytest.mark.parametrize(
    ("crs", "west", "south", "east", "north"),
    [
        ("EPSG:26717", -84, 25, -78, 44),
        ("EPSG:23030", -9, 36, 3, 44),
        ("EPSG:31467", 6, 47, 14, 55),
    ],
)
def test_one_way_is_taken_for_all_of_a_raster(
    crs: str, west: float, south: float, east: float, north: float
) -> None:
    """PROJ takes others in other countries: there and back its posts are up to 18 m off."""
    size = {"wraps": 0, "width": 1000, "height": 1000, "transform": (1, 0, 0, 0, -1, 0)}
    bounds = west, south, east, north
    place = Placement({"crs": crs, "bounds_deg": bounds, **size})
    lon, lat = (
        one.ravel()
        for one in np.meshgrid(np.linspace(west, east, 121), np.linspace(south, north, 121))
    )
    pixels = place.pixels(np.radians(lon), np.radians(lat))
    back = np.degrees(place.places(*pixels))
    assert 111e3 * np.abs(back - (lon, lat)).max() < 0.02
    there = pyproj.Transformer.from_crs(4326, crs, always_xy=True).transform(lon, lat)
    turn = pyproj.Transformer.from_crs(crs, 4326, always_xy=True)
    assert 111e3 * np.abs(np.subtract(turn.transform(*there), (lon, lat))).max() > 0.5
    # It is one of PROJ's own, so it is about as far off as that says.
    off_m = np.hypot(pixels[0] + 0.5 - there[0], -pixels[1] - 0.5 - there[1])
    assert off_m.max() < 50.0


def test_no_change_of_datum_is_left_out_where_one_is_known(tmp_path: Path) -> None:
    """PROJ's own choice leaves 370 m out here: its way was made for the sea nearby."""
    path = raster(tmp_path / "a.tif", CAMACUPA, (14.0, -10.0), 30.0)
    place = Placement(plan(path, ELLIPSOID))
    ways = TransformerGroup(CAMACUPA, 4326, always_xy=True, allow_ballpark=False)
    west, north = pyproj.Transformer.from_crs(4326, CAMACUPA).transform(-10.0, 14.0)
    col, row = np.arange(12.0), np.full(12, 4.0)
    truth = ways.transformers[0].transform(west + 30 * col + 15, north - 30 * row - 15)
    lost_m = 111e3 * (post_places_deg(path)[1][4] - truth[1])
    assert np.abs(lost_m).min() > 100.0
    np.testing.assert_allclose(np.degrees(place.places(col, row)), truth, atol=1e-7)
    np.testing.assert_allclose(place.pixels(*np.radians(truth)), (col, row), atol=1e-3)
    assert "which is made for elsewhere" in plan(path, ELLIPSOID)["doubt"]


@pytest.mark.parametrize(
    "crs", ["+proj=utm +zone=33 +ellps=bessel", "+proj=utm +zone=33 +ellps=clrk66"]
)
def test_an_old_ellipsoid_without_a_way_to_wgs84_is_refused(
    crs: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.tif"
    with pytest.raises(InputError, match=r"a\.tif: no way known from its datum .*--crs"):
        said(path, crs, (15.0, 50.0), 30.0)
    assert said(path, crs, (15.0, 50.0), 5000.0) == ""


@pytest.mark.parametrize(
    "crs", ["+proj=sinu +R=6371007.181", "+proj=laea +lat_0=50 +lon_0=9 +ellps=GRS80"]
)
def test_a_sphere_or_an_unnamed_datum_is_taken_as_wgs84_and_said(
    crs: str, tmp_path: Path
) -> None:
    text = said(tmp_path / "a.tif", crs, (9.0, 50.0), 500.0)
    assert "its degrees are taken as WGS84's" in text


def test_the_report_has_one_line_on_each_such_source(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    places = {"old": "EPSG:31467", "new": "EPSG:25832"}
    files = [
        str(raster(tmp_path / f"{name}.tif", crs, (9.0, 50.0), 3.0))
        for name, crs in places.items()
    ]
    words = ["ingest", "terrain", str(tmp_path / "a.geopage"), *files]
    assert main([*words, "--datum", "ellipsoid", "--bare"]) == 0
    lines = [one for one in capsys.readouterr().out.splitlines() if "warning" in one]
    assert len(lines) == 1
    assert lines[0].startswith("warning: old.tif: places may be 3 m off")


def test_of_footprints_it_is_said_too() -> None:
    boxes = np.array([shapely.box(5e5, 4.6e6, 5e5 + 20, 4.6e6 + 20)] * 3, object)
    found = []
    for crs in ("EPSG:26710", "EPSG:26910"):
        turn = ToDegrees.of(Path("city.gpkg"), crs)
        found.append(turn.check(boxes, turn.turn(boxes)))
    assert len(found[0]) == 1
    assert found[0][0].startswith("city.gpkg: places may be ")
    assert found[1] == []
