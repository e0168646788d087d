# SPDX-License-Identifier: Apache-2.0
"""Proxies: boxes over the footprints, and an error that is measured both ways."""

import numpy as np
import pytest
import shapely

from ingest.extrude import extrude
from ingest.proxies import MAX_GRID, Boxes, Solids, make_boxes, measure, sample_surfaces
from ingest.repair import area_m2, metres_per_degree
from tiles.frames import Floats

DEGREE_M = 111_194.0


def block(
    rng: np.random.Generator, count: int, lat: float = 0.0
) -> tuple[Solids, np.ndarray]:
    """Houses of 5 to 20 m in a square of 300 m, and their footprints."""
    low = rng.uniform(0, 300, (count, 2))
    size = rng.uniform(5, 20, (count, 2))
    scale = np.array([np.cos(np.radians(lat)), 1.0]) * DEGREE_M
    bounds = np.hstack((low / scale, (low + size) / scale)) + np.array([0, lat, 0, lat])
    polygon = np.asarray(shapely.box(*bounds.T), object)
    ground = rng.uniform(100, 110, count)
    top = ground + rng.uniform(3, 25, count)
    return Solids(bounds, area_m2(polygon), ground - 1, ground, top), polygon


def whole(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0]), np.array([count])


def test_boxes_have_the_area_of_the_footprints_and_lie_within_the_block(
    rng: np.random.Generator,
) -> None:
    solids, polygon = block(rng, 80)
    boxes = make_boxes(solids, *whole(80))
    assert len(boxes.group) <= min(MAX_GRID**2, 80)
    assert area_m2(boxes.polygon).sum() == pytest.approx(solids.area_m2.sum(), rel=0.2)
    around = shapely.box(*shapely.total_bounds(polygon)).buffer(1e-9)
    assert shapely.within(boxes.polygon, around).all()
    assert boxes.foot_m.min() == solids.foot_m.min()
    assert (boxes.top_m <= solids.top_m.max()).all()
    assert (boxes.top_m >= solids.top_m.min()).all()


def test_a_single_house_is_its_own_proxy_within_the_sampling(
    rng: np.random.Generator,
) -> None:
    solids, polygon = block(rng, 1)
    boxes = make_boxes(solids, *whole(1))
    assert np.allclose(boxes.bounds_deg, solids.bounds_deg, rtol=0, atol=1e-8)
    assert boxes.top_m == solids.top_m
    samples = sample_surfaces(extrude(polygon, solids.foot_m, solids.top_m))
    assert measure(boxes, samples, *whole(1))[0] < 10


def test_groups_do_not_mix(rng: np.random.Generator) -> None:
    solids, _ = block(rng, 60)
    first, last = np.array([0, 10, 10]), np.array([10, 60, 30])
    together = make_boxes(solids, first, last)
    for g in range(3):
        alone = make_boxes(solids, first[g : g + 1], last[g : g + 1])
        mine = together.group == g
        assert np.array_equal(together.bounds_deg[mine], alone.bounds_deg)
        assert np.array_equal(together.top_m[mine], alone.top_m)


def brute_force_m(boxes: Boxes, real: Floats, scale: Floats) -> float:
    """The same two maxima of minima, written plainly."""
    low = np.column_stack((boxes.bounds_deg[:, :2] * scale, boxes.foot_m))
    high = np.column_stack((boxes.bounds_deg[:, 2:] * scale, boxes.top_m))
    points = real * np.append(scale, 1.0)
    out = np.maximum(np.maximum(low - points[:, None], points[:, None] - high), 0)
    there = np.linalg.norm(out, axis=2).min(axis=1).max()
    shares = np.array([(i / 4, j / 4) for i in range(5) for j in range(5)])
    roof = low[:, None, :2] + (high - low)[:, None, :2] * shares
    rim = roof[:, ((shares == 0) | (shares == 1)).any(axis=1)]
    middle = (boxes.top_m + boxes.ground_m) / 2
    surface = [(p, boxes.top_m) for p in roof.transpose(1, 0, 2)]
    surface += [(p, middle) for p in rim.transpose(1, 0, 2)]
    found = np.concatenate([np.column_stack(pair) for pair in surface])
    back = np.linalg.norm(found[:, None] - points[None], axis=2).min(axis=1).max()
    return float(max(there, back))


@pytest.mark.parametrize("lat", [0.01, 60.0])
def test_the_error_is_the_largest_distance_between_boxes_and_points_both_ways(
    rng: np.random.Generator, lat: float
) -> None:
    solids, polygon = block(rng, 40, lat)
    boxes = make_boxes(solids, *whole(40))
    samples = sample_surfaces(extrude(polygon, solids.foot_m, solids.top_m))
    error = measure(boxes, samples, *whole(40))
    scale = np.array([metres_per_degree(np.array([lat]))[k][0] for k in range(2)])
    assert error[0] == pytest.approx(brute_force_m(boxes, samples.place, scale), rel=1e-3)


def test_samples_lie_on_the_buildings_and_every_building_has_some(
    rng: np.random.Generator,
) -> None:
    solids, polygon = block(rng, 30)
    samples = sample_surfaces(extrude(polygon, solids.foot_m, solids.top_m))
    for k in range(30):
        place = samples.place[samples.start[k] : samples.start[k + 1]]
        assert len(place) >= 5
        west, south, east, north = solids.bounds_deg[k]
        roof = np.isclose(place[:, 2], solids.top_m[k])
        side = np.isclose(place[:, :1], (west, east), rtol=0, atol=1e-9).any(axis=1)
        side |= np.isclose(place[:, 1:2], (south, north), rtol=0, atol=1e-9).any(axis=1)
        assert (roof | side).all()
        assert place[:, 2].min() >= solids.foot_m[k] - 1e-6


def test_the_error_is_the_same_every_time(rng: np.random.Generator) -> None:
    solids, polygon = block(rng, 25)
    prisms = extrude(polygon, solids.foot_m, solids.top_m)
    boxes = make_boxes(solids, *whole(25))
    twice = [measure(boxes, sample_surfaces(prisms), *whole(25))[0] for _ in range(2)]
    assert twice[0] == twice[1]
