# SPDX-License-Identifier: Apache-2.0
"""The tint of the sea is the same inside and outside of a model that knows land alone."""

from dataclasses import dataclass

import numpy as np
import pytest

from ingest.coast import KNOWN, SEA, UNKNOWN, coast_of
from tests.ingest.rasters import Floats
from tiles import cells

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


def tinted(held: list[Flat], elevation_m: Floats) -> list[Floats]:
    lon_deg, lat_deg = np.linspace(WEST, EAST, SIDE), np.linspace(SOUTH, NORTH, SIDE)
    lon, lat = np.meshgrid(np.radians(lon_deg), np.radians(lat_deg))
    places = lon, lat, np.full(lon.shape, GEOID_M), elevation_m
    found = coast_of(CELL, held, places, STEP_M)  # type: ignore[arg-type]
    return [np.asarray(one, np.float64) for one in found]


def test_the_sea_of_a_land_model_is_as_deep_as_a_coarser_one_says() -> None:
    elevation = np.zeros((SIDE, SIDE))
    elevation[:, 12:] = 30.0
    found, knows = tinted([Flat(18e3, -2000.0), Flat(90.0, 0.0)], elevation)
    assert found[:, :10] == pytest.approx(-2000.0)
    assert (knows[:, :10] == SEA).all()
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
