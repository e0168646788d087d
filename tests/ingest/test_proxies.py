# SPDX-License-Identifier: Apache-2.0
"""Proxies: boxes over buildings, and an error that is never understated."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely import affinity

from ingest.extrude import extrude
from ingest.proxies import MAX_BOXES, Boxes, leaning, make_boxes, measure
from ingest.proxy_solids import Solids, low_roofs_m, solids_of
from ingest.repair import area_m2, metres_per_degree
from tiles.frames import Floats, Ints
from tiles.mesh import WALL

EAST, NORTH = 7.0, 45.0
SCALE = np.array([float(m[0]) for m in metres_per_degree(np.array([NORTH]))])
Plane = Callable[[Floats], Floats]
"""Heights of places, (n, 2) m"""
Body = tuple[shapely.Geometry, Plane, Plane]


@dataclass(frozen=True, slots=True)
class Town:
    """Houses on a slope, in metres around (EAST, NORTH), and as solids."""

    plan: NDArray[np.object_]
    foot_m: Floats
    top_m: Floats
    slope: tuple[float, float]
    solids: Solids

    def ground_m(self, place: Floats) -> Floats:
        """Height of the ground, which is drawn beside both towns and boxes."""
        return 100.0 + np.asarray(place[..., :2] @ np.array(self.slope))


def degrees(plan: NDArray[np.object_]) -> NDArray[np.object_]:
    return np.asarray(
        shapely.transform(plan, lambda xy: xy / SCALE + (EAST, NORTH)), object
    )


def metres(deg: Floats) -> Floats:
    return np.asarray((deg - (EAST, NORTH)) * SCALE)


def town(
    rng: np.random.Generator,
    count: int,
    turn_deg: float = 0.0,
    slope: tuple[float, float] = (0.0, 0.0),
    *,
    raised: bool = False,
) -> Town:
    """L-shaped houses of 5 to 20 m, 3 to 25 m high, on a turned square of 300 m."""
    size, place = rng.uniform(5, 20, (count, 2)), rng.uniform(0, 300, (count, 2))
    cut = size * rng.uniform(0.4, 0.9, (count, 2))
    houses = np.asarray(shapely.box(0, 0, *size.T), object)
    plan = shapely.difference(houses, shapely.box(*cut.T, *size.T))
    plan = np.asarray(
        [affinity.translate(house, *at) for house, at in zip(plan, place, strict=True)],
        object,
    )
    turn = np.radians(turn_deg)
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    plan = np.asarray(shapely.transform(plan, lambda xy: xy @ turned), object)
    corners, owner = shapely.get_coordinates(plan, return_index=True)
    low = np.full(count, np.inf)
    np.minimum.at(low, owner, 100.0 + corners @ np.array(slope))
    foot = low + (rng.uniform(-2, 6, count) if raised else -1.0)
    top = np.maximum(foot, low) + rng.uniform(3, 25, count)
    return Town(plan, foot, top, slope, solids_of(degrees(plan), foot, low, top))


def whole(count: int) -> tuple[Ints, Ints]:
    return np.array([0]), np.array([count])


def points_in(plan: shapely.Geometry, low_m: Plane, high_m: Plane) -> Floats:
    """Points of a solid, (n, 3): its rim and a grid within it, at four heights."""
    west, south, east, north = plan.bounds
    x, y = np.meshgrid(np.linspace(west, east, 16), np.linspace(south, north, 16))
    grid = np.column_stack((x.ravel(), y.ravel()))
    rim = shapely.get_coordinates(shapely.segmentize(plan, 1.5))
    flat = np.concatenate((grid[shapely.intersects_xy(plan, grid)], rim))
    share = np.linspace(0, 1, 4)[:, None]
    height = low_m(flat) * (1 - share) + high_m(flat) * share
    return np.column_stack((np.tile(flat, (4, 1)), height.ravel()))


def level(height_m: float) -> Plane:
    return lambda flat: np.full(len(flat), height_m)


def body(boxes: Boxes, k: int) -> tuple[shapely.Geometry, Plane, Plane]:
    """A box in metres: its plan, foot and roof."""
    corners = metres(boxes.corner_deg[k])
    middle, lean = corners.mean(axis=0), boxes.lean[k]

    def plane(height_m: float) -> Plane:
        return lambda flat: height_m + (flat - middle) @ lean

    return shapely.Polygon(corners), plane(boxes.foot_m[k]), plane(boxes.top_m[k])


def farthest_m(one: Town, points: Floats, solids: list[Body]) -> float:
    """The largest distance of points above the ground to the nearest solid or ground."""
    above = points[:, 2] - one.ground_m(points)
    points, nearest = points[above > 0], above[above > 0]
    here = shapely.points(points[:, :2])
    for plan, low_m, high_m in solids:
        flat = shapely.distance(here, plan)
        to = shapely.get_coordinates(
            shapely.get_point(shapely.shortest_line(plan, here), 0)
        )
        off = np.maximum(points[:, 2] - high_m(to), low_m(to) - points[:, 2])
        nearest = np.minimum(nearest, np.hypot(flat, np.maximum(off, 0)))
    return float(nearest.max(initial=0))


def truth_m(one: Town, boxes: Boxes) -> float:
    """The Hausdorff distance of a town and boxes, from points in both, plainly."""
    drawn = [body(boxes, k) for k in range(len(boxes.group))]
    real = [
        (plan, level(foot), level(top))
        for plan, foot, top in zip(one.plan, one.foot_m, one.top_m, strict=True)
    ]
    there = max(farthest_m(one, points_in(*solid), drawn) for solid in real)
    return max(there, *(farthest_m(one, points_in(*box), real) for box in drawn))


@pytest.mark.parametrize("raised", [False, True])
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.2, -0.1)])
@pytest.mark.parametrize("count", [2, 7, 50])
def test_the_error_is_no_less_than_the_distance_of_any_point_and_little_more(
    rng: np.random.Generator, count: int, slope: tuple[float, float], *, raised: bool
) -> None:
    one = town(rng, count, 30.0, slope, raised=raised)
    boxes = make_boxes(one.solids, *whole(count))
    error = measure(boxes, one.solids, *whole(count))[0]
    true = truth_m(one, boxes)
    assert true <= error + 1e-6
    bounds = shapely.bounds(one.plan)
    largest = np.hypot(*(bounds[:, 2:] - bounds[:, :2]).T).max()
    assert error < max(1.4 * true + 1, largest)


def test_errors_of_boxes_of_boxes_add_up_to_no_less_than_the_truth(
    rng: np.random.Generator,
) -> None:
    one = town(rng, 120, 10.0, (0.1, 0.15))
    first = np.array([0, 40, 80])
    blocks = make_boxes(one.solids, first, first + 40)
    error = measure(blocks, one.solids, first, first + 40).max()
    heights = blocks.foot_m, blocks.ground_m, blocks.top_m
    below = solids_of(blocks.polygon, *heights, lean=blocks.lean)
    skyline = make_boxes(below, *whole(len(below.top_m)))
    assert len(skyline.group) < len(blocks.group)
    error += measure(skyline, below, *whole(len(below.top_m)))[0]
    assert truth_m(one, skyline) <= error + 1e-6


def test_what_is_left_out_counts_its_largest_side_and_not_how_far_the_next_is() -> None:
    plan = np.asarray(shapely.box([0, 5_000], [0, 0], [10, 5_010], [10, 10]), object)
    level_m = np.full(2, 100.0)
    solids = solids_of(degrees(plan), level_m - 1, level_m, level_m + np.array([8, 6]))
    boxes = make_boxes(solids, *whole(2))
    assert len(boxes.group) == 1
    assert 8 <= measure(boxes, solids, *whole(2))[0] <= 10.1


def test_a_rectangular_house_is_its_own_box() -> None:
    turn = np.radians(33)
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    plan = shapely.transform(
        np.asarray([shapely.box(0, 0, 12, 30)], object), lambda xy: xy @ turned
    )
    height = np.array([100.0])
    solids = solids_of(degrees(plan), height - 1, height, height + 9)
    boxes = make_boxes(solids, *whole(1))
    box = shapely.Polygon(metres(boxes.corner_deg[0]))
    assert box.symmetric_difference(plan[0]).area < 0.1
    assert measure(boxes, solids, *whole(1))[0] < 0.3


def test_boxes_lie_along_turned_streets_and_have_the_area_of_their_buildings(
    rng: np.random.Generator,
) -> None:
    straight, turned = town(rng, 90), town(np.random.default_rng(0), 90, 37.0)
    for one in (straight, turned):
        boxes = make_boxes(one.solids, *whole(90))
        assert len(boxes.group) == 30
        area = area_m2(boxes.polygon).sum()
        assert area == pytest.approx(one.solids.area_m2.sum(), rel=0.02)
        hull = shapely.union_all(one.plan).convex_hull.buffer(0.01)
        assert shapely.within(shapely.polygons(metres(boxes.corner_deg)), hull).mean() > 0.8
    edge = np.diff(metres(boxes.corner_deg)[:, :2], axis=1)[:, 0]
    direction = np.degrees(np.arctan2(edge[:, 1], edge[:, 0])) % 90
    assert np.allclose(direction, 37, rtol=0, atol=0.1)


def test_every_building_is_in_one_box_of_its_group_and_groups_do_not_mix(
    rng: np.random.Generator,
) -> None:
    solids = town(rng, 300).solids
    first, last = np.array([0, 10, 10]), np.array([10, 300, 30])
    together = make_boxes(solids, first, last)
    assert (np.bincount(together.group) <= MAX_BOXES).all()
    error = measure(together, solids, first, last)
    owner = np.repeat(together.group, np.diff(together.start))
    for g in range(3):
        assert np.array_equal(
            np.sort(together.item[owner == g]), np.arange(first[g], last[g])
        )
        alone = make_boxes(solids, first[g : g + 1], last[g : g + 1])
        assert np.array_equal(together.shape[together.group == g], alone.shape)
        assert error[g] == measure(alone, solids, first[g : g + 1], last[g : g + 1])[0]


def test_boxes_lean_as_the_ground_does(rng: np.random.Generator) -> None:
    one = town(rng, 1500, 20.0, (0.25, -0.1))
    boxes = make_boxes(one.solids, *whole(1500))
    assert np.median(boxes.lean, axis=0) == pytest.approx([0.25, -0.1], abs=0.05)
    flat = extrude(boxes.polygon, boxes.foot_m, boxes.top_m)
    centre = boxes.corner_deg.mean(axis=1)
    prisms = leaning(flat, centre, boxes.lean)
    for k in range(0, len(centre), 9):
        mine = slice(prisms.vertex_start[k], prisms.vertex_start[k + 1])
        place = np.degrees(np.column_stack((prisms.lon_rad, prisms.lat_rad)))[mine]
        _, _, roof = body(boxes, k)
        top = prisms.height_m[mine][flat.height_m[mine] == boxes.top_m[k]]
        at = metres(place)[flat.height_m[mine] == boxes.top_m[k]]
        assert np.allclose(top, roof(at), rtol=0, atol=0.01)


def test_a_town_across_the_antimeridian_has_the_same_boxes(
    rng: np.random.Generator,
) -> None:
    one = town(rng, 40)
    by = np.array([180.0 - EAST - 1e-3, 0.0])
    moved, centre = one.solids.edge_deg + np.tile(by, 2), one.solids.centre_deg + by
    moved[:, ::2] = (moved[:, ::2] + 180) % 360 - 180
    centre[:, 0] = (centre[:, 0] + 180) % 360 - 180
    away = one.solids._replace(edge_deg=moved, centre_deg=centre)
    assert centre[:, 0].min() < 0 < centre[:, 0].max()
    error = [
        measure(make_boxes(solids, *whole(40)), solids, *whole(40))[0]
        for solids in (one.solids, away)
    ]
    assert error[0] == pytest.approx(error[1], abs=1e-3)


def test_a_gabled_roof_is_off_a_box_by_half_its_height() -> None:
    plan = np.asarray(shapely.box([0, 40], 0, [10, 50], 10), object)
    ground = np.full(2, 100.0)
    eaves, ridge = ground + np.array([5.0, 8.0]), ground + np.array([9.0, 8.0])
    solids = solids_of(degrees(plan), ground - 1, ground, ridge, eaves)
    boxes = make_boxes(solids, np.array([0, 1]), np.array([1, 2]))
    error = measure(boxes, solids, np.array([0, 1]), np.array([1, 2]))
    assert 2 <= error[0] < 2.4
    assert error[1] < 0.3


def test_the_lowest_point_of_a_roof_is_found() -> None:
    plan = degrees(np.asarray(shapely.box([0, 40], 0, [10, 50], 10), object))
    prisms = extrude(plan, np.array([99.0, 98.0]), np.array([105.0, 107.0]))
    assert low_roofs_m(prisms) == pytest.approx([105, 107])
    bare = prisms.vertices.copy()
    bare["flags"] = WALL
    assert low_roofs_m(replace(prisms, vertices=bare)) == pytest.approx([99, 98])


def test_no_groups_make_no_boxes(rng: np.random.Generator) -> None:
    solids, none = town(rng, 3).solids, np.zeros(0, np.int64)
    boxes = make_boxes(solids, none, none)
    assert len(boxes.polygon) == len(measure(boxes, solids, none, none)) == 0
    assert boxes.lean.shape == (0, 2)
