# SPDX-License-Identifier: Apache-2.0
"""Grounding against a ground that is a formula."""

import numpy as np
import pytest
import shapely

from ingest.grounding import PLINTH_M, ellipsoid, ground_objects

DEGREE_M = 111_194.0


def house(x: float, y: float, width: float = 20.0) -> shapely.Geometry:
    """A square house in metres from longitude 0, latitude 0."""
    return shapely.box(*(value / DEGREE_M for value in (x, y, x + width, y + width)))


def houses(*found: shapely.Geometry) -> np.ndarray:
    array = np.empty(len(found), object)
    array[:] = found
    return array


def slope(lon_rad: np.ndarray, lat_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """100 m, rising 1 m in 10 to the east; the error is 0.25 m north of 100 m."""
    north = np.degrees(lat_rad) * DEGREE_M
    return 100 + np.degrees(lon_rad) * DEGREE_M / 10, np.where(north > 100, 0.25, 0.0)


def test_a_house_stands_on_the_lowest_ground_under_it_and_walls_go_on_below() -> None:
    found = ground_objects(houses(house(50, 0), house(0, 200)), slope)
    assert found.low_m == pytest.approx([105, 100])
    assert found.edge_high_m == pytest.approx([107, 102])
    assert found.plinth_m == pytest.approx([PLINTH_M, PLINTH_M + 0.25])
    assert found.foot_m(np.zeros(2)) == pytest.approx([104, 98.75])
    assert not found.floating(np.zeros(2)).any()


def test_a_courtyards_ring_and_every_part_of_a_multipolygon_count() -> None:
    ring = np.array([(40, 8), (45, 8), (45, 12), (40, 8)]) / DEGREE_M
    court = shapely.Polygon(shapely.box(0, 0, 1e-3, 1e-3).exterior, [ring])
    two = shapely.MultiPolygon([house(500, 0), house(30, 0)])
    found = ground_objects(houses(two, court), slope)
    assert found.low_m == pytest.approx([103, 100])
    assert found.edge_high_m == pytest.approx([152, 100 + 1e-3 * DEGREE_M / 10])


def test_a_ditch_under_the_middle_of_an_edge_is_seen() -> None:
    def ditch(lon_rad: np.ndarray, lat_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        east = np.degrees(lon_rad) * DEGREE_M
        south = np.abs(np.degrees(lat_rad)) * DEGREE_M < 1
        return np.where((np.abs(east - 10) < 3) & south, -2.0, 0.0), np.zeros(len(lon_rad))

    found = ground_objects(houses(house(0, 0), house(100, 0)), ditch)
    assert found.low_m.tolist() == [0, 0]
    assert found.edge_low_m.tolist() == [-2, 0]
    assert found.floating(np.zeros(2)).tolist() == [True, False]
    assert found.floating(np.array([3.0, 0.0])).tolist() == [False, False]


def test_a_low_house_in_a_slope_is_sunk_and_a_tall_one_is_not() -> None:
    found = ground_objects(houses(house(0, 0), house(0, 0)), slope)
    assert found.sunk(np.array([1.0, 4.0])).tolist() == [True, False]


def test_a_raised_part_has_no_plinth() -> None:
    found = ground_objects(houses(house(0, 0)), slope)
    assert found.foot_m(np.array([6.0])) == pytest.approx([106])


def test_the_answer_for_a_house_does_not_depend_on_its_neighbours(
    rng: np.random.Generator,
) -> None:
    many = houses(*(house(x, y) for x, y in rng.uniform(0, 400, (30, 2))))
    together = ground_objects(many, slope)
    for k in range(len(many)):
        alone = ground_objects(many[k : k + 1], slope)
        assert together.low_m[k] == alone.low_m[0]
        assert together.edge_high_m[k] == alone.edge_high_m[0]
        assert together.plinth_m[k] == alone.plinth_m[0]


def test_without_terrain_the_ground_is_the_ellipsoid() -> None:
    found = ground_objects(houses(house(0, 0)), ellipsoid)
    assert found.low_m.tolist() == [0]
    assert found.plinth_m.tolist() == [PLINTH_M]
