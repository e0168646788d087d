# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pyproj
import pytest

from tiles import geodesy
from viewer.camera import NEAR_M, Pose, near_m, pixel_rays, project, unproject, view_state

SIZE = (640, 360)
GEOD = pyproj.Geod(ellps="WGS84")
TO_ECEF = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
PLACES = [(-122.447, 37.76), (86.9, 27.99), (7.42, 43.74), (0.0, -89.0), (179.99, 0.0)]


def ecef(lon_deg: float, lat_deg: float, height_m: float = 0.0) -> np.ndarray:
    return np.array(TO_ECEF.transform(lon_deg, lat_deg, height_m))


def pose(
    lon_deg: float, lat_deg: float, height_m: float, heading: float, pitch: float
) -> Pose:
    lon, lat = math.radians(lon_deg), math.radians(lat_deg)
    return Pose(lon, lat, height_m, math.radians(heading), math.radians(pitch))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("height_m", [10.0, 1e4, 1e7])
def test_looking_down_sees_the_ground_below(
    place: tuple[float, float], height_m: float
) -> None:
    view = view_state(pose(*place, height_m, 33.0, -90.0), SIZE)
    x, y, depth = project(view, ecef(*place))
    assert x == pytest.approx(SIZE[0] / 2, abs=1e-3)
    assert y == pytest.approx(SIZE[1] / 2, abs=1e-3)
    assert depth == pytest.approx(height_m, rel=1e-6)


@pytest.mark.parametrize("place", PLACES[:3])
@pytest.mark.parametrize("heading", [0.0, 90.0, 180.0, 270.0, 37.0])
def test_a_level_look_meets_what_lies_that_way(
    place: tuple[float, float], heading: float
) -> None:
    lon, lat, _ = GEOD.fwd(*place, heading, 1000.0)
    view = view_state(pose(*place, 100.0, heading, 0.0), SIZE)
    x, y, depth = project(view, ecef(lon, lat, 100.0))
    assert x == pytest.approx(SIZE[0] / 2, abs=0.1)
    assert y == pytest.approx(SIZE[1] / 2, abs=0.1)
    assert depth == pytest.approx(1000.0, rel=1e-3)


def test_straight_down_the_heading_points_up_in_the_picture() -> None:
    view = view_state(pose(*PLACES[0], 1000.0, 90.0, -90.0), SIZE)
    lon, lat, _ = GEOD.fwd(*PLACES[0], 90.0, 50.0)
    x, y, _ = project(view, ecef(lon, lat))
    assert x == pytest.approx(SIZE[0] / 2, abs=0.1)
    assert y < SIZE[1] / 2 - 10


def test_what_is_higher_is_higher_in_the_picture() -> None:
    view = view_state(pose(*PLACES[2], 100.0, 0.0, 0.0), SIZE)
    lon, lat, _ = GEOD.fwd(*PLACES[2], 0.0, 500.0)
    low, high = project(view, ecef(lon, lat, 50.0)), project(view, ecef(lon, lat, 150.0))
    assert high[1] < SIZE[1] / 2 < low[1]


def test_the_rotation_is_orthonormal_and_right_handed(rng: np.random.Generator) -> None:
    for _ in range(20):
        angles = rng.uniform(-1.5, 1.5, 4)
        view = view_state(Pose(*angles[:2], 5.0, *angles[2:]), SIZE)
        assert np.allclose(view.rotation @ view.rotation.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(view.rotation) == pytest.approx(1.0)


def test_the_field_of_view_spans_the_picture() -> None:
    view = view_state(pose(*PLACES[0], 10.0, 0.0, 0.0), SIZE, math.radians(60.0))
    rays = pixel_rays(view)
    up, down = rays[0, SIZE[0] // 2], rays[-1, SIZE[0] // 2]
    assert math.degrees(math.acos(up @ down)) == pytest.approx(60.0, abs=0.3)


def test_a_pixels_ray_projects_to_that_pixel() -> None:
    view = view_state(pose(*PLACES[1], 9000.0, 200.0, -17.0), SIZE)
    points = view.eye + pixel_rays(view) * 12_345.0
    seen = project(view, points)
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    assert np.abs(seen[..., 0] - x).max() < 1e-6
    assert np.abs(seen[..., 1] - y).max() < 1e-6


def test_the_eye_is_where_pyproj_puts_it() -> None:
    view = view_state(pose(*PLACES[3], 1234.5, 0.0, 0.0), SIZE)
    assert np.linalg.norm(view.eye - ecef(*PLACES[3], 1234.5)) < 1e-6
    assert geodesy.to_geodetic(view.eye)[2] == pytest.approx(1234.5, abs=1e-6)


@pytest.mark.parametrize("fov_deg", [20.0, 60.0, 165.0])
def test_in_a_corner_no_more_is_cut_off_than_ahead(fov_deg: float) -> None:
    view = view_state(pose(*PLACES[1], 2.0, 0.0, 0.0), SIZE, math.radians(fov_deg))
    depth_m = NEAR_M * pixel_rays(view) @ view.forward
    assert near_m(view) == pytest.approx(depth_m.min(), rel=0.1)
    assert near_m(view) < depth_m.min()


def test_a_depth_leads_back_to_the_point() -> None:
    view = view_state(pose(*PLACES[1], 9000.0, 200.0, -17.0), SIZE)
    point = view.eye + pixel_rays(view)[20, 31] * 12_345.0
    x, y, away_m = project(view, point).tolist()
    found = unproject(view, x, y, near_m(view) / away_m)
    assert np.linalg.norm(found - point) < 1e-6
