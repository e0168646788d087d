# SPDX-License-Identifier: Apache-2.0
"""Vertical datums: EGM96 as PROJ has it, everything unknown refused."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyproj
import pytest

from ingest.datum import datum_of, undulation_m, unit_m
from tests.ingest.rasters import geoid_m
from tiles.errors import InputError
from tiles.samples import SAMPLES

NAVD88 = "EPSG:4326+5703"


def test_egm96_is_what_proj_interpolates(rng: np.random.Generator) -> None:
    lon, lat = rng.uniform(-180, 180, 3000), rng.uniform(-90, 90, 3000)
    lon[:6], lat[:6] = (-180, 179.9999, 0, 0, -180, 12.25), (0, 0, 90, -90, 89.9, 45.5)
    found = undulation_m("egm96", np.radians(lon), np.radians(lat))
    np.testing.assert_allclose(found, geoid_m(lon, lat), atol=1e-4)


def test_egm96_has_its_known_values() -> None:
    """NIMA TR8350.2: 13.61 m and -29.53 m at the poles, 17.16 m at 0, 0; the lowest."""
    lon, lat = np.radians([0, 0, 0, 78.75]), np.radians([90, -90, 0, 4.75])
    np.testing.assert_allclose(
        undulation_m("egm96", lon, lat), [13.61, -29.53, 17.16, -106.9], atol=0.15
    )


def test_egm96_is_the_same_a_turn_further_and_single_valued_at_the_poles() -> None:
    lon, lat = np.linspace(-np.pi, np.pi, 50), np.linspace(-1.5, 1.5, 50)
    turned = undulation_m("egm96", lon + 2 * np.pi, lat)
    np.testing.assert_allclose(undulation_m("egm96", lon, lat), turned, atol=1e-9)
    for pole in (-np.pi / 2, np.pi / 2):
        assert np.ptp(undulation_m("egm96", lon, np.full(50, pole))) < 1e-9


def test_heights_above_the_ellipsoid_stay() -> None:
    assert undulation_m("ellipsoid", np.zeros((2, 3)), np.zeros((2, 3))).tolist() == [
        [0, 0, 0],
        [0, 0, 0],
    ]


@pytest.mark.parametrize(
    ("stated", "file_crs", "found"),
    [
        ("egm96", None, "egm96"),
        ("EGM96", NAVD88, "egm96"),
        ("ellipsoid", None, "ellipsoid"),
        ("EPSG:5773", None, "egm96"),
        ("epsg:4979", None, "ellipsoid"),
        (None, "EPSG:4326+5773", "egm96"),
        (None, "EPSG:9707", "egm96"),
        (None, "EPSG:4979", "ellipsoid"),
    ],
)
def test_the_datum_is_as_stated_else_as_the_file_says(
    stated: str | None, file_crs: str | None, found: str
) -> None:
    assert datum_of("dem.tif", stated, file_crs) == found


@pytest.mark.parametrize(
    ("stated", "file_crs", "says"),
    [
        (None, None, "vertical datum not known"),
        (None, "EPSG:4326", "vertical datum not known"),
        ("egm2008", None, "no grid for vertical datum egm2008"),
        ("EPSG:3855", None, "no grid for vertical datum egm2008"),
        ("EPSG:5703", None, "no grid for vertical datum epsg:5703"),
        (None, NAVD88, "no grid for vertical datum epsg:5703"),
        ("sea level", None, "unknown vertical datum 'sea level'"),
    ],
)
def test_a_datum_that_is_not_known_or_has_no_grid_is_refused(
    stated: str | None, file_crs: str | None, says: str
) -> None:
    with pytest.raises(InputError) as refusal:
        datum_of("some/dem.tif", stated, file_crs)
    message = str(refusal.value)
    assert message.startswith(f"some/dem.tif: {says}")
    assert "--datum" in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("stated", "bounds_deg", "says"),
    [
        ("EPSG:5703", (-150.0, 61.0, -149.0, 62.0), "us_noaa_(geoid0|g2012ba0)"),
        ("EPSG:5703", (-100.0, 40.0, -99.0, 41.0), "us_noaa_g"),
        ("EPSG:5621", (11.0, 46.0, 12.0, 47.0), "PROJ has none for there"),
        ("EPSG:5714", (11.0, 46.0, 12.0, 47.0), "PROJ has none for there"),
        ("egm2008", (179.0, -17.0, 181.0, -16.0), "us_nga_egm08_25.tif"),
    ],
)
def test_a_grid_is_named_that_is_for_there_and_can_be_had(
    stated: str, bounds_deg: tuple[float, float, float, float], says: str
) -> None:
    """Not a file without an address (of MSL), nor Slovakia's for Tyrol."""
    with pytest.raises(InputError, match=says):
        datum_of("a.tif", stated, None, bounds_deg)


