# SPDX-License-Identifier: Apache-2.0
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from geopage.draw_list import DrawList
from geopage.view import ViewState
from tests.viewer.worlds import (
    ROOTS,
    World,
    boxes_tile,
    globe,
    make_world,
    one_colour,
    terrain_tile,
    whole_list,
)
from tiles import cells, geodesy
from tiles.frames import Ecef, Local
from tiles.lanes import Lane
from tiles.mesh import VERTEX, Mesh, quantise
from tiles.terrain import TerrainTile
from viewer.camera import Pose, pixel_rays, project, view_state
from viewer.look import PLAIN
from viewer.renderer import Renderer

SIZE = (320, 240)
Make = Callable[..., Renderer]
SPACE = Pose(-2.1, 0.65, 1e7, 0.0, -math.pi / 2)


def draw(make: Make, world: World, pose: Pose) -> tuple[Renderer, ViewState, DrawList]:
    renderer = make(world)
    renderer.look = PLAIN
    view = view_state(pose, SIZE)
    drawn = whole_list(world, view)
    renderer.draw(drawn, view)
    return renderer, view, drawn


def one_colour_globe(side: int = 33) -> tuple[World, np.ndarray]:
    tints = np.random.default_rng(3).integers(0, 256, (32, 3)) & (0xF8, 0xFC, 0xF8)
    tiles = [
        terrain_tile(int(cell), one_colour(tuple(rgb)), side)
        for cell, rgb in zip(ROOTS, tints.tolist(), strict=True)
    ]
    return make_world(tiles), tints


def inner_pixels(ids: np.ndarray) -> np.ndarray:
    """Pixels whose eight neighbours show the same tile."""
    same = np.zeros_like(ids, bool)
    middle = ids[1:-1, 1:-1]
    same[1:-1, 1:-1] = True
    for dy in (0, 1, 2):
        for dx in (0, 1, 2):
            shifted = ids[dy : dy + middle.shape[0], dx : dx + middle.shape[1]]
            same[1:-1, 1:-1] &= shifted == middle
    return same


def test_each_tile_is_drawn_with_its_own_texture(make_renderer: Make) -> None:
    world, tints = one_colour_globe()
    renderer, _, _ = draw(make_renderer, world, SPACE)
    ids, rgb = renderer.read_ids(), renderer.read_rgb()
    inside = inner_pixels(ids) & (ids > 0)
    assert len(np.unique(ids[inside])) >= 6
    stored = tints | tints >> (5, 6, 5)
    assert np.abs(rgb[inside].astype(int) - stored[ids[inside] - 1]).max() <= 2


def test_each_pixel_names_the_tile_that_it_shows(make_renderer: Make) -> None:
    renderer, _, drawn = draw(make_renderer, globe(), SPACE)
    ids, points = renderer.read_ids(), renderer.read_positions()
    inside = inner_pixels(ids) & (ids > 0)
    lon, lat, _ = geodesy.to_geodetic(Ecef(points[inside]))
    found = renderer.forests[Lane.TERRAIN].row_of(cells.cell_at(lon, lat, 0))
    assert np.array_equal(drawn.terrain[ids[inside] - 1], found)


@pytest.mark.parametrize("pose", [SPACE, Pose(0.3, -1.2, 3e5, 1.0, -0.5)])
def test_positions_lie_on_the_pixels_rays_and_the_surface(
    make_renderer: Make, pose: Pose
) -> None:
    world = globe(129)
    renderer, view, _ = draw(make_renderer, world, pose)
    points, ids = renderer.read_positions(), renderer.read_ids()
    hit = np.isfinite(points[..., 0])
    assert np.array_equal(hit, ids != 0)
    assert hit.mean() > 0.1
    x, y, _ = np.moveaxis(project(view, points[hit]), -1, 0)
    row, col = np.nonzero(hit)
    off = np.hypot(x - col - 0.5, y - row - 0.5)
    # At the rim, GL snaps corners to 1/256 pixel, and a point stays on its triangle.
    assert np.quantile(off, 0.99) < 0.005
    assert off.max() < 0.25
    height = geodesy.to_geodetic(Ecef(points[hit]))[2]
    sag_m = geodesy.WGS84_A_M * (math.pi / 4 / 128) ** 2 / 4
    step_m = max(tile.mesh.scale_m for tile in world.terrain.values())
    rounding_m = step_m / 2 * math.sqrt(3) + 1.0
    assert height.max() < rounding_m
    assert height.min() > -sag_m - rounding_m


