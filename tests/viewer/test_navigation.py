# SPDX-License-Identifier: Apache-2.0
"""What a hand does, against where points of the world then appear."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tiles import geodesy
from tiles.frames import Ecef
from viewer.camera import Pose, pixel_rays, project, rotation, view_state
from viewer.navigation import CLEAR_M, HIGHEST_M, NOTCH, Navigator
from viewer.navigation_arc import Arc, GroundBelow
from viewer.navigation_drag import LOWEST_RAD
from viewer.navigation_geometry import (
    Lens,
    distance_m,
    eye_of,
    orbit_of,
    pose_of,
    steepest_up,
)

SIZE = 800, 600
LENS = Lens(SIZE)
MIDDLE = SIZE[0] / 2, SIZE[1] / 2
ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
HILL_M = 300.0
DOWN = -math.pi / 2


def hill(pose: Pose) -> float:
    return HILL_M * math.sin(40 * pose.lon_rad) * math.cos(40 * pose.lat_rad)


def flat(_: Pose) -> float:
    return 0.0


def degrees(
    lon: float, lat: float, height_m: float, heading: float = 0.0, pitch: float = -90.0
) -> Pose:
    turned = math.radians(heading) % (2 * math.pi)
    return Pose(math.radians(lon), math.radians(lat), height_m, turned, math.radians(pitch))


class Ball:
    """A navigator over the bare ellipsoid, and its clock."""

    def __init__(self, pose: Pose, ground: GroundBelow = flat) -> None:
        self.nav = Navigator(pose, LENS, self.touch, ground)
        self.now_s = 0.0
        self.nav.step(0.0)

    def touch(self, x: float, y: float) -> Ecef | None:
        eye, ray = eye_of(self.nav.pose), LENS.ray(self.nav.pose, x, y)
        scale = 1 / np.array((6378137.0, 6378137.0, 6356752.314245179))
        a, b = eye * scale, ray * scale
        root = (a @ b) ** 2 - (b @ b) * (a @ a - 1)
        t = (-(a @ b) - math.sqrt(root)) / (b @ b) if root >= 0 else -1.0
        return Ecef(eye + t * ray) if t > 0 else None

    def run(self, seconds: float) -> list[Pose]:
        poses = []
        for _ in range(round(seconds * 60)):
            self.now_s += 1 / 60
            poses.append(self.nav.step(self.now_s))
        return poses

    def where(self, point: Ecef) -> np.ndarray:
        return project(self.nav.view(self.now_s), point)


heights = st.floats(1.5, 7.0).map(lambda e: 10.0**e)
places = st.tuples(st.floats(-180, 180), st.floats(-75, 75))
pixels = st.tuples(st.floats(150, 650), st.floats(150, 450))


def test_a_ray_is_the_cameras() -> None:
    pose = degrees(12, -40, 5e5, 77, -50)
    rays = pixel_rays(view_state(pose, SIZE))
    np.testing.assert_allclose(LENS.ray(pose, 10.5, 500.5), rays[500, 10], atol=1e-12)


@given(places, heights, st.floats(0, 360), st.floats(-90, 60))
def test_a_pose_is_found_again_from_its_camera(
    place: tuple[float, float], height_m: float, heading: float, pitch: float
) -> None:
    pose = degrees(*place, height_m, heading, pitch)
    found = pose_of(eye_of(pose), rotation(pose))
    np.testing.assert_allclose(eye_of(found), eye_of(pose), atol=1e-6)
    np.testing.assert_allclose(rotation(found), rotation(pose), atol=1e-7)


@given(places, heights, st.floats(0, 360), st.floats(-90, -50), pixels, pixels)
def test_what_is_grabbed_stays_under_the_cursor(
    place: tuple[float, float],
    height_m: float,
    heading: float,
    pitch: float,
    start: tuple[float, float],
    end: tuple[float, float],
) -> None:
    ball = Ball(degrees(*place, height_m, heading, min(pitch, DOWN + 9e-7 * height_m)))
    before, point = ball.nav.pose, ball.touch(*start)
    if point is None:
        return
    ball.nav.press(*start)
    for share in np.linspace(0, 1, 5)[1:]:
        at = [a + (b - a) * share for a, b in zip(start, end, strict=True)]
        ball.nav.move(*at)
        ball.run(1 / 60)
        seen = ball.where(point)
        if ball.touch(*at) is not None:  # else the cursor left the globe
            assert math.hypot(*(seen[:2] - at)) < 0.05
    assert ball.nav.pose.height_m == before.height_m


def test_a_drag_keeps_north_up() -> None:
    ball = Ball(degrees(20, 48, 9e6))
    ball.nav.press(400, 300)
    ball.nav.move(480, 340)
    ball.run(0.1)
    assert ball.nav.pose.heading_rad == 0.0
    assert abs(ball.nav.pose.lon_rad - math.radians(20)) > 0.05


@pytest.mark.parametrize("lat", [84.0, -86.0, 89.999])
def test_a_drag_goes_over_a_pole(lat: float) -> None:
    ball = Ball(degrees(30, lat, 3e6))
    point = ball.touch(*MIDDLE)
    assert point is not None
    toward = math.copysign(1, lat)
    ball.nav.press(*MIDDLE)
    seen = []
    for step in range(1, 26):
        at = MIDDLE[0] + step, MIDDLE[1] + toward * 10 * step
        ball.nav.move(*at)
        ball.run(1 / 60)
        assert math.hypot(*(ball.where(point)[:2] - at)) < 0.05
        seen.append(ball.nav.pose.lon_rad)
    assert abs(math.remainder(seen[-1] - math.radians(30), 2 * math.pi)) > 2.0


def test_a_drag_crosses_the_antimeridian() -> None:
    ball = Ball(degrees(179.99, 10, 5e4))
    ball.nav.press(500, 300)
    ball.nav.move(200, 300)
    ball.run(0.05)
    assert -math.pi <= ball.nav.pose.lon_rad < math.radians(-179)
    assert ball.nav.pose.heading_rad == 0.0


def test_dragging_into_the_sky_ends_at_what_one_can_see() -> None:
    ball = Ball(degrees(5, 45, 200.0, 0, -20))
    point = ball.touch(400, 400)
    assert point is not None
    away_m = distance_m(ball.nav.pose, point)
    ball.nav.press(400, 400)
    ball.nav.move(400, 10)
    ball.run(0.1)
    assert distance_m(ball.nav.pose, point) < 13 * away_m
    assert np.isfinite(eye_of(ball.nav.pose)).all()


def test_dragging_the_sky_turns_the_head() -> None:
    ball = Ball(degrees(5, 45, 200.0, 0, 10))
    before = ball.nav.pose
    ball.nav.press(400, 100)
    ball.nav.move(300, 140)
    ball.run(0.1)
    after = ball.nav.pose
    assert (after.lon_rad, after.lat_rad) == (before.lon_rad, before.lat_rad)
    assert after.heading_rad > before.heading_rad
    assert after.pitch_rad > before.pitch_rad


def test_what_was_thrown_glides_on_and_comes_to_rest() -> None:
    ball = Ball(degrees(0, 0, 1e6))
    ball.nav.press(400, 300)
    for step in range(6):
        ball.nav.move(400 - 15 * step, 300)
        ball.run(1 / 60)
    held = ball.nav.pose
    ball.nav.release()
    poses = ball.run(3.0)
    assert poses[-1].lon_rad > held.lon_rad + 1e-3
    assert poses[-1] == poses[-30]
    assert not ball.nav.moving


def test_a_hand_that_rests_before_it_lets_go_throws_nothing() -> None:
    ball = Ball(degrees(0, 0, 1e6))
    ball.nav.press(400, 300)
    ball.nav.move(300, 300)
    ball.run(0.5)
    held = ball.nav.pose
    ball.nav.release()
    assert ball.run(1.0)[-1] == held


@given(places, heights, st.floats(0, 360), pixels, st.integers(-4, 6))
def test_the_wheel_keeps_the_point_under_the_cursor(
    place: tuple[float, float],
    height_m: float,
    heading: float,
    pixel: tuple[float, float],
    notches: int,
) -> None:
    ball = Ball(degrees(*place, height_m, heading, -80))
    point = ball.touch(*pixel)
    if point is None:
        return
    away_m = distance_m(ball.nav.pose, point)
    ball.nav.wheel(*pixel, notches)
    seen = []
    for _ in range(60):
        ball.run(1 / 60)
        if ball.touch(*pixel) is not None:
            seen.append(math.hypot(*(ball.where(point)[:2] - pixel)))
    if notches > 0:
        assert max(seen) < 0.05
        after_m = distance_m(ball.nav.pose, point)
        assert after_m < max(away_m * NOTCH**notches * 1.35, CLEAR_M * 6)


def test_the_wheel_ends_above_the_ground_and_below_the_highest() -> None:
    ball = Ball(degrees(5, 45, 900.0, 0, -60), hill)
    for _ in range(60):
        ball.nav.wheel(*MIDDLE, 2)
        ball.run(0.1)
    assert ball.nav.pose.height_m >= hill(ball.nav.pose) + CLEAR_M - 1e-6
    for _ in range(120):
        ball.nav.wheel(*MIDDLE, -2)
        ball.run(0.1)
    assert ball.nav.pose.height_m == HIGHEST_M
    assert ball.touch(*MIDDLE) is not None  # the globe is in the picture


def test_a_tilt_turns_around_the_point_in_view() -> None:
    ball = Ball(degrees(5, 45, 3000.0, 30, -60))
    pivot = ball.touch(*MIDDLE)
    assert pivot is not None
    away_m = distance_m(ball.nav.pose, pivot)
    before = orbit_of(ball.nav.pose, pivot)
    ball.nav.press(100, 100, tilting=True)
    ball.nav.move(180, 40)
    ball.run(0.1)
    assert math.hypot(*(ball.where(pivot)[:2] - MIDDLE)) < 0.01
    assert distance_m(ball.nav.pose, pivot) == pytest.approx(away_m, rel=1e-9)
    after = orbit_of(ball.nav.pose, pivot)
    assert after.heading_rad - before.heading_rad == pytest.approx(math.pi / 10)
    assert after.above_rad - before.above_rad == pytest.approx(-math.pi * 60 / 800)


def test_a_tilt_ends_above_the_horizon_and_at_the_zenith() -> None:
    for way, end in ((-2000, LOWEST_RAD), (2000, math.pi / 2)):
        ball = Ball(degrees(5, 45, 300.0, 30, -60))
        pivot = ball.touch(*MIDDLE)
        assert pivot is not None
        ball.nav.press(100, 100, tilting=True)
        for step in range(20):
            ball.nav.move(100, 100 + way * step / 19)
            ball.run(1 / 60)
        assert orbit_of(ball.nav.pose, pivot).above_rad == pytest.approx(end, abs=1e-6)


def test_keys_fly_along_a_great_circle_over_the_pole() -> None:
    ball = Ball(degrees(40, 89, 3e5, 0, -30))
    ball.nav.held.add("forward")
    poses = ball.run(2.0)
    lat = [pose.lat_rad for pose in poses]
    assert max(lat) > math.radians(89.9)
    assert lat[-1] < max(lat)
    last = poses[-1]
    assert abs(math.remainder(last.lon_rad - math.radians(220), 2 * math.pi)) < 0.01
    assert abs(math.remainder(last.heading_rad - math.pi, 2 * math.pi)) < 0.01
    assert last.height_m == 3e5


def test_keys_fly_in_proportion_to_the_height_above_ground() -> None:
    ways = []
    for height_m in (1e3, 1e4):
        ball = Ball(degrees(40, 10, height_m))
        before = eye_of(ball.nav.pose)
        ball.nav.held.add("left")
        ball.run(1.0)
        ways.append(float(np.linalg.norm(eye_of(ball.nav.pose) - before)))
    assert ways[1] / ways[0] == pytest.approx(10, rel=0.02)


def test_shift_flies_faster_and_a_released_key_comes_to_rest() -> None:
    slow, fast = Ball(degrees(0, 0, 1e4)), Ball(degrees(0, 0, 1e4))
    fast.nav.fast = True
    for ball in (slow, fast):
        ball.nav.held.add("right")
        ball.run(1.0)
        ball.nav.held.clear()
        ball.run(2.0)
        assert not ball.nav.moving
    assert fast.nav.pose.lon_rad > 3.5 * slow.nav.pose.lon_rad


@pytest.mark.parametrize("way", ["forward", "down", "left"])
def test_no_key_leads_below_the_ground(way: str) -> None:
    ball = Ball(degrees(5, 45, 400.0, 90, -10), hill)
    ball.nav.fast = True
    ball.nav.held.add(way)
    for pose in ball.run(10.0):
        assert pose.height_m >= hill(pose) + CLEAR_M - 1e-6


def test_a_flight_rises_and_ends_exactly_where_it_was_sent() -> None:
    ball = Ball(degrees(8.5, 47.4, 500.0, 10, -30), hill)
    end = degrees(-122.4, 37.8, 300.0, 200, -40)
    ball.nav.fly_to(end)
    assert ball.nav.destination == end
    poses = ball.run(8.0)
    assert poses[-1] == end
    assert max(pose.height_m for pose in poses) > 1e6
    steps = [float(np.linalg.norm(eye_of(a) - eye_of(b))) for a, b in pairwise(poses)]
    scaled = [s / pose.height_m for s, pose in zip(steps, poses, strict=False)]
    assert max(scaled) < 0.25  # no jump
    assert not ball.nav.moving


@given(places, places, heights, heights, st.floats(0, 1))
def test_an_arc_joins_its_ends_and_stays_between(
    a: tuple[float, float],
    b: tuple[float, float],
    low_m: float,
    high_m: float,
    share: float,
) -> None:
    start, end = degrees(*a, low_m), degrees(*b, high_m, 350)
    arc = Arc(start, end, flat)
    np.testing.assert_allclose(
        eye_of(arc.pose_at(0.0)), eye_of(start), rtol=1e-9, atol=1e-3
    )
    nearly = arc.pose_at(arc.duration_s * (1 - 1e-9))
    np.testing.assert_allclose(eye_of(nearly), eye_of(end), rtol=1e-9, atol=1e-2)
    assert arc.pose_at(arc.duration_s) is end
    pose = arc.pose_at(share * arc.duration_s)
    assert pose.height_m >= min(low_m, high_m) * (1 - 1e-9)
    geod = pyproj.Geod(a=1.0, f=0.0)
    whole, before, after = (
        geod.inv(*np.degrees((p.lon_rad, p.lat_rad, q.lon_rad, q.lat_rad)))[2]
        for p, q in ((start, end), (start, pose), (pose, end))
    )
    assert before + after == pytest.approx(whole, abs=1e-6)


def test_a_flight_to_the_antipode_has_a_way() -> None:
    arc = Arc(degrees(10, 20, 1e3), degrees(-170, -20, 1e3), flat)
    middle = arc.pose_at(arc.duration_s / 2)
    assert np.isfinite(eye_of(middle)).all()
    assert middle.height_m > 1e6


def test_a_double_click_brings_the_point_nearer_and_into_the_middle() -> None:
    ball = Ball(degrees(5, 45, 3e6))
    point = ball.touch(500, 200)
    assert point is not None
    away_m = distance_m(ball.nav.pose, point)
    ball.nav.approach(500, 200)
    ball.run(8.0)
    assert distance_m(ball.nav.pose, point) == pytest.approx(0.2 * away_m, rel=1e-6)
    assert math.hypot(*(ball.where(point)[:2] - MIDDLE)) < 0.5


def test_a_double_click_on_the_sky_goes_nowhere() -> None:
    ball = Ball(degrees(5, 45, 3e7))
    assert ball.nav.approach(2, 2) is None
    assert not ball.nav.moving


def test_north_up_turns_around_the_point_in_view() -> None:
    ball = Ball(degrees(5, 45, 3000.0, 250, -50))
    point = ball.touch(*MIDDLE)
    assert point is not None
    ball.nav.face(0.0)
    ball.run(5.0)
    assert ball.nav.pose.heading_rad == 0.0
    assert math.hypot(*(ball.where(point)[:2] - MIDDLE)) < 0.5


def test_any_key_or_grip_ends_a_flight() -> None:
    for act in (
        lambda nav: nav.press(10, 10),
        lambda nav: nav.wheel(10, 10, 1),
        lambda nav: nav.held.add("forward"),
    ):
        ball = Ball(degrees(5, 45, 3e6))
        ball.nav.fly_to(degrees(60, 0, 1e3))
        ball.run(0.5)
        act(ball.nav)
        ball.run(0.1)
        assert ball.nav.destination is None


@given(st.floats(2, 8))
def test_the_highest_pitch_keeps_the_globe_in_the_picture(exponent: float) -> None:
    height_m = 10.0**exponent
    pitch = steepest_up(height_m)
    limb = -math.acos(6.371e6 / (6.371e6 + height_m))
    assert pitch < limb if height_m >= 2e6 else pitch > limb - 0.04


def test_clicks_at_a_pole_itself_work() -> None:
    pole = degrees(0, 90, 1e5, 0, -90)
    ball = Ball(pole)
    assert float(ECEF.transform(0, 90, 1e5)[2]) == pytest.approx(eye_of(pole)[2])
    for act in (
        lambda: ball.nav.wheel(420, 300, 1),
        lambda: ball.nav.press(420, 310),
        lambda: ball.nav.move(300, 310),
        ball.nav.release,
        lambda: ball.nav.face(0.0),
        lambda: ball.nav.held.add("forward"),
    ):
        act()
        for pose in ball.run(0.2):
            assert np.isfinite(eye_of(pose)).all()
            assert geodesy.to_geodetic(eye_of(pose))[2] > 0


def test_time_that_stood_still_moves_nothing() -> None:
    ball = Ball(degrees(0, 0, 1e4))
    ball.nav.held.add("right")
    ball.run(1.0)
    before = ball.nav.pose
    ball.nav.step(ball.now_s)
    assert ball.nav.pose == before
    jump = ball.nav.step(ball.now_s + 3600)
    assert distance_m(replace(jump, height_m=before.height_m), eye_of(before)) < 2e3
