# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from geopage.view import ViewState
from tests.viewer.worlds import ROOTS, World, boxes_tile, make_world, whole_list
from tiles import cells, geodesy
from tiles.frames import Floats
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.objects import prefix_end
from tiles.terrain import TEXTURE_SIDE
from viewer import cull
from viewer.camera import Pose, project, view_state
from viewer.cull_objects import cull_objects
from viewer.look import PLAIN, frame_block
from viewer.slots import PATCH_M, POOL, SLOT, make_pieces, make_slots

SIZE = (640, 360)


def random_view(rng: np.random.Generator) -> ViewState:
    lon, lat = rng.uniform(-3, 3), rng.uniform(-1.5, 1.5)
    height = 10.0 ** rng.uniform(1, 7.3)
    pose = Pose(lon, lat, height, rng.uniform(0, 6.3), rng.uniform(-math.pi / 2, 0.3))
    return view_state(pose, SIZE)


def surface_spheres(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Spheres around places on the ellipsoid, some of them above it."""
    lon, lat = rng.uniform(-np.pi, np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    height = 10.0 ** rng.uniform(0, 4, n)
    return geodesy.to_ecef(lon, lat, height), 10.0 ** rng.uniform(0, 6, n)


def seen_directly(view: ViewState, points: np.ndarray) -> np.ndarray:
    """In the picture, and no ellipsoid (12 km lower) on the way: a float64 ray cast."""
    x, y, depth = np.moveaxis(project(view, points), -1, 0)
    inside = (depth > 0) & (x >= 0) & (x <= SIZE[0]) & (y >= 0) & (y <= SIZE[1])
    axes = np.array([6378137.0, 6378137.0, 6356752.0]) - 12_000.0
    o, d = view.eye / axes, (points - view.eye) / axes
    a, b, c = (d * d).sum(-1), (d * o).sum(-1), o @ o - 1.0
    root = b * b - a * c
    hit = (root > 0) & (b < 0) & (-b - np.sqrt(np.maximum(root, 0)) < a * (1 - 1e-9))
    return inside & ~hit


def test_no_sphere_with_a_visible_point_is_culled(rng: np.random.Generator) -> None:
    kept = seen = 0
    for _ in range(20):
        view = random_view(rng)
        eye = cull.eye_of(view)
        centres, radii = surface_spheres(rng, 300)
        way = rng.normal(size=(300, 40, 3))
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        shown = seen_directly(view, centres[:, None] + way * radii[:, None, None]).any(1)
        ours = np.array(
            [cull.is_visible(c, r, eye) for c, r in zip(centres, radii, strict=True)]
        )
        assert not (shown & ~ours).any()
        kept, seen = kept + ours.sum(), seen + shown.sum()
    assert seen > 50
    assert kept < 6000 * 0.8


def test_the_far_side_of_the_globe_is_culled() -> None:
    eye = cull.eye_of(view_state(Pose(0.0, 0.0, 1e6, 0.0, -math.pi / 2), SIZE))
    behind = geodesy.to_ecef(np.pi, 0.0, 0.0)
    assert not cull.is_visible(np.asarray(behind), 1000.0, eye)
    assert cull.is_visible(np.asarray(geodesy.to_ecef(0.0, 0.0, 0.0)), 1000.0, eye)


def cubes(radius: Floats) -> NDArray[np.float32]:
    """Boxes that say no more than the spheres."""
    return np.repeat(radius[:, None], 5, axis=1).astype(np.float32)


def terrain_lists(rng: np.random.Generator, n: int) -> cull.Lists:
    centre, radius = surface_spheres(rng, n)
    records = np.zeros(n, INDEX)
    records["error_m"], records["texel_m"] = rng.uniform(0, 5, n), rng.uniform(0, 5, n)
    slots = make_slots(n)
    slots["centre"] = centre + rng.normal(size=(n, 3))
    slots["uploaded"] = rng.random(n) < 0.8
    for field in ("base_vertex", "first_index", "layer"):
        slots[field] = rng.integers(0, 1000, n)
    slots["part_count"] = 3 * rng.integers(1, 1000, (n, 4))
    slots["part_first"] = 3 * rng.integers(0, 1000, (n, 4))
    slots["part_error_m"] = rng.uniform(0, 5, (n, 4))
    slots["scale_m"] = rng.random(n)
    slots["noise"] = rng.random((n, 3))
    rows = rng.permutation(n).astype(np.int32)
    return cull.Lists(rows, slots, centre, radius, cubes(radius), records, make_pieces(1))


def whole(lists: cull.Lists) -> np.ndarray:
    """Draw every tile's whole mesh."""
    return np.zeros(len(lists.rows), np.uint8)


def fine(n: int) -> np.ndarray:
    """Data finer than any texel."""
    return np.zeros(n, np.float32)


def centres_of(room: cull.Room, n: int) -> np.ndarray:
    """Centres of the drawn tiles from the eye, as their records state them, m."""
    draws = room.instances[:n].astype(np.float64)
    return draws[:, :3] + draws[:, 16:19] * draws[:, 3:4]


def test_commands_and_records_are_those_of_a_plain_loop(rng: np.random.Generator) -> None:
    lists, view = terrain_lists(rng, 400), random_view(rng)
    skirt = rng.uniform(0, 100, 400).astype(np.float32)
    rung = rng.integers(0, 4, 400).astype(np.uint8)
    room, eye = cull.make_room(400), cull.eye_of(view)
    n, triangles, error_px, _, _ = cull.cull_terrain(
        lists, rung, skirt, fine(400), eye, 640 * 360.0, room
    )
    expected = [
        entry
        for entry, row in enumerate(lists.rows)
        if lists.slots[row]["uploaded"]
        and cull.is_visible(lists.centre[row], lists.radius_m[row] + skirt[entry], eye)
    ]
    entries = room.instances[:n, 12].astype(int)
    assert sorted(entries) == expected
    slots = lists.slots[lists.rows[entries]]
    assert np.allclose(centres_of(room, n), slots["centre"] - view.eye, rtol=1e-7)
    assert np.array_equal(room.instances[:n, 3], slots["scale_m"])
    lon, lat, _ = geodesy.to_geodetic(slots["centre"])
    assert np.allclose(room.instances[:n, 4:7], geodesy.up(lon, lat), atol=0.004)
    assert np.array_equal(room.instances[:n, 7], skirt[entries])
    assert np.array_equal(room.instances[:n, 11], slots["layer"])
    order = room.commands[:n, 4]
    assert sorted(order) == list(range(n))
    part = np.arange(n), rung[entries][order]
    first = slots[order]["first_index"] + slots[order]["part_first"][part]
    assert np.array_equal(room.commands[:n, 0], slots[order]["part_count"][part])
    assert np.array_equal(room.commands[:n, 2], first)
    assert np.array_equal(room.commands[:n, 3], slots[order]["base_vertex"])
    assert (room.commands[:n, 1] == 1).all()
    assert triangles == room.commands[:n, 0].sum() // 3
    assert error_px > 0


def test_commands_run_from_near_to_far(rng: np.random.Generator) -> None:
    lists = terrain_lists(rng, 300)
    lists.radius_m[:] = 1.0
    view = view_state(Pose(0.2, 0.3, 2e7, 0.0, -math.pi / 2), SIZE)
    room = cull.make_room(300)
    n, _, _, _, _ = cull.cull_terrain(
        lists,
        whole(lists),
        np.zeros(300, np.float32),
        fine(300),
        cull.eye_of(view),
        1.0,
        room,
    )
    assert n > 30
    rows = lists.rows[room.instances[room.commands[:n, 4], 12].astype(int)]
    offset = lists.centre[rows] - view.eye
    weighted = np.linalg.norm(offset, axis=1)
    cosine = np.maximum(offset @ view.forward / weighted, view.corner_cos)
    assert (np.diff(weighted * cosine**2) > -0.02 * weighted[1:]).all()


def test_tiles_of_a_kind_lie_together_and_are_counted(rng: np.random.Generator) -> None:
    """With large texels or coarse data, with water, both, or neither."""
    lists = terrain_lists(rng, 300)
    lists.radius_m[:], lists.box_m[:] = 1.0, 1.0
    lists.slots["uploaded"] = 1
    lists.slots["noise"][:, 2] = 1.0
    lists.slots["noise"][::3, 2] = 1e7
    lists.slots["wet"][::2] = 1
    view = view_state(Pose(0.2, 0.3, 2e7, 0.0, -math.pi / 2), SIZE)
    room = cull.make_room(300)
    skirt, detail_m = np.zeros(300, np.float32), fine(300)
    detail_m[::5] = 1e9
    detail_m[::7] = -1e9  # a picture that is shown as it is
    sizes = skirt, detail_m
    n, _, _, kinds, _ = cull.cull_terrain(
        lists, whole(lists), *sizes, cull.eye_of(view), 1.0, room
    )
    instances = room.commands[:n, 4]
    rows = lists.rows[room.instances[instances, 12].astype(int)]
    large, wet = ((rows % 3 == 0) | (rows % 5 == 0)) & (rows % 7 != 0), rows % 2 == 0
    ends = [0, *np.cumsum(kinds).tolist(), n]
    expected = (large & wet, large & ~wet, ~large & wet, ~large & ~wet)
    for kind, first, end in zip(expected, ends[:-1], ends[1:], strict=True):
        assert end - first > 5
        assert kind[first:end].all()
    texel_m = lists.slots["noise"][rows, 2] * PATCH_M / TEXTURE_SIDE
    texels = np.maximum(np.abs(detail_m[rows]) / texel_m, 1.0)
    assert np.allclose(room.instances[instances, 15], texels)


def test_the_screen_error_is_the_area_weighted_mean() -> None:
    centre = np.array([geodesy.to_ecef(0.0, 0.0, 0.0), geodesy.to_ecef(0.001, 0.0, 0.0)])
    records, slots = np.zeros(2, INDEX), make_slots(2)
    records["error_m"], records["texel_m"] = (1.0, 4.0), (2.0, 0.0)
    slots["uploaded"], slots["centre"] = 1, centre
    slots["part_error_m"] = records["error_m"][:, None]
    radius = np.array([1000.0, 500.0])
    boxes = centre, radius, cubes(radius)
    rows = np.arange(2, dtype=np.int32)
    lists = cull.Lists(rows, slots, *boxes, records, make_pieces(1))
    view = view_state(Pose(0.0, 0.0, 1e6, 0.0, -math.pi / 2), SIZE)
    room = cull.make_room(2)
    skirt = np.zeros(2, np.float32)
    _, _, error, _, _ = cull.cull_terrain(
        lists, whole(lists), skirt, fine(2), cull.eye_of(view), 1e9, room
    )
    scale = view.focal_px / 1e6
    assert error == pytest.approx(scale * (2.0 * 4 + 4.0) / 5, rel=0.01)


@pytest.mark.parametrize("threshold_px", [0.5, 4.0, 20.0, 1e4])
def test_the_drawn_prefix_is_what_is_larger_than_the_threshold(
    threshold_px: float, rng: np.random.Generator
) -> None:
    world, view = city(rng)
    room, lists, pool = prepared(world)
    drawn = whole_list(world, view)
    parts = drawn.own, drawn.proxies, pool, np.zeros((1, 4), np.uint8)
    n, _, objects, fading = cull_objects(
        lists, parts, drawn.shares(0.0), cull.eye_of(view), threshold_px, room
    )
    assert not fading
    tile = world.objects[0]
    near = np.linalg.norm(lists.centre[0] - view.eye) - lists.radius_m[0]
    end = prefix_end(tile.objects, threshold_px * near / view.focal_px)
    own = [c for c in room.commands[:n] if c[2] == 0 and c[0]]
    assert sum(int(c[0]) for c in own) == end
    assert objects == end // 36 + 1
    proxy = next(c for c in room.commands[:n] if c[2] != 0)
    assert (proxy[0], proxy[2]) == (36, tile.proxies["index_start"][0])


def city(rng: np.random.Generator) -> tuple[World, ViewState]:
    lon, lat, n = 0.3, 0.2, 30
    places = np.stack(
        [lon + rng.uniform(0, 1e-5, n), lat + rng.uniform(0, 1e-5, n), np.zeros(n)], 1
    )
    sizes = rng.uniform(2, 60, (n, 3))
    world = make_world([], [boxes_tile(int(ROOTS[20]), places, sizes, proxy=True)])
    return world, view_state(Pose(lon, lat, 3000.0, 0.0, -math.pi / 2), SIZE)


def prepared(world: World) -> tuple[cull.Room, cull.Lists, np.ndarray]:
    """Slots as the arena fills them, without a GPU."""
    tile, forest = world.objects[0], world.forests[Lane.OBJECTS]
    slots, pool = make_slots(1), np.zeros(100, POOL)
    pool["dimension_m"][10 : 10 + len(tile.objects)] = tile.objects["dimension_m"]
    pool["index_end"][10 : 10 + len(tile.objects)] = tile.objects["index_end"]
    slots["uploaded"], slots["pool_start"], slots["pool_count"] = 1, 10, len(tile.objects)
    slots["centre"], slots["scale_m"] = tile.mesh.centre, tile.mesh.scale_m
    proxy = tile.proxies[0]
    slots[0]["proxy_first"][proxy["child"]] = proxy["index_start"]
    slots[0]["proxy_count"][proxy["child"]] = proxy["index_end"] - proxy["index_start"]
    rows = np.zeros(1, np.int32)
    boxes = forest.centre, forest.radius_m, cubes(forest.radius_m)
    lists = cull.Lists(rows, slots, *boxes, forest.records, make_pieces(1))
    return cull.make_room(8), lists, pool


def test_what_the_gpu_gets_is_exact_to_a_hundredth_of_a_pixel(
    rng: np.random.Generator,
) -> None:
    """The shader's float32 arithmetic against float64, at street level."""
    cell = int(cells.cell_at(-2.137, 0.659, 16))
    scale, worst = 60.0 / 32767, 0.0
    for _ in range(50):
        pose = Pose(-2.137, 0.659, 10.0, *rng.uniform(-1.5, 1.5, 2))
        view = view_state(pose, (1280, 720))
        slot = make_slots(1)
        slot["centre"], slot["uploaded"] = view.eye + rng.uniform(-60, 60, 3), 1
        slot["scale_m"] = scale
        lists = cull.Lists(
            np.zeros(1, np.int32),
            slot,
            slot["centre"].copy(),
            np.full(1, 200.0),
            cubes(np.full(1, 200.0)),
            np.zeros(1, INDEX),
            make_pieces(1),
        )
        room = cull.make_room(1)
        skirt = np.zeros(1, np.float32)
        seen = cull.cull_terrain(
            lists, whole(lists), skirt, fine(1), cull.eye_of(view), 1.0, room
        )
        assert seen[0] == 1
        steps = rng.integers(-32767, 32767, (2000, 3)).astype(np.float32)
        instance, block = room.instances[0], frame_block(view, PLAIN).reshape(-1, 4)
        seen = instance[:3] + (instance[16:19] + steps) * instance[3]
        camera = (seen[:, None, :] * block[None, :3, :3]).sum(-1, dtype=np.float32)
        pixel = 640 * block[0, 3] * camera[:, 0] / -camera[:, 2]
        exact = slot["centre"] + steps.astype(np.float64) * float(slot["scale_m"][0])
        truth = project(view, exact)
        chosen = (truth[:, 2] > 2) & (truth[:, 2] < 200) & (np.abs(truth[:, 0] - 640) < 640)
        worst = max(worst, float(np.abs(pixel + 640 - truth[:, 0])[chosen].max(initial=0)))
    assert int(cells.level(cell)) == 16
    assert 0.0 < worst <= 0.01


def test_slots_are_laid_out_for_kernels() -> None:
    assert SLOT.itemsize % 8 == 0