def test_pixels_that_show_the_sky_are_those_whose_rays_miss(make_renderer: Make) -> None:
    renderer, view, _ = draw(make_renderer, globe(129), SPACE)
    axes = np.array([6378137.0, 6378137.0, 6356752.3142])
    rays, eye = pixel_rays(view) / axes, view.eye / axes
    a, b = (rays * rays).sum(-1), rays @ eye
    miss = b * b - a * (eye @ eye - 1.0) < 0
    sky = renderer.read_ids() == 0
    assert (sky != miss).mean() < 0.004
    assert not (sky & ~miss)[100:140, 140:180].any()


@pytest.mark.parametrize("supersample", [1, 2])
def test_pixels_without_depth_are_those_whose_rays_miss(
    make_renderer: Make, supersample: int
) -> None:
    world = globe(129)
    renderer = make_renderer(world, SIZE, supersample)
    view = view_state(SPACE, SIZE)
    renderer.draw(whole_list(world, view), view)
    empty = renderer.read_empty()
    differ = empty != (renderer.read_ids() == 0)
    assert 0.1 < empty.mean() < 0.9
    # With samples beside the pixel's middle, the rim may be half a pixel wider.
    assert differ.mean() < (0.004 if supersample == 1 else 0.02)
    assert not (differ & empty).any()
    if supersample == 1:
        assert not differ.any()


