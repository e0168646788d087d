# SPDX-License-Identifier: Apache-2.0
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from geopage.draw_list import DrawList
from geopage.transitions import Transitions
from geopage.view import ViewState
from tests.viewer.worlds import (
    ROOTS,
    World,
    boxes_tile,
    make_world,
    one_colour,
    terrain_tile,
    whole_list,
)
from tiles import cells
from viewer.camera import Pose, view_state
from viewer.renderer import Renderer

SIZE = (320, 240)
FADE_S = 0.25
LON, LAT = 0.3, 0.2
Make = Callable[..., Renderer]
Frames = list[np.ndarray]


def town() -> World:
    """A tile with a block as proxy, and one with the houses that it stands for."""
    ground = [terrain_tile(int(cell), one_colour((90, 110, 70)), 65) for cell in ROOTS]
    places = np.zeros((17, 3))
    places[:16, 0], places[:16, 1] = np.indices((4, 4)).reshape(2, 16) * 8e-6 - 12e-6
    places[:, :2] += LON, LAT
    sizes = np.tile((40.0, 40.0, 60.0), (16, 1))
    sizes[:, 2] += 3.0 * np.arange(16)
    block = places[16:], np.array([[200.0, 200.0, 70.0]])
    tiles = [
        boxes_tile(int(cells.cell_at(LON, LAT, 10)), *block, proxy=True),
        boxes_tile(int(cells.cell_at(LON, LAT, 12)), places[:16], sizes),
    ]
    return make_world(ground, tiles)


def swap(world: World, view: ViewState) -> tuple[DrawList, DrawList]:
    """The block alone, and the houses alone."""
    whole = whole_list(world, view)
    proxies = np.array([4, 0], np.uint8)[np.argsort(whole.objects)]
    far = replace(whole, own=proxies < 0, proxies=proxies)
    return far, replace(whole, own=proxies == 0, proxies=proxies * 0)


def mixed(
    far: DrawList, near: DrawList, since_s: float, fade_s: float = FADE_S
) -> DrawList:
    """The houses replace the block from a time on."""
    transitions, there = Transitions(fade_s), np.ones(2, np.uint8)
    early, late = (replace(near.view, t_s=t_s) for t_s in (since_s - 9.0, since_s))
    transitions.blend(replace(far, view=early), there, 0.0)
    return transitions.blend(replace(near, view=late), there, 0.0)


POSE = Pose(LON, LAT - 4.5e-5, 200.0, 0.0, -0.5)


def test_each_pixel_of_a_fade_is_of_the_old_picture_or_of_the_new(
    make_renderer: Make,
) -> None:
    world = town()
    renderer, view = make_renderer(world, SIZE), view_state(POSE, SIZE)
    far, near = swap(world, view)
    pictures, points = [], []
    for drawn in (far, near):
        renderer.draw(drawn, view)
        pictures.append(renderer.read_rgb())
        points.append(np.nan_to_num(renderer.read_positions()))
    differ = (pictures[0] != pictures[1]).any(-1)
    assert differ.mean() > 0.05
    assert (points[0] != points[1]).any(-1)[differ].mean() > 0.9
    for part in (0.0, 0.1, 0.5, 0.9, 1.0):
        stats = renderer.draw(mixed(far, near, view.t_s - part * FADE_S), view)
        assert (stats.fading > 0) == (0 < part < 1)
        rgb, seen = renderer.read_rgb(), np.nan_to_num(renderer.read_positions())
        old, new = ((rgb == picture).all(-1) for picture in pictures)
        assert (old | new).all()
        assert new[differ].mean() == pytest.approx(part, abs=0.02)
        same = [(seen == one).all(-1) for one in points]
        assert (same[0] | same[1]).all()
        # Ids and positions are those of the picture.
        assert (same[1] >= new)[differ].all()


def test_pictures_change_less_between_frames_with_a_fade(make_renderer: Make) -> None:
    world = town()
    renderer = make_renderer(world, SIZE)

    def popping(seconds: float) -> float:
        frames: Frames = []
        for t_s in np.arange(0.0, 0.5, 1 / 30):
            view = replace(view_state(POSE, SIZE), t_s=float(t_s))
            far, near = swap(world, view)
            drawn = mixed(far, near, 0.1, seconds) if t_s >= 0.1 else far
            renderer.draw(drawn, view)
            frames.append(renderer.read_rgb().astype(float))
        return float(np.abs(np.diff(frames, axis=0)).mean((1, 2, 3)).max())

    assert 0 < popping(FADE_S) < popping(0.0) / 5


def test_fading_objects_hide_what_lies_behind_them_pixel_by_pixel(
    make_renderer: Make,
) -> None:
    world = town()
    renderer, view = make_renderer(world, SIZE), view_state(POSE, SIZE)
    far, near = swap(world, view)
    covered = []
    for drawn in (far, near, mixed(far, near, view.t_s - FADE_S / 2)):
        renderer.draw(drawn, view)
        covered.append(renderer.read_ids() < 0)
    both, either = covered[0] & covered[1], covered[0] | covered[1]
    assert both.mean() > 0.01
    assert covered[2][both].all()
    assert not covered[2][~either].any()
