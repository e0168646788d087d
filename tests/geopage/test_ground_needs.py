# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from geopage.ground_needs import ground_needs_of, work_of
from geopage.outlook import COLUMNS, LINES, outlook, ray_ends
from geopage.prediction import motion_of, predict
from geopage.screen_error import lens_of
from geopage.selection import Thresholds, select
from geopage.tree import Tree
from tests.geopage.worlds import SPOT, view_at
from tiles import geodesy
from tiles.forest import Forest
from tiles.frames import Ecef
from tiles.lanes import Lane
from viewer.area_error import by_area, screen_errors_px, to_ground

VIEWS = [(1e7, -90.0), (1e5, -60.0), (2e3, -20.0), (60.0, -45.0)]
AT_ONCE = np.zeros(1)


def test_the_views_ahead_are_the_predicted_ones() -> None:
    there = SPOT[0] + 1e-4, SPOT[1]
    views = [view_at(500.0, there, -50.0), view_at(450.0, SPOT, -45.0, 6.0, t_s=0.2)]
    motion = motion_of(views, 3.0)
    assert motion
    times_s = np.array((0.1, 1.0, 8.0))
    ahead = outlook(views[1], motion, 3.0, times_s)
    for k, t_s in enumerate(times_s.tolist()):
        soon = predict(views[1], motion, t_s)
        assert np.abs(ahead.eye[k] - soon.eye).max() < 1e-6
        assert np.abs(ahead.rotation[k] - soon.rotation).max() < 1e-9


@pytest.mark.parametrize(("height_m", "pitch_deg"), VIEWS)
def test_rays_end_where_the_measure_looks(height_m: float, pitch_deg: float) -> None:
    view, ground_m = view_at(height_m, pitch_deg=pitch_deg), 12.0
    ends = np.empty((COLUMNS * LINES, 3))
    count = ray_ends(outlook(view, None, ground_m, AT_ONCE), 0, np.empty(3), ends)
    away = to_ground(view, ground_m)
    lon, lat, _ = geodesy.to_geodetic(Ecef(view.eye + away))
    assert count == len(away) > 0
    assert np.allclose(ends[:count, 0], away @ view.forward)
    assert np.abs(ends[:count, 1] - lon).max() < 1e-12
    assert np.abs(ends[:count, 2] - lat).max() < 1e-11


@pytest.mark.parametrize(("height_m", "pitch_deg"), VIEWS)
@pytest.mark.parametrize("levels", [1, 3])
def test_what_a_picture_needs_makes_it_good(
    forests: dict[Lane, Forest],
    trees: dict[Lane, Tree],
    height_m: float,
    pitch_deg: float,
    levels: int,
) -> None:
    land, view, tau = trees[Lane.TERRAIN], view_at(height_m, pitch_deg=pitch_deg), 2.0
    there = {Lane.TERRAIN: (land.level < levels).astype(np.uint8)}
    there[Lane.OBJECTS] = np.zeros(len(trees[Lane.OBJECTS].parent), np.uint8)
    ahead, work = outlook(view, None, 0.0, AT_ONCE), work_of(land)
    needs = ground_needs_of(land, there[Lane.TERRAIN], ahead, tau, 1, work)
    assert not work.rays.any()
    assert not there[Lane.TERRAIN][needs.rows].any()
    there[Lane.TERRAIN][needs.rows] = 1
    limits = Thresholds(tau, tau)
    drawn = select(trees, lens_of(view), there, limits).draw_list(
        1, view, limits, settled=True
    )
    cell = forests[Lane.TERRAIN].records["cell"]
    assert by_area(screen_errors_px(land, cell, drawn, view, 0.0), 95.0) <= tau
    again = ground_needs_of(land, there[Lane.TERRAIN], ahead, tau, 4, work)
    assert len(again.rows) == 0


def test_a_coarser_goal_takes_fewer_bytes(trees: dict[Lane, Tree]) -> None:
    land, view = trees[Lane.TERRAIN], view_at(2e3, pitch_deg=-40.0)
    there = (land.level < 1).astype(np.uint8)
    ahead = outlook(view, None, 0.0, AT_ONCE)
    needs = ground_needs_of(land, there, ahead, 2.0, 4, work_of(land))
    size = [
        int(land.tile_bytes[needs.rows[a:b]].sum())
        for a, b in zip(needs.start[:-1], needs.start[1:], strict=True)
    ]
    assert size == sorted(size, reverse=True)
    assert size[0] > size[-1]
