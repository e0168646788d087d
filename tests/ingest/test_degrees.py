# SPDX-License-Identifier: Apache-2.0
"""CRS: coordinates turned like pyproj turns them, wrong ones found and named."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely

from ingest.degrees import ToDegrees, outside_world
from tiles.errors import InputError

CITY = np.array(
    [shapely.box(5 + k / 1e3, 52, 5.0005 + k / 1e3, 52.0005) for k in range(9)], object
)
FILE = Path("city.gpkg")


def metres(crs: str | int, shapes: np.ndarray = CITY) -> np.ndarray:
    turn = pyproj.Transformer.from_crs(4326, crs, always_xy=True)
    return np.asarray(shapely.transform(shapes, turn.transform, interleaved=False), object)


def swapped(shapes: np.ndarray) -> np.ndarray:
    return np.asarray(shapely.transform(shapes, lambda xy: xy[:, ::-1]), object)


def checked(crs: str, shapes: np.ndarray, bbox: tuple[float, ...] = ()) -> list[str]:
    turn = ToDegrees.of(FILE, crs)
    return turn.check(shapes, turn.turn(shapes), bbox)


@pytest.mark.parametrize(
    "crs", ["EPSG:28992", "EPSG:7415", "EPSG:3857", "EPSG:32631", "EPSG:4979", "OGC:CRS84"]
)
def test_coordinates_are_turned_and_heights_left_aside(crs: str) -> None:
    flat = {"EPSG:7415": "EPSG:28992", "EPSG:4979": "EPSG:4326"}.get(crs, crs)
    there = metres(flat)
    turned = ToDegrees.of(FILE, crs).turn(there)
    np.testing.assert_allclose(shapely.bounds(turned), shapely.bounds(CITY), atol=2e-8)
    assert checked(crs, there) == []


@pytest.mark.parametrize(
    ("crs", "reason"),
    [
        (None, "says no CRS; name it with --crs"),
        ("EPSG:99", "unknown CRS 'EPSG:99'"),
        ("words\nin lines", "unknown CRS 'words in lines'"),
        ("EPSG:4978", "no map of the earth's surface"),
        ("EPSG:5773", "no map of the earth's surface"),
        ('LOCAL_CS["site",UNIT["m",1]]', "no map of the earth's surface"),
    ],
)
def test_what_is_no_crs_of_a_map_is_refused(crs: str | None, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        ToDegrees.of(FILE, crs)
    assert "\n" not in str(caught.value)


def test_metres_called_degrees_are_refused_and_web_mercator_is_worked_out() -> None:
    with pytest.raises(
        InputError, match=r"EPSG:3857 would put that at longitude 5, lat.* 52"
    ):
        checked("EPSG:4326", metres(3857))


def test_degrees_called_metres_are_refused() -> None:
    with pytest.raises(InputError, match="look like degrees, but its CRS is EPSG:3857"):
        checked("EPSG:3857", CITY)


def test_swapped_axes_are_refused_where_it_is_sure() -> None:
    tokyo = shapely.transform(CITY, lambda xy: xy + np.array((134.7, -16.3)))
    with pytest.raises(InputError, match="longitude and latitude are swapped; swap them"):
        checked("EPSG:4326", swapped(tokyo))


def test_swapped_axes_are_doubted_where_the_area_or_the_bbox_says_so() -> None:
    paris = shapely.transform(CITY, lambda xy: xy + np.array((-2.7, -3.2)))
    found = checked("EPSG:2154", swapped(metres("EPSG:2154", paris)))
    assert "outside the area of EPSG:2154 (France" in found[0]
    assert "x and y seem to be swapped" in found[0]
    away = checked("EPSG:2056", metres("EPSG:2056", CITY))
    assert "outside the area" in away[0]
    assert "swapped" not in away[0]
    found = checked("EPSG:4326", swapped(CITY), (5, 52, 5.1, 52.1))
    assert "outside the bbox that it states; x and y seem to be swapped" in found[0]
    assert checked("EPSG:4326", CITY, (5, 52, 5.1, 52.1)) == []
    assert checked("EPSG:4326", CITY, (179, 52, -179, 52.1)) == []
    assert checked("EPSG:4326", CITY, ("a", None, {}, [])) == []


def test_a_few_lost_features_are_no_reason_to_refuse() -> None:
    lost = np.append(CITY, [shapely.box(900, 0, 901, 1), None, shapely.Polygon()])
    assert checked("EPSG:4326", lost) == []
    assert outside_world(lost).tolist() == [False] * 9 + [True, False, False]


def test_longitudes_of_0_to_360_are_of_this_world() -> None:
    west = np.array([shapely.box(359, 10, 359.1, 10.1), shapely.box(-190, 0, -189.9, 1)])
    assert not outside_world(west).any()
    assert checked("EPSG:4326", west) == []