def test_the_coarse_look_is_the_fine_one_thinned(make_renderer: Make) -> None:
    renderer, view, _ = draw(make_renderer, globe(129), Pose(0.3, -1.2, 3e5, 1.0, -0.5))
    ids, distance_m = renderer.read_coarse(5)
    assert ids.shape == distance_m.shape == (SIZE[1] // 5, SIZE[0] // 5)
    # Five is odd: the middle of a coarse pixel is the middle of a fine one.
    fine, points = renderer.read_ids()[2::5, 2::5], renderer.read_positions()[2::5, 2::5]
    assert (ids == fine).mean() > 0.999
    assert (np.isinf(distance_m) == (ids == 0)).all()
    both = (ids == fine) & (ids > 0)
    assert both.mean() > 0.1
    truth = np.linalg.norm(points[both] - view.eye, axis=-1)
    assert np.allclose(distance_m[both], truth, rtol=1e-3)


def test_the_backs_of_triangles_are_empty(make_renderer: Make) -> None:
    eye = np.array([2e7, 0.0, 0.0])
    world = make_world([plate(int(ROOTS[0]), eye - (1e7, 0, 0), (248, 0, 0))])
    renderer = make_renderer(world)
    rotation = np.array(((0, 1, 0), (0, 0, 1), (1, 0, 0)), np.float64)
    front = ViewState(0.0, Ecef(eye), rotation, 300.0, *SIZE)
    renderer.draw(whole_list(world, front), front)
    assert 0 < (~renderer.read_empty()).sum() == (renderer.read_ids() == 1).sum()
    turned = rotation * np.array(((-1,), (1,), (-1,)))
    back = ViewState(0.0, Ecef(eye - (1.9e7, 0, 0)), turned, 300.0, *SIZE)
    world.forests[Lane.TERRAIN].radius_m[:] = 3e7
    renderer.draw(whole_list(world, back), back)
    assert renderer.read_empty().all()
    assert (renderer.read_ids() == 0).all()
    assert (renderer.read_coarse(4)[0] == 0).all()


def test_grain_changes_large_texels_only(make_renderer: Make) -> None:
    grey = one_colour((120, 124, 120))
    world = make_world([terrain_tile(int(c), grey, 17) for c in ROOTS])
    renderer = make_renderer(world)
    rough = []
    for height_m in (1e7, 3e4, 300.0):
        view = view_state(Pose(-2.1, 0.65, height_m, 0.0, -math.pi / 2), SIZE)
        rgb = []
        for grain in (0.0, 1.0):
            renderer.look = replace(PLAIN, grain=grain)
            renderer.draw(whole_list(world, view), view)
            rgb.append(renderer.read_rgb().astype(float))
        assert rgb[0][100:140, 140:180].std(axis=(0, 1)).max() < 1.5
        rough.append(np.abs(rgb[1] - rgb[0])[100:140, 140:180].std())
    assert rough[0] < 1.0
    assert min(rough[1:]) > 2.0


def plate(cell: int, centre: np.ndarray, rgb: tuple[int, int, int]) -> TerrainTile:
    """A square of 2,000 km that faces along -x."""
    half = 1e6
    corners = np.array(
        [(0, -half, -half), (0, half, -half), (0, half, half), (0, -half, half)]
    )
    steps, scale = quantise(Local(corners))
    vertices = np.zeros(4, VERTEX)
    vertices["position"] = steps
    indices = np.array((0, 1, 2, 0, 2, 3), np.uint16)
    mesh = Mesh(Ecef(centre), scale, vertices, indices)
    return TerrainTile(cell, mesh, 6, 1.0, 0.0, one_colour(rgb))


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize(("away_m", "gap_m"), [(1e7, 1.0), (1e6, 0.5), (1e4, 0.01)])
def test_the_nearer_of_two_plates_wins(
    make_renderer: Make, away_m: float, gap_m: float, first: int
) -> None:
    eye = np.array([2e7, 0.0, 0.0])
    near = plate(int(ROOTS[0]), eye - (away_m, 0, 0), (248, 0, 0))
    far = plate(int(ROOTS[1]), eye - (away_m + gap_m, 0, 0), (0, 0, 248))
    world = make_world([near, far])
    renderer = make_renderer(world)
    renderer.look = PLAIN
    # The index sphere decides the order: a larger one comes first.
    world.forests[Lane.TERRAIN].radius_m[first] *= 1.5
    rotation = np.array(((0, 1, 0), (0, 0, 1), (1, 0, 0)), np.float64)
    view = ViewState(0.0, Ecef(eye), rotation, 300.0, *SIZE)
    renderer.draw(whole_list(world, view), view)
    ids = renderer.read_ids()
    assert (ids == 1).sum() > 100
    assert not (ids == 2).any()
    assert (renderer.read_rgb()[ids == 1][:, 2] < 8).all()


def box_world(n: int = 12) -> tuple[World, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(8)
    lon, lat = 0.3, 0.2
    places = np.zeros((n, 3))
    places[:, 0] = lon + (np.arange(n) % 4 - 1.5) * 6e-6
    places[:, 1] = lat + (np.arange(n) // 4 - 1.0) * 6e-6
    sizes = np.stack(
        [rng.uniform(9, 15, n), rng.uniform(9, 15, n), rng.uniform(16, 30, n)], 1
    )
    order = np.argsort(-sizes.max(axis=1), kind="stable")
    cell = int(cells.cell_at(lon, lat, 12))
    world = make_world([], [boxes_tile(cell, places, sizes, proxy=True)])
    return world, places[order], sizes[order]


OVER_BOXES = Pose(0.3, 0.2, 150.0, 0.4, -math.pi / 2)


def roof_pixels(view: ViewState, places: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    tops = places + np.stack([np.zeros(len(sizes))] * 2 + [sizes[:, 2]], 1)
    return np.floor(project(view, geodesy.to_ecef(*tops.T))[:, :2]).astype(int)


def test_each_roof_names_its_object_and_the_proxy(make_renderer: Make) -> None:
    world, places, sizes = box_world()
    renderer, view, _ = draw(make_renderer, world, OVER_BOXES)
    ids = renderer.read_ids()
    x, y = roof_pixels(view, places, sizes).T
    codes = -1 - ids[y, x]
    assert np.array_equal(codes >> 16, np.zeros(len(places)))
    assert np.array_equal(codes & 0xFFFF, [*range(len(places) - 1), 65535])
    points = renderer.read_positions()[y, x]
    heights = geodesy.to_geodetic(Ecef(points))[2]
    assert np.abs(heights - sizes[:, 2]).max() < 0.01


def test_what_the_list_leaves_out_is_not_drawn(make_renderer: Make) -> None:
    world, places, sizes = box_world()
    renderer, view, drawn = draw(make_renderer, world, OVER_BOXES)
    x, y = roof_pixels(view, places, sizes).T
    no_proxies = replace(drawn, proxies=np.zeros(1, np.uint8))
    assert renderer.draw(no_proxies, view).objects == len(places) - 1
    shown = renderer.read_ids()[y, x] != 0
    assert shown[:-1].all()
    assert not shown[-1]
    renderer.draw(replace(drawn, own=np.zeros(1, np.bool_)), view)
    shown = renderer.read_ids()[y, x] != 0
    assert not shown[:-1].any()
    assert shown[-1]


def test_small_objects_are_left_out_by_the_newest_view(make_renderer: Make) -> None:
    world, _, sizes = box_world()
    renderer, view, drawn = draw(make_renderer, world, OVER_BOXES)
    forest, own = world.forests[Lane.OBJECTS], sizes[:-1].max(1)
    near = float(np.linalg.norm(forest.centre[0] - view.eye) - forest.radius_m[0])
    middle = float(own[4:6].mean())
    threshold = middle * view.focal_px / near
    stats = renderer.draw(replace(drawn, object_threshold_px=threshold), view)
    assert stats.objects - 1 == 5
    assert stats.triangles == 12 * stats.objects


def test_a_slot_is_used_again_without_a_trace(make_renderer: Make) -> None:
    world, tints = one_colour_globe(17)
    renderer, view, drawn = draw(make_renderer, world, SPACE)
    ids = renderer.read_ids()
    entry = int(ids[SIZE[1] // 2, SIZE[0] // 2]) - 1
    row = int(drawn.terrain[entry])
    renderer.free(Lane.TERRAIN, row)
    assert not renderer.is_uploaded(Lane.TERRAIN, row)
    renderer.draw(drawn, view)
    assert renderer.read_ids()[SIZE[1] // 2, SIZE[0] // 2] == 0
    green = terrain_tile(int(ROOTS[row]), one_colour((0, 252, 0)), 33)
    assert renderer.upload(Lane.TERRAIN, row, green)
    renderer.draw(drawn, view)
    after = renderer.read_ids()
    assert (after == ids)[inner_pixels(ids)].mean() > 0.999
    rgb = renderer.read_rgb()
    assert np.abs(rgb[after == entry + 1].astype(int) - (0, 255, 0)).max() <= 2
    others = inner_pixels(after) & (after > 0) & (after != entry + 1)
    stored = tints | tints >> (5, 6, 5)
    assert np.abs(rgb[others].astype(int) - stored[after[others] - 1]).max() <= 2


def test_supersampling_keeps_the_picture_and_softens_the_rim(make_renderer: Make) -> None:
    world, _ = one_colour_globe()
    view = view_state(SPACE, SIZE)
    drawn = whole_list(world, view)
    pictures = []
    for supersample in (1, 2):
        renderer = make_renderer(world, SIZE, supersample)
        renderer.look = PLAIN
        renderer.draw(drawn, view)
        pictures.append(renderer.read_rgb().astype(int))
    assert pictures[0].shape == pictures[1].shape
    difference = np.abs(pictures[0] - pictures[1]).max(-1)
    assert (difference <= 2).mean() > 0.95
    assert (difference > 20).any()


def test_skirts_hang_as_deep_as_the_list_says(make_renderer: Make) -> None:
    cell = int(cells.cell_at(0.3, 0.2, 12))
    world = make_world([terrain_tile(cell, one_colour((99, 99, 99)), 9)])
    lon, lat = (float(x) for x in cells.bounds_rad(cell)[:2])
    pose = Pose(lon + 1e-4, lat - 5e-5, 100.0, 0.0, 0.0)
    renderer, view, drawn = draw(make_renderer, world, pose)
    plain = renderer.read_ids() != 0
    renderer.draw(replace(drawn, skirt_m=np.full(1, 50.0, np.float32)), view)
    skirted = renderer.read_ids() != 0
    assert not (plain & ~skirted).any()
    new = skirted & ~plain
    heights = geodesy.to_geodetic(Ecef(renderer.read_positions()[new]))[2]
    assert new.sum() > 200
    assert -52.0 < heights.min() < -45.0


def test_stand_ins_in_view_are_counted(make_renderer: Make) -> None:
    world = globe(9)
    renderer, view, drawn = draw(make_renderer, world, SPACE)
    all_ = renderer.draw(replace(drawn, stand_in=np.ones(32, np.bool_)), view)
    assert all_.stand_ins == all_.tiles < 32
    assert renderer.draw(drawn, view).stand_ins == 0


def test_the_night_side_is_never_black(make_renderer: Make) -> None:
    world = make_world(
        [terrain_tile(int(c), one_colour((200, 200, 200)), 17) for c in ROOTS]
    )
    renderer, view, drawn = draw(make_renderer, world, SPACE)
    renderer.look = replace(PLAIN, night_light=0.35, sun=view.forward)
    renderer.draw(drawn, view)
    middle = renderer.read_rgb()[SIZE[1] // 2, SIZE[0] // 2]
    assert 0.8 * 200 * math.sqrt(0.35) < middle.mean() < 1.1 * 200 * math.sqrt(0.35)


def test_space_is_dark_and_the_day_sky_blue_and_bright_at_the_horizon(
    make_renderer: Make,
) -> None:
    world = globe(9)
    renderer = make_renderer(world)
    nothing = replace(
        whole_list(world, view_state(SPACE, SIZE)),
        terrain=np.zeros(0, np.int32),
        skirt_m=np.zeros(0, np.float32),
        stand_in=np.zeros(0, np.bool_),
    )
    renderer.draw(nothing, view_state(SPACE, SIZE))
    assert renderer.read_rgb()[0].max() < 40
    ground = Pose(0.3, 0.2, 20.0, 0.0, 0.35)
    renderer.draw(nothing, view_state(ground, SIZE))
    sky = renderer.read_rgb().astype(int)
    top, low = sky[0].mean(0), sky[180].mean(0)
    assert top[2] > top[0] + 30
    assert low.sum() > top.sum() + 60


def test_a_view_of_another_size_is_refused(make_renderer: Make) -> None:
    world = globe(5)
    renderer = make_renderer(world)
    view = view_state(SPACE, (100, 100))
    with pytest.raises(ValueError, match="pixels"):
        renderer.draw(whole_list(world, view), view)


def test_the_draw_room_grows_with_the_list(make_renderer: Make) -> None:
    world = globe(5)
    renderer = make_renderer(world)
    view = view_state(SPACE, SIZE)
    drawn = whole_list(world, view)
    few = renderer.draw(drawn, view)
    many = replace(
        drawn,
        terrain=np.tile(drawn.terrain, 100),
        skirt_m=np.zeros(3200, np.float32),
        stand_in=np.zeros(3200, np.bool_),
    )
    assert renderer.draw(many, view).draw_calls == 100 * few.draw_calls
