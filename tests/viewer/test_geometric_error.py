# SPDX-License-Identifier: Apache-2.0
"""The error of frames whose drawn terrain is wrong by a known distance."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tiles.posts import LAT_DEG, LON_DEG, STEP_DEG, source, tree_of
from tests.viewer.conftest import Make
from tests.viewer.worlds import make_world, one_colour, terrain_tile, whole_list
from tiles import cells
from tiles.post_tree import PostTree
from viewer.accuracy import seen_in
from viewer.camera import Pose, view_state
from viewer.drawn_surface import boxes_of, join
from viewer.geometric_error import FrameError, geometric_error

SIZE = (120, 90)
GROUND_M, EYE_M = 400.0, 2400.0
LEVEL = 11
CELL = int(cells.cell_at(np.radians(LON_DEG + 0.1), np.radians(LAT_DEG - 0.1), LEVEL))


def slope(lon: Any, lat: Any, rise: float = 0.3) -> Any:  # noqa: ARG001
    """A roof: rises to both sides of the cell's middle meridian, in ECEF nearly plane."""
    west, _, east, _ = (float(x) for x in cells.bounds_rad(CELL))
    metres = np.abs(lon - (west + east) / 2) * 6378137.0 * np.cos(np.radians(LAT_DEG - 0.1))
    return GROUND_M + rise * metres


def posts(folder: Path, height: Any) -> PostTree:
    """Posts on the vertices' own places, so that a mesh can be exact, and beyond them."""
    west, south, east, north = np.degrees(cells.bounds_rad(CELL))
    step = (east - west) / 16, (north - south) / 16
    lon = np.radians(west + step[0] * np.arange(-32, 49))
    lat = np.radians(north - step[1] * np.arange(-32, 49))
    heights = height(lon[None, :], lat[:, None]) + np.zeros((81, 81))
    left, top = west - 32.5 * step[0], north + 32.5 * step[1]
    return tree_of(folder, source(heights, (step[0], 0, left, 0, -step[1], top)))


def look(
    make_renderer: Make,
    tree: PostTree,
    drawn: Any,
    pitch_deg: float = -90.0,
    leaf_m: float = 0.0,
    threshold_px: float = 1.0,
) -> FrameError:
    tile = terrain_tile(CELL, one_colour((90, 90, 90)), 17, drawn)
    world = make_world([tile])
    west, south, east, north = (float(x) for x in cells.bounds_rad(CELL))
    pose = Pose((west + east) / 2, (south + north) / 2, EYE_M, 0.3, np.radians(pitch_deg))
    renderer = make_renderer(world, SIZE)
    view = view_state(pose, SIZE, np.radians(25))
    renderer.draw(whole_list(world, view), view)
    seen = seen_in(renderer, view)
    surface = join([boxes_of(tile)])
    return geometric_error(tree, surface, np.array([leaf_m]), seen, threshold_px)


def flat(lon: Any, lat: Any) -> Any:
    return GROUND_M + 0.0 * (lon + lat)


FOCAL_PX = SIZE[1] / (2 * np.tan(np.radians(25) / 2))


def test_a_mesh_of_the_posts_themselves_has_no_error(
    make_renderer: Make, tmp_path: Path
) -> None:
    for height in (flat, slope):
        frame = look(make_renderer, posts(tmp_path / height.__name__, height), height)
        assert np.isfinite(frame.error_px).all()
        assert frame.error_px.max() < 0.021  # not searched further below 0.02 px
        assert (frame.excess <= 1).all()
        assert not len(frame.silhouette.moved_px)


@pytest.mark.parametrize("by_m", [-60.0, 25.0, 90.0])
def test_a_mesh_that_is_displaced_errs_by_that(
    make_renderer: Make, tmp_path: Path, by_m: float
) -> None:
    tree = posts(tmp_path, flat)
    frame = look(make_renderer, tree, lambda lon, lat: flat(lon, lat) + by_m)
    depth_m = EYE_M - GROUND_M - max(by_m, 0.0)  # the nearer of the two surfaces
    assert frame.error_px[45, 60] == pytest.approx(abs(by_m) * FOCAL_PX / depth_m, rel=2e-3)
    # The same distance and, nearly, the same depth in every pixel.
    assert np.ptp(frame.error_px) < 0.02 * frame.error_px.mean()


def test_the_shortest_distance_counts_not_the_vertical_one(
    make_renderer: Make, tmp_path: Path
) -> None:
    rise, by_m = 1.0, 40.0

    def steep(lon: Any, lat: Any) -> Any:
        return slope(lon, lat, rise)

    tree = posts(tmp_path, steep)
    frame = look(make_renderer, tree, lambda lon, lat: steep(lon, lat) + by_m)
    at = frame.error_px[45, 10]
    heights = (EYE_M - GROUND_M - 700.0, EYE_M - GROUND_M - by_m)
    low, high = (by_m / np.hypot(1, rise) * FOCAL_PX / depth for depth in heights[::-1])
    assert low < at < high


def test_an_error_that_the_leaf_states_is_within(
    make_renderer: Make, tmp_path: Path
) -> None:
    tree = posts(tmp_path, flat)

    def higher(lon: Any, lat: Any) -> Any:
        return flat(lon, lat) + 60.0

    for leaf_m, within in ((0.0, False), (59.0, False), (61.0, True)):
        frame = look(make_renderer, tree, higher, leaf_m=leaf_m)
        assert ((frame.excess <= 1) == within).all()
    assert look(make_renderer, tree, higher, threshold_px=20.0).excess.max() < 1


def test_a_bump_that_was_not_drawn_is_found_by_the_reference(
    make_renderer: Make, tmp_path: Path
) -> None:
    middle = np.radians(np.degrees(cells.bounds_rad(CELL)))
    lon0, lat0 = (middle[0] + middle[2]) / 2, (middle[1] + middle[3]) / 2

    def spike(lon: Any, lat: Any) -> Any:
        near = (np.abs(lon - lon0) < 1e-6) & (np.abs(lat - lat0) < 1e-6)
        return np.where(near, GROUND_M + 300.0, GROUND_M)

    frame = look(make_renderer, posts(tmp_path, spike), flat)
    expected = 300.0 * FOCAL_PX / (EYE_M - GROUND_M - 300.0)
    # The drawn plane is near the spike's flanks; only its top is that far from the plane.
    assert frame.error_px.max() == pytest.approx(expected, rel=0.05)
    assert np.median(frame.error_px) < 0.021


def test_places_without_posts_and_the_sky_are_not_judged(
    make_renderer: Make, tmp_path: Path
) -> None:
    far = source(np.zeros((9, 9)), (STEP_DEG, 0, LON_DEG + 5, 0, -STEP_DEG, LAT_DEG))
    frame = look(make_renderer, tree_of(tmp_path, far), flat, -89.0)
    assert frame.earth.all()
    assert np.isnan(frame.error_px).all()
    assert frame.silhouette.compared == 0
    frame = look(make_renderer, posts(tmp_path / "near", flat), flat, 60.0)
    assert not frame.earth.any()
    assert np.isnan(frame.error_px).all()
