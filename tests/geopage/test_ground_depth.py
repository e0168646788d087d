# SPDX-License-Identifier: Apache-2.0
"""How near the ground can be in a picture, against rays through many of its pixels."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geopage.ground_depth import least_depth_m
from geopage.view import ViewState
from tests.geopage.worlds import view_at
from tiles.frames import WGS84_A_M, WGS84_B_M, Floats

RAYS = 101
PLACES = st.tuples(st.floats(-math.pi, math.pi), st.floats(-1.57, 1.57))


def half_of(view: ViewState) -> tuple[float, float]:
    return view.width_px / 2 / view.focal_px, view.height_px / 2 / view.focal_px


def rays_of(view: ViewState) -> Floats:
    """Ways from the eye, one deep, through points of the picture, its rim among them."""
    (x, y), share = half_of(view), np.linspace(-1, 1, RAYS)
    way = np.stack(np.meshgrid(share * x, share * y, -1.0), axis=-1).reshape(-1, 3)
    return np.asarray(way @ view.rotation)


def met_m(view: ViewState, sides_m: tuple[float, float]) -> float:
    """The least depth at which a ray meets an ellipsoid of revolution; inf: none does."""
    size = np.array((sides_m[0], sides_m[0], sides_m[1]))
    eye, way = view.eye / size, rays_of(view) / size
    a, b, c = (way**2).sum(axis=1), way @ eye, eye @ eye - 1.0
    root = b * b - a * c
    hit = (root >= 0) & (b < 0)
    return float((c / (np.sqrt(root[hit]) - b[hit])).min(initial=np.inf))


@given(
    PLACES, st.floats(2.0, 7.3), st.floats(-90, 20), st.floats(0, 360), st.floats(0, 0.9)
)
def test_no_ground_in_the_picture_is_nearer(
    place: tuple[float, float], power: float, pitch: float, heading: float, share: float
) -> None:
    height_m = 10.0**power
    view = view_at(height_m, place, pitch, heading)
    top_m = min(share * height_m, 9000.0)
    found_m = least_depth_m(view.eye, view.rotation, half_of(view), top_m)
    # Heights lie between two ellipsoids; one is a little too high at the equator.
    low = met_m(view, (WGS84_A_M + top_m, WGS84_B_M + top_m))
    most = WGS84_A_M / WGS84_B_M
    high = met_m(view, (WGS84_A_M + most * top_m, WGS84_B_M + top_m))
    assert found_m <= low * (1 + 1e-9)
    if math.isfinite(high):
        assert found_m >= high * 0.98


@pytest.mark.parametrize("pitch", [-90.0, -60.0, -30.0])
def test_over_flat_ground_a_corner_or_the_axis_is_nearest(pitch: float) -> None:
    view = view_at(1000.0, pitch_deg=pitch)
    way = rays_of(view)
    up = view.eye / np.linalg.norm(view.eye)
    least = 1000.0 / (way @ -up).max()
    found_m = least_depth_m(view.eye, view.rotation, half_of(view), 0.0)
    assert found_m == pytest.approx(least, rel=0.01)


def test_below_the_sky_and_below_the_ground_there_is_no_bound() -> None:
    up = view_at(1000.0, pitch_deg=80.0)
    assert least_depth_m(up.eye, up.rotation, half_of(up), 0.0) == 0.0
    valley = view_at(1000.0, pitch_deg=-30.0)
    assert least_depth_m(valley.eye, valley.rotation, half_of(valley), 2000.0) == 0.0
