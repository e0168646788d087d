# SPDX-License-Identifier: Apache-2.0
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from geopage.draw_list import DrawList
from tests.viewer.test_renderer import OVER_BOXES, SIZE, SPACE, box_world
from tests.viewer.worlds import ROOTS, make_world, one_colour, terrain_tile, whole_list
from tiles.objects import PROXY_ORDINAL
from viewer import gl
from viewer.camera import view_state
from viewer.look import PLAIN
from viewer.overlay import OFF, Overlay
from viewer.renderer import Renderer
from viewer.target import Target

Make = Callable[..., Renderer]


def grey_globe(make: Make, side: int = 9) -> tuple[Renderer, DrawList]:
    grey = one_colour((120, 124, 120))
    world = make_world([terrain_tile(int(c), grey, side) for c in ROOTS])
    renderer = make(world)
    renderer.look = PLAIN
    return renderer, whole_list(world, view_state(SPACE, SIZE), 1.0)


def shown(renderer: Renderer, drawn: DrawList, overlay: Overlay) -> np.ndarray:
    renderer.overlay = overlay
    renderer.draw(drawn, drawn.view)
    return renderer.read_rgb().astype(int)


def test_the_wireframe_lies_on_the_ground_and_is_gone_when_it_is_off(
    make_renderer: Make,
) -> None:
    renderer, drawn = grey_globe(make_renderer)
    plain = shown(renderer, drawn, OFF)
    lines = (shown(renderer, drawn, Overlay(wireframe=True)) != plain).any(-1)
    ground = renderer.read_ids() > 0
    assert 0.05 < lines[ground].mean() < 0.6
    assert not (lines & ~ground)[1:-1, 1:-1].mean() > 0.01
    assert (shown(renderer, drawn, OFF) == plain).all()


def test_boxes_of_stand_ins_are_orange_and_others_white(make_renderer: Make) -> None:
    renderer, drawn = grey_globe(make_renderer)
    plain = shown(renderer, drawn, OFF)
    for is_stand_in in (False, True):
        some = replace(drawn, stand_in=np.full(32, is_stand_in))
        rgb = shown(renderer, some, Overlay(bounds=True))
        lines = rgb[(rgb != plain).any(-1)]
        assert 300 < len(lines) < 0.1 * plain[..., 0].size
        assert (np.ptp(lines, axis=1).mean() > 60) == is_stand_in


def test_heat_is_blue_where_the_error_is_small_and_orange_where_it_is_large(
    make_renderer: Make,
) -> None:
    renderer, drawn = grey_globe(make_renderer)
    stats = renderer.draw(drawn, drawn.view)
    middle = SIZE[1] // 2, SIZE[0] // 2
    for factor, order in ((20.0, 1), (1 / 20, -1)):
        limit = replace(drawn, threshold_px=stats.screen_error_px * factor)
        red, _, blue = shown(renderer, limit, Overlay(heat=True))[middle]
        assert (blue - red) * order > 40
    assert (np.diff(shown(renderer, drawn, OFF)[middle]) < 9).all()


def test_exactly_the_picked_object_is_painted(make_renderer: Make) -> None:
    world, places, _ = box_world()
    renderer = make_renderer(world)
    renderer.look = PLAIN
    drawn = whole_list(world, view_state(OVER_BOXES, SIZE))
    plain = shown(renderer, drawn, OFF)
    codes = -1 - renderer.read_ids()
    for ordinal in (0, len(places) - 2, PROXY_ORDINAL):
        picked = Overlay(picked=(int(drawn.objects[0]), ordinal))
        painted = (shown(renderer, drawn, picked) != plain).any(-1)
        assert (painted == (codes == ordinal)).all()
        assert painted.sum() > 20


def test_a_resized_renderer_draws_like_a_new_one(make_renderer: Make) -> None:
    renderer, drawn = grey_globe(make_renderer)
    renderer.draw(drawn, drawn.view)
    renderer.read_ids()
    size = 200, 120
    view = view_state(SPACE, size)
    other, _ = grey_globe(lambda world: make_renderer(world, size))
    for one in (renderer, other):
        one.resize(size)
        one.draw(drawn, view)
    assert renderer.read_rgb().shape == (120, 200, 3)
    assert (renderer.read_rgb() == other.read_rgb()).all()
    assert (renderer.read_ids() == other.read_ids()).all()
    assert (renderer.read_ids() > 0).mean() > 0.2


def test_a_blit_copies_the_picture_and_scales_it(make_renderer: Make) -> None:
    renderer, drawn = grey_globe(make_renderer)
    renderer.draw(drawn, drawn.view)
    picture = renderer.read_rgb()
    for size in (SIZE, (SIZE[0] * 2, SIZE[1] * 2)):
        window = Target(renderer.gl, size, (gl.RGBA8,))
        renderer.blit(window.name, size)
        into = np.empty((size[1], size[0], 4), np.uint8)
        seen = window.read(0, (gl.RGBA, gl.UNSIGNED_BYTE), into)[..., :3].astype(int)
        times = size[0] // SIZE[0]
        wide = picture.repeat(times, 0).repeat(times, 1).astype(int)
        limit = 0 if times == 1 else 3
        assert (np.abs(seen - wide).max(-1) <= limit).mean() > 0.97
        window.release()
    assert math.isclose(picture[SIZE[1] // 2, SIZE[0] // 2].mean(), 121, abs_tol=6)


def test_edges_are_softened_in_the_window_once_the_view_rests(make_renderer: Make) -> None:
    world, _, _ = box_world()
    renderer = make_renderer(world)
    drawn = whole_list(world, view_state(OVER_BOXES, SIZE))
    window = Target(renderer.gl, SIZE, (gl.RGBA8,))
    into = np.empty((SIZE[1], SIZE[0], 4), np.uint8)
    shown_ = []
    for _ in range(2):
        renderer.draw(drawn, drawn.view)
        renderer.blit(window.name)
        seen = window.read(0, (gl.RGBA, gl.UNSIGNED_BYTE), into)[..., :3]
        shown_.append(seen.astype(int).copy())
    window.release()
    picture = renderer.read_rgb().astype(int)
    assert (shown_[0] == picture).all() == renderer.gl.is_software
    changed = (shown_[1] != picture).any(-1)[2:-2, 2:-2]
    green = picture[..., 1]
    steps = [
        np.abs(green[2:-2, 2:-2] - np.roll(green, (dy, dx), (0, 1))[2:-2, 2:-2])
        for dy in (-1, 1)
        for dx in (-1, 1)
    ]
    assert changed[np.max(steps, axis=0) > 60].mean() > 0.5
    assert not changed[np.max(steps, axis=0) < 5].any()
