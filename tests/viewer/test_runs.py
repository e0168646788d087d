# SPDX-License-Identifier: Apache-2.0
"""What is left out of a terrain tile is not in the picture, or behind the planet."""

import math

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from geopage.screen_error import LOWEST_M
from geopage.view import ViewState
from tests.viewer.worlds import (
    ROOTS,
    World,
    checker,
    make_world,
    terrain_tile,
    whole_list,
)
from tiles import cells, geodesy
from tiles.blocks import MOST_PIECES
from tiles.frames import WGS84_B_M, Ecef, Floats
from tiles.lanes import Lane
from tiles.mesh import SKIRT, UV_ONE
from tiles.terrain import MOST_RUNGS, TerrainTile
from viewer import cull
from viewer.arena import ArenaSize
from viewer.camera import Pose, project, view_state
from viewer.clearance import LEAN
from viewer.renderer import Renderer
from viewer.runs import GAP, MOST_RUNS
from viewer.slots import make_pieces, make_slots, put_parts

SIZE = (320, 200)
SIDE = 33
PLACES = ((0.2, 0.3), (-3.14159, -0.5), (1.0, 1.5705), (-2.0, -1.5706))
"""Ordinary ground, the antimeridian and both poles; longitude, latitude, rad"""
Runs = NDArray[np.int64]


def waves(lon: Floats, lat: Floats) -> Floats:
    """Mountains 8 km high, alike in all tiles."""
    x, y, z = np.moveaxis(geodesy.up(lon, lat), -1, 0)
    steep = np.sin(900 * x) + np.sin(700 * y + 1) + np.sin(800 * z + 2)
    return np.asarray(4000 + 1300 * steep)


def around(lon: float, lat: float, level: int) -> World:
    """The tile over a place, all tiles beside it, and the globe's other zones."""
    middle = int(cells.cell_at(lon, lat, level))
    row, col = (int(one) for one in cells.global_row_col(middle))
    wide, high = 8 << level, 4 << level
    near = {
        int(cells.from_global(level, r, (col + c) % wide))
        for r in range(max(row - 1, 0), min(row + 2, high))
        for c in (-1, 0, 1)
    }
    tints = checker((200, 80, 40), (60, 120, 200), 16)
    tiles = [terrain_tile(cell, tints, SIDE, waves) for cell in sorted(near)]
    others = ROOTS[~np.isin(ROOTS, cells.ancestor(np.array(sorted(near)), 0))]
    tiles += [terrain_tile(int(cell), tints, 5) for cell in others]
    return make_world(tiles)


def poses(rng: np.random.Generator, place: tuple[float, float], level: int) -> list[Pose]:
    """Over and in a tile and beside it: down, along, from the street, near its edges."""
    size = math.pi / 4 / 2**level
    lon, lat = place
    found = []
    for height_m in (9000.0, 9500.0, 1.1e4, 1.3e4, 3e4, 2e5):
        for pitch in (-math.pi / 2, -0.9, -0.3, -0.05):
            aside = rng.uniform(-1, 1, 2) * size
            wide = max(math.cos(lat), 1e-3)
            at = lon + aside[0] / wide, np.clip(lat + aside[1], -1.5707, 1.5707)
            found.append(
                Pose(float(at[0]), float(at[1]), height_m, rng.uniform(0, 6), pitch)
            )
    return found


def uploaded(world: World) -> tuple[cull.Lists, NDArray[np.int32]]:
    """Slots as the arena fills them, without a GPU."""
    forest = world.forests[Lane.TERRAIN]
    slots, pieces = make_slots(len(world.terrain)), make_pieces(len(world.terrain))
    for row, tile in world.terrain.items():
        slot = slots[row]
        slot["centre"], slot["scale_m"] = tile.mesh.centre, tile.mesh.scale_m
        slot["uploaded"], slot["layer"] = 1, row
        slot["box_rad"] = cells.bounds_rad(tile.cell)
        put_parts(slot, pieces[row], tile)
    rows = np.array(sorted(world.terrain), np.int32)
    boxes = np.repeat(forest.radius_m[:, None], 5, axis=1).astype(np.float32)
    spheres = forest.centre, forest.radius_m, boxes
    return cull.Lists(rows, slots, *spheres, forest.records, pieces), rows


def skirt_m(cell: int) -> float:
    """How deep a skirt hangs: about a tile's error."""
    return 20_000.0 / 2.0 ** int(cells.level(cell))


def runs_of(lists: cull.Lists, row: int, view: ViewState) -> Runs:
    runs = np.empty((MOST_RUNS, 2), np.int64)
    deep_m = skirt_m(int(lists.records["cell"][row]))
    count = cull.terrain_runs(lists, row, 0, deep_m, cull.eye_of(view), runs)
    return runs[:count]