def test_units_come_from_the_band_or_the_vertical_system() -> None:
    feet = pyproj.CRS("EPSG:4326+6360").to_wkt()  # NAVD88 height (ftUS)
    assert unit_m("a.tif", None, feet, None) == pytest.approx(1200 / 3937)
    assert unit_m("a.tif", "EPSG:6360", None, None) == pytest.approx(1200 / 3937)
    assert unit_m("a.tif", None, "EPSG:4326+5773", None) == 1.0
    assert unit_m("a.tif", "egm96", None, None) == 1.0
    assert unit_m("a.tif", "egm96", feet, None) == pytest.approx(1200 / 3937)
    assert unit_m("a.tif", "egm96", None, "ft") == 0.3048
    assert unit_m("a.tif", "egm96", feet, "m") == 1.0
    assert unit_m("a.tif", "egm96", feet, "m", "ft") == 0.3048


@pytest.mark.parametrize("crs", ["EPSG:2227", "EPSG:2992"])  # US survey, international
def test_a_map_in_feet_says_nothing_of_its_heights(crs: str) -> None:
    with pytest.raises(InputError, match=r"its map is in feet.*; add --units ft, us-ft"):
        unit_m("a.tif", "egm96", crs, None)
    assert unit_m("a.tif", "egm96", crs, None, "us-ft") == pytest.approx(1200 / 3937)
    assert unit_m("a.tif", "egm96", crs, None, "m") == 1.0
    assert unit_m("a.tif", "egm96", crs, "ft") == 0.3048
    assert unit_m("a.tif", "EPSG:6360", crs, None) == pytest.approx(1200 / 3937)


def test_a_unit_that_is_no_length_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"a\.tif: heights in an unknown unit 'K'; .*--units"
    ):
        unit_m("a.tif", "egm96", None, "K")


def test_depths_are_no_heights() -> None:
    with pytest.raises(InputError, match="depths"):
        datum_of("a.tif", "EPSG:5831", None)


PROJ = """
import sys
import numpy as np
import pyproj
pyproj.datadir.append_data_dir(sys.argv[1])
from ingest.datum import datum_of, undulation_m
assert datum_of("a.tif", "egm2008", None) == datum_of("a.tif", "EPSG:3855", None)
lon, lat = np.radians([11.3, -100.2, 190.0]), np.radians([46.1, -30.4, 5.0])
found = undulation_m("egm2008", lon, lat)
np.testing.assert_allclose(found, undulation_m("egm96", lon, lat), atol=1e-4)
assert np.isnan(undulation_m("egm2008", np.array([np.inf]), np.zeros(1))).all()
"""


def test_a_grid_that_proj_has_is_used(tmp_path: Path) -> None:
    """Our grid of EGM96 under the name of EGM2008's."""
    grid = tmp_path / "us_nga_egm08_25.tif"
    grid.write_bytes((SAMPLES / "egm96_15.tif").read_bytes())
    words = [sys.executable, "-c", PROJ, str(tmp_path)]
    root = str(Path(__file__).parents[2])
    done = subprocess.run(words, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
