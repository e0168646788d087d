# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geopage.cell_error import error_px_per_m
from geopage.prediction import rotation_of
from geopage.screen_error import (
    HIDDEN,
    OUTSIDE,
    Lens,
    Sweep,
    blur_px,
    is_hidden,
    lens_of,
    px_per_m,
)
from geopage.view import ViewState
from tests.geopage.screen_error_oracle import error_px_per_m_of, px_per_m_of
from tests.geopage.worlds import view_at
from tiles import bounds, cells, geodesy
from tiles.frames import Ecef, Floats

HEIGHTS_M = st.floats(1.0, 7.0).map(lambda x: 10.0**x)


def scale(lens: Lens, point: Floats, radius_m: float = 0.0) -> float:
    return px_per_m(lens, point[0], point[1], point[2], radius_m)


@pytest.mark.parametrize("distance_m", [10.0, 1e3, 1e7])
@pytest.mark.parametrize("share", [0.0, 0.45])
def test_on_the_axis_a_metre_takes_focal_over_distance(
    distance_m: float, share: float
) -> None:
    view = view_at(2e7, pitch_deg=0.0)
    point = view.eye + view.forward * distance_m
    found = scale(lens_of(view), point, distance_m * share)
    assert found == pytest.approx(view.focal_px / (distance_m * (1 - share)), rel=1e-6)