def walls(tile: TerrainTile) -> tuple[Floats, Floats, Floats]:
    """A skirt as it is drawn: its triangles, and an edge of the cell and up for each."""
    steps, mesh = tile.mesh.indices[tile.surface_index_count :].reshape(-1, 3), tile.mesh
    up = tile.mesh.centre / np.linalg.norm(tile.mesh.centre)
    east = np.cross((0.0, 0.0, 1.0), up) / math.hypot(*up[:2])
    at = mesh.vertices["detail"].astype(float) / UV_ONE
    lean = (at == 1.0) * 1.0 - (at == 0.0)
    away = lean[:, :1] * east + lean[:, 1:] * np.cross(up, east)
    hangs = (mesh.vertices["flags"] == SKIRT)[:, None]
    rim = mesh.local + mesh.centre
    drawn = rim + hangs * skirt_m(tile.cell) * (LEAN * away - up)
    lon, lat, _ = geodesy.to_geodetic(Ecef(rim[steps].mean(axis=1)))
    # Two of a triangle's corners are above each other.
    edges = rim[steps[:, 2]] - rim[steps[:, 0]]
    return drawn[steps], edges, geodesy.up(lon, lat)


def in_picture(view: ViewState, corners: Floats) -> NDArray[np.bool_]:
    """Say which triangles (t, 3, 3) have one of many of their points in the picture.

    A point has set where the way to it from the eye goes through a sphere below all ground.
    """
    steps = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4
    points = np.einsum("pk,tkx->tpx", steps, corners)
    x, y, depth = np.moveaxis(project(view, points), -1, 0)
    inside = (depth > 0) & (x >= 0) & (x <= SIZE[0]) & (y >= 0) & (y <= SIZE[1])
    way = points - view.eye
    part = np.clip(-(way @ view.eye) / (way**2).sum(axis=-1), 0.0, 1.0)
    nearest_m = np.linalg.norm(view.eye + part[..., None] * way, axis=-1)
    return np.asarray((inside & (nearest_m > WGS84_B_M - LOWEST_M)).any(axis=1))


@pytest.mark.parametrize("level", [0, 5, 9])
@pytest.mark.parametrize("place", PLACES)
def test_all_triangles_in_the_picture_are_in_a_run(
    place: tuple[float, float], level: int, rng: np.random.Generator
) -> None:
    world = around(*place, level)
    lists, rows = uploaded(world)
    left_out = np.zeros(2)
    for pose in poses(rng, place, level):
        view = view_state(pose, SIZE)
        for row in rows[lists.slots["in_pieces"][rows] > 0].tolist():
            tile, runs = world.terrain[row], runs_of(lists, row, view)
            count, total = tile.surface_index_count, len(tile.mesh.indices)
            if runs.tolist() == [[0, total]]:
                continue
            first, end = runs[:, 0], runs.sum(axis=1)
            assert (first[1:] - end[:-1] > 3 * GAP).all()
            assert (runs % 3 == 0).all()
            assert first.min(initial=0) >= 0
            assert end.max(initial=0) <= total
            drawn = np.zeros(total, np.bool_)
            for a, b in zip(first.tolist(), end.tolist(), strict=True):
                drawn[a:b] = True
            corners = tile.mesh.local[tile.surface()] + tile.mesh.centre
            assert drawn[:count:3][in_picture(view, corners)].all()
            skirt, edges, up = walls(tile)
            outwards = ((view.eye - skirt[:, 0]) * np.cross(edges, up)).sum(axis=1)
            # At a pole a side has no length.
            faces = outwards > 1e-3 * np.linalg.norm(edges, axis=1)
            assert drawn[count::3][in_picture(view, skirt) & faces].all()
            left_out += (count - drawn[:count].sum(), total - count - drawn[count:].sum())
    assert (left_out > 3000).all()


def test_what_has_set_is_left_out() -> None:
    """From 20 km high the horizon is at about 500 km; a zone is 5,000 km wide."""
    world = around(0.2, 0.3, 0)
    lists, _ = uploaded(world)
    view = view_state(Pose(0.4, 0.4, 20_000.0, 4.0, -0.1), SIZE)
    row = int(world.forests[Lane.TERRAIN].row_of(int(cells.cell_at(0.2, 0.3, 0))))
    tile, runs = world.terrain[row], runs_of(lists, row, view)
    shown = in_picture(view, tile.mesh.local[tile.surface()] + tile.mesh.centre).sum()
    assert 3 * shown < runs[:, 1].sum() < len(tile.mesh.indices) / 3


