# SPDX-License-Identifier: Apache-2.0
"""Grounding against a ground that is a formula."""

import numpy as np
import pytest
import shapely

from ingest.ground_places import places_of
from ingest.grounding import (
    CLEAR_M,
    PLINTH_M,
    PROXY_SLACK,
    THRESHOLD_RATIO,
    ellipsoid,
    ground_objects,
    proxy_feet_m,
)

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
    assert found.plinth_m == pytest.approx([PLINTH_M, PLINTH_M])
    assert found.foot_m(np.zeros(2)) == pytest.approx([105 - PLINTH_M, 100 - PLINTH_M])
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
        return np.where((np.abs(east - 10) < 4) & south, -2.0, 0.0), np.zeros(len(lon_rad))

    found = ground_objects(houses(house(0, 0), house(100, 0)), ditch)
    assert found.edge_low_m.tolist() == [-2, 0]
    assert found.foot_m(np.zeros(2)).tolist() == [-2 - PLINTH_M, -PLINTH_M]
    assert not found.floating(np.zeros(2)).any()


def test_a_house_lower_than_its_slope_is_lifted_until_its_roof_is_clear() -> None:
    top_m = np.array([0.4, 1.0, 2.5, 4.0])
    found = ground_objects(houses(*[house(0, 0)] * 4), slope, top_m)
    clear_m = np.array([0.4, CLEAR_M, CLEAR_M, 2.0])
    assert found.low_m + top_m == pytest.approx(102 + clear_m)
    assert found.lifted_m == pytest.approx([2, 2, 0.5, 0])
    assert found.foot_m(np.zeros(4)) == pytest.approx([100 - PLINTH_M] * 4)
    assert not found.sunk(top_m).any()
    sunk = ground_objects(houses(*[house(0, 0)] * 4), slope).sunk(top_m)
    assert sunk.tolist() == [True, True, False, False]


def test_a_plinth_reaches_below_every_terrain_that_may_be_drawn_with_the_house() -> None:
    asked = []

    def coarser(lon: np.ndarray, lat: np.ndarray, within_m: np.ndarray) -> np.ndarray:
        assert lat.max() < 1
        asked.append(within_m)
        east = np.degrees(lon) * DEGREE_M
        return np.where(within_m > 60, 80 + east / 10, np.inf)  # 20 m deeper

    small, large = house(50, 0, 20), house(50, 0, 40)
    found = ground_objects(houses(small, large, small), slope, None, coarser)
    assert found.plinth_m == pytest.approx([PLINTH_M, PLINTH_M + 20, PLINTH_M])
    assert np.unique(np.concatenate(asked)) == pytest.approx(
        THRESHOLD_RATIO * np.array([20, 40]), rel=0.01
    )
    tall = ground_objects(houses(small), slope, np.array([40.0]), coarser)
    assert tall.plinth_m == pytest.approx([PLINTH_M + 20])


def test_a_proxy_begins_below_every_terrain_that_may_be_drawn_with_the_whole_of_it() -> (
    None
):
    def coarser(lon: np.ndarray, lat: np.ndarray, within_m: np.ndarray) -> np.ndarray:
        assert lat.max() < 1
        return np.where(within_m > 500, 80 + np.degrees(lon) * DEGREE_M / 10, np.inf)

    boxes = houses(*[house(0, 0, 100)] * 4)
    lean = np.array([(0, 0), (0, 0), (0.1, 0), (0, 0)])
    dimension_m = np.array([100, 1000, 1000, 100])
    terrain = slope, coarser
    foot_m = proxy_feet_m(boxes, np.array([95, 95, 95, 60]), lean, dimension_m, terrain)
    less_m = PLINTH_M + 100 * PROXY_SLACK
    expected = [min(95, 100 - less_m), 80 - less_m, 85 - less_m, 60]
    assert foot_m == pytest.approx(expected, abs=0.05)


def test_places_are_on_every_corner_and_nowhere_far_apart() -> None:
    ring = np.array([(40, 8), (45, 8), (45, 12), (40, 8)]) / DEGREE_M
    court = shapely.Polygon(shapely.box(0, 0, 1e-3, 1e-3).exterior, [ring])
    two = shapely.MultiPolygon([house(500, 0), house(30, 0, 3)])
    shapes = houses(two, court, house(7, 7))
    places = places_of(shapes, 10.0)
    for k, shape in enumerate(shapes):
        middle, *along = shapely.points(places.deg[places.start[k] : places.start[k + 1]])
        largest = max(shapely.get_parts(shape), key=shapely.area)
        expected = shapely.Polygon(largest.exterior).centroid
        assert middle.distance(expected) * DEGREE_M < 1e-6
        assert max(one.distance(shape.boundary) for one in along) * DEGREE_M < 1e-6
        corners = shapely.points(shapely.get_coordinates(shape))
        edge = shapely.points(shapely.get_coordinates(shape.boundary.segmentize(1e-6)))
        known = shapely.MultiPoint(along)
        assert max(known.distance(one) for one in corners) * DEGREE_M < 1e-6
        assert max(known.distance(one) for one in edge) * DEGREE_M < 5.05


def test_a_building_in_parts_beside_the_antimeridian_is_as_large_as_its_parts() -> None:
    parts = shapely.box(179.9999, 0, 180, 2e-4), shapely.box(-180, 0, -179.9999, 2e-4)
    places = places_of(houses(shapely.MultiPolygon(parts)))
    assert places.size_m == pytest.approx(2e-4 * DEGREE_M, rel=0.01)


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