@given(st.integers(0, 2**32 - 1), HEIGHTS_M, st.floats(-90, 30))
def test_the_bound_is_at_most_a_little_above_the_most_of_many_rays(
    seed: int, height_m: float, pitch_deg: float
) -> None:
    lens = lens_of(view_at(height_m, pitch_deg=pitch_deg))
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(50, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    centre = np.where(rng.random((50, 1)) < 0.5, lens.eye, 0.0)
    centre = centre + direction * 10 ** rng.uniform(0, 7, (50, 1))
    radius = 10 ** rng.uniform(0, 6.5, 50)
    each = [scale(lens, c, float(r)) for c, r in zip(centre, radius, strict=True)]
    most = px_per_m_of(lens, centre, radius)
    assert (each >= most * (1 - 1e-6)).all()
    assert (each <= most * 1.03).all()


@given(st.integers(0, 2**32 - 1), HEIGHTS_M, st.floats(-90, 30))
def test_no_drawn_point_of_a_cell_is_nearer_than_its_error_counts(
    seed: int, height_m: float, pitch_deg: float
) -> None:
    view = view_at(height_m, pitch_deg=pitch_deg)
    lens, rng = lens_of(view), np.random.default_rng(seed)
    lon, lat, _ = geodesy.to_geodetic(Ecef(view.eye))
    level = rng.integers(0, 16, 20)
    near = height_m / 6.4e6 * rng.normal(size=(2, 20))
    cell = cells.cell_at(lon + near[0], np.clip(lat + near[1], -1.57, 1.57), level)
    low = rng.uniform(-500, 500, 20)
    high = low + rng.uniform(0, 1000, 20)
    centre, radius = bounds.sphere_of(cell, low, high)
    half = bounds.half_sides_of(cell, low, high, centre)
    boxes = centre, radius, (np.column_stack((1.0001 * half, low, high))).astype(np.float32)
    box_rad = np.stack(cells.bounds_rad(cell), axis=-1)
    whole = [error_px_per_m(lens, *one) for one in zip(*boxes, 0 * box_rad, strict=True)]
    np.testing.assert_allclose(error_px_per_m_of(lens, *boxes), whole, rtol=1e-6)
    each = [error_px_per_m(lens, *one) for one in zip(*boxes, box_rad, strict=True)]
    assert (np.array(each) <= whole).all()
    west, south, east, north = (side[:, None] for side in cells.bounds_rad(cell))
    u, v, w = rng.random((3, 20, 200))
    place = west + u * (east - west), south + v * (north - south)
    offset = geodesy.to_ecef(*place, low[:, None] + w * (high - low)[:, None]) - view.eye
    depth = offset @ view.forward
    x, y, _ = np.abs(np.moveaxis(offset @ view.rotation.T, -1, 0)) * view.focal_px
    drawn = (
        (depth > 0) & (x <= depth * view.width_px / 2) & (y <= depth * view.height_px / 2)
    )
    most = np.where(drawn, view.focal_px / np.maximum(depth, 1e-9), 0.0).max(axis=1)
    counted = np.array(each)
    hidden = [
        is_hidden(lens, *c, float(r))
        for c, r in zip(centre - view.eye, radius, strict=True)
    ]
    seen = drawn.any(axis=1) & ~np.array(hidden)
    assert (most[seen] <= counted[seen] * (1 + 1e-6)).all()


@given(st.integers(0, 2**32 - 1))
def test_a_projected_length_is_never_longer_than_the_bound(seed: int) -> None:
    view = view_at(1e4, pitch_deg=-30.0)
    lens = lens_of(view)
    rng = np.random.default_rng(seed)
    corner = np.array((640.0, 360.0)) / view.focal_px
    on_screen = rng.uniform(-corner, corner)
    away = 10 ** rng.uniform(0, 3)
    camera = np.array((*on_screen, -1.0)) * away
    side = rng.normal(size=3)
    length = 1e-4 * away
    ends = camera + np.outer((-0.5, 0.5), side / np.linalg.norm(side) * length)
    screen = ends[:, :2] / -ends[:, 2:] * view.focal_px
    projected_px = float(np.linalg.norm(screen[1] - screen[0]))
    centre = view.eye + camera @ view.rotation
    assert projected_px <= length * scale(lens, centre) * (1 + 1e-3)


@given(st.integers(0, 2**32 - 1), st.floats(10, 120), st.floats(-2, 2))
def test_a_metre_takes_no_more_in_a_sphere_anywhere_in_the_picture_than_the_bound_says(
    seed: int, fov_deg: float, shape: float
) -> None:
    width_px, height_px = (
        round(720 * 2.0 ** max(shape, 0)),
        round(720 * 2.0 ** -min(shape, 0)),
    )
    focal_px = height_px / 2 / math.tan(math.radians(fov_deg) / 2)
    view = replace(
        view_at(1e4, pitch_deg=10.0),
        focal_px=focal_px,
        width_px=width_px,
        height_px=height_px,
    )
    rng = np.random.default_rng(seed)
    half = np.array((width_px, height_px)) / 2 / focal_px
    centre = np.array((*rng.uniform(-1.2, 1.2, 2) * half, -1.0)) * 10 ** rng.uniform(0, 4)
    radius = float(np.linalg.norm(centre)) * rng.choice((1.0, 0.1)) * rng.uniform(0, 0.98)
    points = rng.normal(size=(2000, 3))
    points = centre + radius * points / np.linalg.norm(points, axis=1)[:, None]
    depth = -points[:, 2]
    drawn = (depth > 0) & (np.abs(points[:, :2]) <= depth[:, None] * half).all(axis=1)
    # Across the ray, away from the axis, a metre is stretched most.
    most = focal_px * np.linalg.norm(points[drawn], axis=1) / depth[drawn] ** 2
    bound = scale(lens_of(view), view.eye + centre @ view.rotation, radius)
    assert (most <= bound * (1 + 1e-6)).all()


def test_an_eye_inside_a_sphere_sees_it_as_huge() -> None:
    view = view_at(100.0)
    assert scale(lens_of(view), view.eye + 5.0, 100.0) >= view.focal_px * 1e3


def test_what_is_behind_the_eye_counts_an_eighth() -> None:
    view = view_at(1e7, pitch_deg=90.0)
    ahead = scale(lens_of(view), view.eye + view.forward * 100.0)
    behind = scale(lens_of(view), view.eye - view.forward * 100.0)
    corner = lens_of(view).corner_cos
    assert behind == pytest.approx(ahead * OUTSIDE / corner**2)


def test_the_far_side_of_the_planet_counts_least() -> None:
    view = view_at(1e6, (0.0, 0.0))
    far = np.asarray(geodesy.to_ecef(np.pi, 0.0, 8848.0))
    distance_m = float(np.linalg.norm(far - view.eye))
    assert scale(lens_of(view), far) == pytest.approx(view.focal_px / distance_m * HIDDEN)


@given(st.floats(-np.pi, np.pi), st.floats(-1.5, 1.5), HEIGHTS_M)
def test_nothing_in_sight_is_called_hidden(lon: float, lat: float, height_m: float) -> None:
    view = view_at(height_m, (0.3, 0.7))
    point = np.asarray(geodesy.to_ecef(lon, lat, 0.0))
    ray = point - view.eye
    facing = float(geodesy.up(lon, lat) @ ray) < 0
    wide = lens_of(view, turn_rad_s=100.0)
    weight = scale(wide, point) * float(np.linalg.norm(ray)) / view.focal_px
    assert not facing or weight >= 1 - 1e-9


def test_turning_widens_the_cone() -> None:
    view = view_at(1e7, pitch_deg=0.0)
    aside = view.eye + view.rotation[0] * 100.0
    assert scale(lens_of(view, 4.0), aside) == pytest.approx(
        8 * scale(lens_of(view), aside)
    )


def moved(view: ViewState, sweep: Sweep, dt_s: float) -> ViewState:
    """The view a moment later."""
    rotation = view.rotation @ rotation_of(np.array(sweep.spin_rad_s) * dt_s).T
    eye = Ecef(view.eye + np.array(sweep.velocity_m_s) * dt_s)
    return replace(view, eye=eye, rotation=rotation)


def on_screen_px(view: ViewState, points: Floats) -> Floats:
    """Places in the picture, (n, 2), from its middle."""
    camera = (points - view.eye) @ view.rotation.T
    return np.asarray(camera[:, :2] / -camera[:, 2:] * view.focal_px)


def random_sweep(rng: np.random.Generator) -> Sweep:
    speed, spin = 10 ** rng.uniform(0, 4), 10 ** rng.uniform(-3, 0.3)
    ways = rng.normal(size=(2, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    spin = spin * rng.integers(0, 2)
    return Sweep(tuple(ways[0] * speed), tuple(ways[1] * spin), 1.0)


@given(st.integers(0, 2**32 - 1))
def test_all_in_a_sphere_moves_at_least_by_its_blur(seed: int) -> None:
    rng = np.random.default_rng(seed)
    view, sweep = view_at(1e4, pitch_deg=-30.0), random_sweep(rng)
    away = 10 ** rng.uniform(1, 5)
    offset = (*rng.uniform(-0.3, 0.3, 2) * away, -away)
    centre, radius_m = (
        view.eye + np.array(offset) @ view.rotation,
        away * rng.uniform(0, 0.7),
    )
    way = rng.normal(size=(100, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    points = centre + way * radius_m * rng.random((100, 1)) ** (1 / 3)
    dt_s = 1e-6
    before, after = (on_screen_px(v, points) for v in (view, moved(view, sweep, dt_s)))
    speed_px_s = np.linalg.norm(after - before, axis=1) / dt_s
    least_px = blur_px(lens_of(view, sweep=sweep), *centre, radius_m)
    assert speed_px_s.min() >= least_px * (1 - 1e-3) - 1e-3


def test_a_point_on_the_axis_moves_by_speed_over_distance_and_by_the_turn() -> None:
    view = view_at(1e4, pitch_deg=-30.0)
    point = view.eye + view.forward * 500.0
    right, up = view.rotation[:2]
    for velocity, spin, expected_rad_s in (
        (right * 20.0, up * 0.0, 0.04),
        (view.forward * 20.0, up * 0.0, 0.0),
        (right * 0.0, up * 0.3, 0.3),
        (right * 20.0, up * 0.04, 0.0),  # turns after the point
    ):
        lens = lens_of(view, sweep=Sweep(tuple(velocity), tuple(spin), 0.5))
        found = blur_px(lens, *point, 0.0)
        assert found == pytest.approx(0.5 * expected_rad_s * view.focal_px, abs=1e-6)


def test_without_a_shutter_nothing_blurs() -> None:
    view = view_at(1e4)
    assert blur_px(lens_of(view), *(view.eye + 100.0), 1.0) == 0.0