def test_a_surface_wholly_in_the_picture_or_small_is_in_one_run() -> None:
    world = around(0.2, 0.3, 9)
    lists, rows = uploaded(world)
    view = view_state(Pose(0.2, 0.3, 3e6, 0.0, -math.pi / 2), SIZE)
    for row in rows.tolist():
        tile = world.terrain[row]
        runs = runs_of(lists, row, view).tolist()
        below = int(cells.level(tile.cell)) == 9
        assert runs or not below
        if below or (runs and len(tile.surface()) < 64):
            assert runs[0][0] == 0
            assert runs[0][1] >= tile.surface_index_count


def test_a_tile_that_sinks_is_drawn_whole() -> None:
    """A stand-in above the eye is drawn lower, so that its boxes do not count."""
    world = around(0.2, 0.3, 9)
    lists, _ = uploaded(world)
    row = int(world.forests[Lane.TERRAIN].row_of(int(cells.cell_at(0.2, 0.3, 9))))
    total = len(world.terrain[row].mesh.indices)
    view = view_state(Pose(0.2, 0.3, 1000.0, 0.0, -0.3), SIZE)
    lists.records["max_height_m"] = 8000.0
    assert runs_of(lists, row, view)[:, 1].sum() < total
    lists.records["children"][row] = 15
    assert runs_of(lists, row, view).tolist() == [[0, total]]
    lists.records["max_height_m"] = 900.0
    assert runs_of(lists, row, view)[:, 1].sum() < total


def test_each_rung_has_blocks_of_its_own() -> None:
    slots, pieces = make_slots(1), make_pieces(1)
    tile = next(iter(around(0.2, 0.3, 9).terrain.values()))
    put_parts(slots[0], pieces[0], tile)
    assert pieces.shape == (1, 1 + MOST_RUNGS, MOST_PIECES)
    assert (pieces[0] == tile.pieces[0]).all()


def test_where_there_is_no_room_for_runs_tiles_are_drawn_whole(
    rng: np.random.Generator,
) -> None:
    world = around(0.2, 0.3, 5)
    lists, rows = uploaded(world)
    arrays = np.zeros(len(rows), np.uint8), np.zeros(len(rows), np.float32)
    detail_m = np.zeros(len(rows), np.float32)
    fewest, most = 0, 0
    for pose in poses(rng, PLACES[0], 5):
        eye = cull.eye_of(view_state(pose, SIZE))
        found = []
        for draws in (len(rows), 40 * len(rows)):
            room = cull.make_room(draws)
            found.append(cull.cull_terrain(lists, *arrays, detail_m, eye, 1.0, room))
            assert found[-1][0] <= draws
            instances = room.commands[: found[-1][0], 4]
            # The parts of a tile follow each other.
            assert set(instances.tolist()) <= set(range(found[-1][4]))
            assert (np.diff(instances) != 0).sum() == len(set(instances.tolist())) - 1
            assert 3 * found[-1][1] == room.commands[: found[-1][0], 0].sum()
        assert found[0][4] == found[1][4]
        fewest, most = fewest + found[1][1], most + found[0][1]
    assert fewest < most


@pytest.mark.parametrize("level", [5, 9])
@pytest.mark.parametrize("place", PLACES)
def test_the_picture_is_that_of_whole_tiles(
    gl_context: moderngl.Context,
    place: tuple[float, float],
    level: int,
    rng: np.random.Generator,
) -> None:
    world = around(*place, level)
    renderer = Renderer(
        world.forests, SIZE, ArenaSize(8 << 20, 8 << 20, 64, 64), 1, gl_context
    )
    for row, tile in world.terrain.items():
        assert renderer.upload(Lane.TERRAIN, row, tile)
    slots = renderer.arena.slots[Lane.TERRAIN]
    held, triangles, grown = slots["in_pieces"].copy(), [0, 0], 0
    for pose in poses(rng, place, level)[::2]:
        view = view_state(pose, SIZE)
        drawn = whole_list(world, view)
        drawn.skirt_m[:] = 0.0  # their tiles end where there are none beside them
        seen = []
        for which in range(2):
            slots["in_pieces"] = held * which
            stats = renderer.draw(drawn, view)
            triangles[which] += stats.triangles
            grown += (1 if which else -1) * stats.draw_calls
            seen.append((renderer.read_rgb(), renderer.read_ids(), renderer.read_empty()))
        for a, b in zip(*seen, strict=True):
            assert np.array_equal(a, b)
    assert triangles[1] < 0.75 * triangles[0]
    assert grown > 0
    renderer.release()
