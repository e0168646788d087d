# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from geopage.selection import ideal, trees_of
from tests.geopage.worlds import SPOT, deep_globe, object_records, view_at
from tiles import cells, geodesy
from tiles.forest import build_forest
from tiles.frames import Ecef
from tiles.lanes import Lane
from viewer.area_error import by_area, screen_errors_px, to_ground

FORESTS = {
    Lane.TERRAIN: build_forest(deep_globe()),
    Lane.OBJECTS: build_forest(object_records()),
}
TREE = trees_of(FORESTS)[Lane.TERRAIN]
CELL = FORESTS[Lane.TERRAIN].records["cell"]


@pytest.mark.parametrize("ground_m", [0.0, 3000.0])
@pytest.mark.parametrize("pitch_deg", [-90.0, -30.0, -3.0])
def test_rays_end_at_the_grounds_height(ground_m: float, pitch_deg: float) -> None:
    view = view_at(8e3, pitch_deg=pitch_deg)
    away = to_ground(view, ground_m)
    _, _, height_m = geodesy.to_geodetic(Ecef(view.eye + away))
    # The ellipsoid is stretched, not grown: a few metres at the most.
    np.testing.assert_allclose(height_m, ground_m, atol=max(1e-3, ground_m * 2e-3))
    assert len(away) == 576 if pitch_deg == -90 else 0 < len(away) <= 576


def test_rays_to_the_sky_meet_nothing() -> None:
    assert not len(to_ground(view_at(100.0, pitch_deg=60.0), 0.0))
    assert by_area(np.zeros(0), 95) == 0.0


def test_the_error_is_that_of_the_tile_which_a_ray_meets() -> None:
    view = view_at(2e6)
    drawn = ideal(FORESTS, view, 100.0, 100.0)
    errors_px = screen_errors_px(TREE, CELL, drawn, view, 0.0)
    away = to_ground(view, 0.0)
    lon, lat, _ = geodesy.to_geodetic(Ecef(view.eye + away))
    for i in range(0, len(away), 37):
        hit = [r for r in drawn.terrain.tolist() if holds(r, float(lon[i]), float(lat[i]))]
        assert len(hit) == 1
        depth_m = away[i] @ view.forward
        whole = (TREE.children[hit[0]] >= 0).all()
        expected = TREE.error_m[hit[0]] * view.focal_px / depth_m if whole else 0.0
        assert errors_px[i] == pytest.approx(expected)
    assert errors_px.max() > 0


def holds(row: int, lon: float, lat: float) -> bool:
    west, south, east, north = cells.bounds_rad(int(CELL[row]))
    return bool(west <= lon < east and south <= lat < north)


def test_what_is_within_the_threshold_is_within_it_by_area() -> None:
    for height_m in (1e7, 1e5, 3e3):
        view = view_at(height_m, SPOT, -50.0)
        drawn = ideal(FORESTS, view, 2.0, 2.0)
        assert by_area(screen_errors_px(TREE, CELL, drawn, view, 0.0), 95) <= 2.0
