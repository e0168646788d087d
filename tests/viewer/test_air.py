# SPDX-License-Identifier: Apache-2.0
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from geopage.draw_list import DrawList
from geopage.view import ViewState
from tests.viewer.test_renderer import SIZE, SPACE
from tests.viewer.worlds import (
    ROOTS,
    World,
    make_world,
    one_colour,
    terrain_tile,
    whole_list,
)
from tiles import geodesy
from viewer import air
from viewer.camera import Pose, view_state
from viewer.look import HIGH_M, Look
from viewer.renderer import Renderer

Make = Callable[..., Renderer]
SEA, LAND = (20, 60, 120), (120, 124, 110)


def one_globe(rgb: tuple[int, int, int], side: int = 65) -> World:
    return make_world([terrain_tile(int(c), one_colour(rgb), side) for c in ROOTS])


def nothing(drawn: DrawList) -> DrawList:
    none = np.zeros(0, np.float32)
    rows, flags = np.zeros(0, np.int32), np.zeros(0, np.bool_)
    return replace(drawn, terrain=rows, skirt_m=none, stand_in=flags)


def linear(rgb: np.ndarray) -> np.ndarray:
    """Light of sRGB values (IEC 61966-2-1)."""
    part = rgb / 255
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)


def sun_at(view: ViewState, azimuth_rad: float, height_rad: float) -> np.ndarray:
    """Direction to a sun in the eye's sky."""
    lon, lat, _ = geodesy.to_geodetic(view.eye)
    level = math.cos(height_rad)
    east, north = level * math.sin(azimuth_rad), level * math.cos(azimuth_rad)
    return np.array((east, north, math.sin(height_rad))) @ geodesy.enu_axes(lon, lat)


@pytest.mark.parametrize("rise", [1.0, 0.4])
def test_by_day_light_is_white_and_by_night_it_is_what_was_asked_for(rise: float) -> None:
    assert np.allclose(air.sunlight(rise, 0.2), 1.0)
    assert air.sunlight(-0.2, 0.2).mean() == pytest.approx(0.2, rel=0.01)
    assert np.allclose(air.sunlight(-0.2, 1.0), 1.0)


def test_a_low_sun_is_red_and_the_sky_glows_towards_it() -> None:
    red, green, blue = air.sunlight(0.1, 0.0)
    assert red > 1.3 * green > 2 * blue
    thick = air.skylight(-0.13, 0.0)[1]
    towards, away = thick.sum(axis=0), thick[0]
    assert towards.sum() > 3 * away.sum()
    assert towards[0] > towards[2]
    assert away[2] > away[0]


@pytest.mark.parametrize("rise_deg", [50.0, 8.0, -4.0])
def test_nothing_jumps_where_the_view_from_above_begins(
    make_renderer: Make, rise_deg: float
) -> None:
    world = one_globe(SEA, 33)
    renderer = make_renderer(world)
    pictures = []
    for height_m in (HIGH_M - 1.0, HIGH_M + 1.0):
        view = view_state(Pose(0.3, 0.2, height_m, 1.0, -0.15), SIZE)
        renderer.look = Look(sun=sun_at(view, 1.3, math.radians(rise_deg)), grain=0.0)
        renderer.draw(whole_list(world, view), view)
        pictures.append(renderer.read_rgb().astype(float))
    differ = np.abs(pictures[0] - pictures[1]).max(-1)
    assert differ.mean() < 4.0
    assert np.quantile(differ, 0.99) < 16.0


def test_the_sea_mirrors_the_sun_and_land_does_not(make_renderer: Make) -> None:
    view = view_state(Pose(0.3, 0.2, 3e5, 0.0, math.radians(-45.0)), SIZE)
    facing = {}
    for rgb in (SEA, LAND):
        world = one_globe(rgb)
        renderer = make_renderer(world)
        light = []
        for azimuth in (0.0, math.pi):
            sun = sun_at(view, azimuth, math.radians(42.0))
            renderer.look = Look(sun=sun)
            renderer.draw(whole_list(world, view), view)
            light.append(linear(renderer.read_rgb()[110:130, 150:170]).mean())
        facing[rgb] = light[0] / light[1]
    assert facing[SEA] > 2.0
    assert facing[LAND] < 1.2


def test_from_space_the_rim_glows_on_the_day_side_and_the_sun_is_a_disc(
    make_renderer: Make,
) -> None:
    world = one_globe(LAND)
    renderer = make_renderer(world)
    view = view_state(SPACE, SIZE)
    renderer.look = Look(sun=view.rotation[0])  # to the right
    renderer.draw(whole_list(world, view), view)
    empty, rgb = renderer.read_empty(), renderer.read_rgb().astype(int)
    edge = empty & np.roll(~empty, 1, axis=1) & (rgb.sum(-1) > 0)
    row = SIZE[1] // 2
    right = np.flatnonzero(empty[row] & (np.arange(SIZE[0]) > 160))[0]
    left = np.flatnonzero(empty[row] & (np.arange(SIZE[0]) < 160))[-1]
    assert edge.any()
    assert rgb[row, right].sum() > rgb[row, left].sum() + 60
    assert (rgb[empty].sum(-1) == 0).mean() > 0.8
    renderer.look = Look(sun=view.rotation[2] * -0.8 + view.rotation[0] * 0.6)
    renderer.draw(whole_list(world, view), view)
    bright = (renderer.read_rgb().min(-1) > 250) & renderer.read_empty()
    y, x = np.nonzero(bright)
    assert 1 <= len(x) < 20
    expected = SIZE[0] / 2 + view.focal_px * 0.6 / 0.8
    assert np.abs(x - expected).max() < 4
    assert np.abs(y - SIZE[1] / 2).max() < 4


def test_the_sky_has_no_bands(make_renderer: Make) -> None:
    world = one_globe(LAND, 9)
    renderer = make_renderer(world)
    view = view_state(Pose(0.3, 0.2, 20.0, 0.0, 0.5), SIZE)
    renderer.draw(nothing(whole_list(world, view)), view)
    blue = renderer.read_rgb()[..., 2].astype(float)
    rows = blue.mean(axis=1)
    slow = np.abs(np.diff(rows)) < 0.3
    assert slow.any()
    # Between two steps of 8 bits, the share of pixels tells how far it is to the next.
    assert (blue.std(axis=1)[:-1][slow] > 0.2).mean() > 0.8
