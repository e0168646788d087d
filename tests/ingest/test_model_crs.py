# SPDX-License-Identifier: Apache-2.0
"""The CRS of a city model: every spelling, the order of axes, the unit of heights."""

from pathlib import Path

import numpy as np
import pytest

from ingest.model_crs import Placement, place_model
from tiles.errors import InputError

PATH = Path("city.gml")
DELFT_RD = (85_000.0, 447_000.0)
YOKOSUKA = (35.26, 139.74)
POTSDAM = (367_180.0, 5_808_060.0)
FOOT_M = 0.3048006096012192


def placed(
    named: str | None,
    xy: tuple[float, float],
    crs: str | None = None,
    *,
    by_authority: bool = True,
) -> Placement:
    return place_model(PATH, named, crs, np.array([xy]), by_authority=by_authority)


@pytest.mark.parametrize(
    ("named", "code", "xy"),
    [
        ("EPSG:7415", 28992, DELFT_RD),
        ("urn:ogc:def:crs:EPSG::7415", 28992, DELFT_RD),
        ("https://www.opengis.net/def/crs/EPSG/0/7415", 28992, DELFT_RD),
        ("http://www.opengis.net/gml/srs/epsg.xml#28992", 28992, DELFT_RD),
        ("urn:ogc:def:crs,crs:EPSG:6.12:25833,crs:EPSG:6.12:5783", 25833, POTSDAM),
        ("urn:ogc:def:crs,crs:EPSG::25833,crs:EPSG::99999", 25833, POTSDAM),
        ("urn:adv:crs:ETRS89_UTM33*DE_DHHN92_NH", 25833, POTSDAM),
        ("urn:adv:crs:DE_DHDN_3GK4*DE_DHHN92_NH", 31468, (5_330_000.0, 4_468_000.0)),
        ("EPSG:25833+5783", 25833, POTSDAM),
    ],
)
def test_every_spelling_of_a_crs_is_understood(
    named: str, code: int, xy: tuple[float, float]
) -> None:
    found = placed(named, xy)
    assert found.system.to_epsg() == code
    assert found.notes == ()


def test_citygml_has_the_axes_of_its_crs() -> None:
    found = placed("http://www.opengis.net/def/crs/EPSG/0/6697", YOKOSUKA)
    assert found.swapped
    lon, lat = found.degrees(np.array([YOKOSUKA]))
    assert (lat[0], lon[0]) == pytest.approx(YOKOSUKA)
    assert found.notes == ()


def test_cityjson_has_east_first_whatever_the_crs() -> None:
    found = placed("EPSG:31256", (983.0, 340_433.0), by_authority=False)
    assert not found.swapped
    assert [value[0] for value in found.degrees(np.array([(983.0, 340_433.0)]))] == (
        pytest.approx([16.35, 48.2], abs=0.1)
    )


@pytest.mark.parametrize(
    ("named", "xy", "by_authority", "swapped"),
    [
        ("EPSG:6697", YOKOSUKA[::-1], True, False),
        ("EPSG:31468", (4_468_000.0, 5_330_000.0), True, False),
        ("EPSG:6697", YOKOSUKA, False, True),
    ],
)
def test_swapped_axes_are_found_and_named(
    named: str, xy: tuple[float, float], *, by_authority: bool, swapped: bool
) -> None:
    found = placed(named, xy, by_authority=by_authority)
    assert found.swapped == swapped
    assert "axes swapped" in found.notes[0]


@pytest.mark.parametrize(
    ("named", "crs", "xy", "unit_m", "notes"),
    [
        ("EPSG:7415", None, DELFT_RD, 1.0, 0),
        ("EPSG:2263+6360", None, (990_000.0, 200_000.0), FOOT_M, 0),
        ("EPSG:2263+6360", "EPSG:2263", (990_000.0, 200_000.0), FOOT_M, 0),
        ("EPSG:2263+5703", None, (990_000.0, 200_000.0), 1.0, 0),
        (None, "EPSG:2263", (990_000.0, 200_000.0), FOOT_M, 1),
        (None, "EPSG:4326", YOKOSUKA, 1.0, 0),
        ("nonsense", "EPSG:2263", (990_000.0, 200_000.0), FOOT_M, 1),
    ],
)
def test_heights_have_the_unit_of_the_vertical_axis(
    named: str | None, crs: str | None, xy: tuple[float, float], unit_m: float, notes: int
) -> None:
    found = placed(named, xy, crs)
    assert found.unit_m == pytest.approx(unit_m)
    assert len(found.notes) == notes


def test_a_place_far_from_home_is_noted() -> None:
    found = placed("EPSG:28992", (0.0, 0.0))
    assert "outside the area" in found.notes[0]


@pytest.mark.parametrize(
    ("named", "crs", "words"),
    [
        (None, None, "--crs"),
        ("", None, "--crs"),
        ("EPSG:0", None, "unknown CRS"),
        ("EPSG:7415", "somewhere", "unknown CRS"),
        ("EPSG:5709", None, "no map or geographic CRS"),
        ("EPSG:4978", None, "no map or geographic CRS"),
    ],
)
def test_no_usable_crs_is_one_line_that_names_the_option(
    named: str | None, crs: str | None, words: str
) -> None:
    with pytest.raises(InputError, match="--crs") as caught:
        placed(named, DELFT_RD, crs)
    assert words in str(caught.value)


@pytest.mark.parametrize("xy", [(1e15, 0.0), (1e300, 1e300), (4e5, 5e9)])
def test_coordinates_that_lead_nowhere_are_refused(xy: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="can't be in EPSG:28992"):
        placed("EPSG:28992", xy)
