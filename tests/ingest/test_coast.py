# SPDX-License-Identifier: Apache-2.0
"""The tint of the sea is the same inside and outside of a model that knows land alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from ingest.coast import KNOWN, SURE, UNKNOWN, coast_of
from ingest.datum import undulation_m
from tests.ingest.rasters import Floats
from tiles import cells
from tiles.geodesy import cell_edge_m, to_ecef

CELL = int(cells.cell_at(np.radians(10.0), np.radians(40.0), 8))
WEST, SOUTH, EAST, NORTH = (float(np.degrees(x)) for x in cells.bounds_rad(CELL))
SIDE, STEP_M, GEOID_M = 17, 500.0, 47.0


@dataclass
class Flat:
    """Stands for a source of one elevation in a box, heights as a layer gives them."""

    spacing_m: float
    elevation_m: float
    mean_m: float = 0.0
    """elevation where many posts are averaged"""
    bounds_deg: tuple[float, float, float, float] = (WEST, SOUTH, EAST, NORTH)

    def heights(self, lon_rad: Floats, lat_rad: Floats, step_m: float) -> Floats:
        west, south, east, north = np.radians(self.bounds_deg)
        inside = (lon_rad >= west) & (lon_rad <= east) & (lat_rad >= south)
        inside &= lat_rad <= north
        elevation_m = self.elevation_m if step_m == STEP_M else self.mean_m
        return np.where(inside, elevation_m + GEOID_M, np.nan)

    def near(self, lon_rad: Floats, lat_rad: Floats, margin_m: float) -> NDArray[np.bool_]:
        return self.rim_heights(lon_rad, lat_rad, 0.0)[1] <= margin_m

    def rim_heights(
        self, lon_rad: Floats, lat_rad: Floats, _step_m: float
    ) -> tuple[Floats, Floats]:
        west, south, east, north = np.radians(self.bounds_deg)
        lon, lat = np.clip(lon_rad, west, east), np.clip(lat_rad, south, north)
        away_m = np.linalg.norm(
            to_ecef(lon, lat, 0.0) - to_ecef(lon_rad, lat_rad, 0.0), axis=1
        )
        return self.mean_m + undulation_m("egm96", lon_rad, lat_rad), away_m


def tinted(
    held: list[Flat], elevation_m: Floats, beside: Sequence[tuple[Flat, float]] = ()
) -> list[Floats]:
    lon_deg, lat_deg = np.linspace(WEST, EAST, SIDE), np.linspace(SOUTH, NORTH, SIDE)
    lon, lat = np.meshgrid(np.radians(lon_deg), np.radians(lat_deg))
    places = lon, lat, np.full(lon.shape, GEOID_M), elevation_m
    found = coast_of(CELL, held, places, STEP_M, beside)  # type: ignore[arg-type]
    return [np.asarray(one, np.float64) for one in found]


def test_the_sea_of_a_land_model_is_as_deep_as_a_coarser_one_says() -> None:
    elevation = np.zeros((SIDE, SIDE))
    elevation[:, 12:] = 30.0
    found, knows = tinted([Flat(18e3, -2000.0), Flat(90.0, 0.0)], elevation)
    assert found[:, :10] == pytest.approx(-2000.0)
    assert (knows[:, :10] == SURE).all()
    assert (found[:, 10] == 0).all()  # beside the land, so that the coast stays
    assert (found[:, 11:] == 30).all()
    assert (knows[:, 10:] == KNOWN).all()


def test_the_sea_gets_shallow_towards_land() -> None:
    sea = np.zeros((SIDE, SIDE))
    depths = [
        tinted([Flat(18e3, -2000.0), Flat(90.0, 0.0, mean_m)], sea)[0].mean()
        for mean_m in (0.0, 1.0, 4.0, 80.0)
    ]
    assert depths[0] == pytest.approx(-2000.0)
    assert depths == sorted(depths)
    assert depths[1] < depths[2] < depths[3] == 0.0


def test_land_of_a_coarser_model_does_not_fill_the_sea() -> None:
    found, _ = tinted([Flat(18e3, 400.0), Flat(90.0, 0.0)], np.zeros((SIDE, SIDE)))
    assert (found == 0).all()


def test_without_a_fine_model_nothing_is_known_or_changed() -> None:
    elevation = np.full((SIDE, SIDE), -3.0)
    found, knows = tinted([Flat(2 * STEP_M, -2000.0)], elevation)
    assert (knows == UNKNOWN).all()
    assert (found == -3).all()


def test_the_bed_of_the_sea_that_a_finer_model_bends_is_not_seen_bent() -> None:
    elevation = np.full((SIDE, SIDE), -3.0)
    found, knows = tinted([Flat(18e3, -2000.0)], elevation)
    assert (knows == UNKNOWN).all()
    assert found == pytest.approx(-2000.0)


def test_posts_are_known_where_the_fine_model_has_them() -> None:
    half = (WEST + EAST) / 2 + 1e-9
    fine = Flat(90.0, 3.0, 0.0, (WEST, SOUTH, half, NORTH))
    _, knows = tinted([Flat(18e3, -2000.0), fine], np.full((SIDE, SIDE), 3.0))
    assert (knows[:, :8] == KNOWN).all()
    assert (knows[:, 8:] == UNKNOWN).all()


SIDE_M = float(cell_edge_m(CELL))
WESTWARD = (WEST - 1.0, SOUTH, WEST, NORTH)
"""A finer model ends at the cell's western edge."""


def test_coarse_ground_beside_a_finer_models_land_is_no_sea() -> None:
    coarse, land = Flat(18e3, -10.0), Flat(90.0, 0.0, 80.0, WESTWARD)
    shallow = np.full((SIDE, SIDE), -10.0)
    found, knows = tinted([coarse], shallow, [(land, SIDE_M / 2)])
    assert (found[:, 0] > 15).all()
    assert (knows[:, 0] > KNOWN).all()
    assert (np.diff(found, axis=1) <= 1e-6).all(), "less and less land further away"
    assert (found[:, 9:] == -10).all()
    assert (knows[:, 9:] == UNKNOWN).all()


@pytest.mark.parametrize(("coarse_m", "rim_m"), [(-10.0, 0.0), (-2000.0, 80.0)])
def test_coarse_sea_stays_sea_beside_fine_sea_and_where_it_is_deep(
    coarse_m: float, rim_m: float
) -> None:
    fine = Flat(90.0, 0.0, rim_m, WESTWARD)
    sea = np.full((SIDE, SIDE), coarse_m)
    found, knows = tinted([Flat(18e3, coarse_m)], sea, [(fine, SIDE_M / 2)])
    np.testing.assert_allclose(found, coarse_m)
    assert (knows == UNKNOWN).all()
