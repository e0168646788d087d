# SPDX-License-Identifier: Apache-2.0
"""Rays and distances against every triangle, one by one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tiles.posts import (
    LAT_DEG,
    LON_DEG,
    STEP_DEG,
    UTM,
    first_hit,
    hills,
    shortest,
    source,
    tree_of,
    triangles_of,
)
from tiles import geodesy
from tiles.post_distance import distances
from tiles.post_rays import ends_below
from tiles.post_search import BENT, NOWHERE, first_hits, owners
from tiles.post_tree import PostTree

Floats = np.ndarray[Any, np.dtype[np.float64]]


def cast(tree: PostTree, eye: Floats, ways: Floats) -> tuple[Floats, Floats]:
    out, owner = np.empty(len(ways)), np.empty(len(ways), np.int64)
    first_hits(tree, tuple(eye), ways, np.full(len(ways), np.inf), owner, out)
    return out, owner


def own(tree: PostTree, points: Floats) -> tuple[Floats, Floats]:
    owner, above = np.empty(len(points), np.int64), np.empty(len(points))
    owners(tree, points, owner, above)
    return owner, above


def place(lon_deg: Any, lat_deg: Any, height_m: Any) -> Floats:
    return np.asarray(geodesy.to_ecef(np.radians(lon_deg), np.radians(lat_deg), height_m))


def globe() -> dict[str, Any]:
    return source(hills(30, 60, rough_m=4000.0), (6, 0, -180, 0, -6, 90), spacing_m=6e5)


SOURCES = {
    "hills": (source(hills(60, 70)), (LON_DEG + 0.15, LAT_DEG - 0.1)),
    "holes": (
        source(np.where(hills(60, 70, 8) % 5 < 1, np.nan, hills(60, 70))),
        (LON_DEG + 0.15, LAT_DEG - 0.1),
    ),
    "UTM": (source(hills(80, 70), (30, 0, 5e5, 0, -30, 5e6), UTM, 30.0), (9.01, 45.144)),
    "globe": (globe(), (179.9, 20.0)),
}


@pytest.mark.parametrize("name", SOURCES)
def test_rays_meet_what_brute_force_meets(
    name: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    one, at = SOURCES[name]
    tree, every = tree_of(tmp_path, one), triangles_of(one)
    found = 0
    for height_m in (1500.0, 6000.0, 3e6):
        eye = place(*at, height_m)
        targets = every[rng.integers(len(every), size=60)].mean(axis=1)
        ways = targets + rng.normal(size=(60, 3)) * 2000 - eye
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        out, _ = cast(tree, eye, ways)
        expected = np.array([first_hit(every, eye, way) for way in ways])
        # The caps at the poles are not among the triangles of brute force.
        both = np.isfinite(expected)
        assert np.allclose(out[both], expected[both], rtol=0, atol=1e-5)
        assert name == "globe" or np.isinf(out[~both]).all()
        found += int(both.sum())
    assert found > 30


@pytest.mark.parametrize("name", SOURCES)
def test_shortest_distances_are_those_of_brute_force(
    name: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    one, _ = SOURCES[name]
    tree, every = tree_of(tmp_path, one), triangles_of(one)
    spread = 3e5 if name == "globe" else 900.0
    points = every[rng.integers(len(every), size=80)].mean(axis=1)
    points = points + rng.normal(size=(80, 3)) * spread * rng.uniform(size=(80, 1))
    points = points[np.abs(points[:, 2]) < 6.1e6]
    none = np.full(len(points), np.inf)
    nobody = np.zeros(len(points), np.int64)
    found = distances(tree, points, nobody, none, np.zeros(len(points)))
    expected = [shortest(every, point) for point in points]
    assert np.allclose(found, expected, rtol=1e-9, atol=1e-6)


def test_a_bound_that_is_known_comes_back_where_nothing_is_nearer(tmp_path: Path) -> None:
    one = source(np.zeros((20, 20)))
    tree = tree_of(tmp_path, one)
    points = place(LON_DEG + 10 * STEP_DEG, LAT_DEG - 10 * STEP_DEG, np.array([50.0, 50.0]))
    index, enough = np.zeros(2, np.int64), np.zeros(2)
    found = distances(tree, points, index, np.array([20.0, 80.0]), enough)
    assert found[0] == 20.0
    assert found[1] == pytest.approx(50.0, abs=0.02)


def test_no_ray_slips_between_triangles(tmp_path: Path, rng: np.random.Generator) -> None:
    tree = tree_of(tmp_path, globe())
    eye = place(0.0, 0.0, 2e7)
    # Through the posts themselves and along the squares' edges.
    lon, lat = np.meshgrid(np.arange(-42, 43, 3.0), np.arange(-42, 43, 3.0))
    ways = place(lon.ravel(), lat.ravel(), 0.0) - eye
    ways = np.concatenate([ways, ways + rng.normal(size=ways.shape) * 1e4])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    out, owner = cast(tree, eye, ways)
    assert (out < 2.4e7).all()
    assert (owner == 0).all()
    poles = np.array([[0, 0, 1.0], [0, 0, -1.0], [1e-9, 0, 1.0], [0, 1e-4, -1.0]])
    for way in poles:
        met, _ = cast(tree, -2e7 * way, np.atleast_2d(way))
        assert met[0] == pytest.approx(2e7 - 6356752.3, abs=6000)


def test_the_finest_source_with_data_owns_a_place(tmp_path: Path) -> None:
    fine = np.full((41, 41), 500.0)
    fine[10:20, 10:20] = np.nan
    step = STEP_DEG / 5
    inside = (step, 0, LON_DEG + 0.1, 0, -step, LAT_DEG - 0.1)
    coarse = source(np.zeros((60, 60)))
    tree = tree_of(tmp_path, coarse, source(fine, inside, spacing_m=100.0))
    lon = LON_DEG + 0.1 + step * np.array([5.5, 14.5, 30.5, 60.5, 900.0])
    points = place(lon, LAT_DEG - 0.1 - step * 14.5, 700.0)
    owner, above = own(tree, points)
    assert owner.tolist() == [0, 1, 0, 1, NOWHERE]
    assert np.allclose(above[:4], [-200, -700, -200, -700], atol=0.1)
    # Rays pass through the coarse posts that lie below or above finer ones.
    eye = place(lon[0], LAT_DEG - 0.1 - step * 14.5, 4000.0)
    ways = points - eye
    ways[0] = -eye
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    out, who = cast(tree, eye, ways)
    assert who[:2].tolist() == [0, 1]
    assert out[0] == pytest.approx(3500.0, abs=1.0)


def test_a_coarse_surface_above_a_finer_one_is_not_there(tmp_path: Path) -> None:
    step = STEP_DEG / 5
    inside = (step, 0, LON_DEG + 0.1, 0, -step, LAT_DEG - 0.1)
    coarse = source(np.full((60, 60), 900.0))
    tree = tree_of(tmp_path, coarse, source(np.zeros((41, 41)), inside, spacing_m=100.0))
    eye = place(LON_DEG + 0.1 + step * 20, LAT_DEG - 0.1 - step * 20, 4000.0)
    out, who = cast(tree, eye, np.atleast_2d(-eye / np.linalg.norm(eye)))
    assert who[0] == 0
    assert out[0] == pytest.approx(4000.0, abs=0.1)


def test_places_around_a_finer_source_are_bent(tmp_path: Path) -> None:
    step, reach_m = STEP_DEG / 5, 800.0
    inside = (step, 0, LON_DEG + 0.1, 0, -step, LAT_DEG - 0.1)
    fine = source(np.full((41, 41), 900.0), inside, spacing_m=100.0, reach_m=reach_m)
    tree = tree_of(tmp_path, source(np.zeros((60, 60))), fine)
    west_m = np.array([-300.0, 100.0, 700.0, 900.0, 3000.0])
    metre = np.degrees(1 / 6378137.0) / np.cos(np.radians(LAT_DEG - 0.12))
    lon = LON_DEG + 0.1 + step / 2 - west_m * metre
    owner, _ = own(tree, place(lon, LAT_DEG - 0.12, 0.0))
    assert owner.tolist() == [0, BENT, BENT, 1, 1]


def test_rays_end_where_they_go_below_a_height() -> None:
    eye = place(30.0, 40.0, 1e6)
    down = -geodesy.up(np.radians(30.0), np.radians(40.0))
    ends = ends_below(tuple(eye), np.stack([down, -down]), -1000.0)
    assert ends[0] == pytest.approx(1001e3, abs=1.0)
    assert ends[1] == np.inf
