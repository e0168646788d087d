# SPDX-License-Identifier: Apache-2.0
"""From a draw list and the newest pose to GPU commands, in kernels; here the terrain's.

A command is what glMultiDrawElementsIndirect reads: index count, instance count, first
index, base vertex, base instance. Its base instance is the number of its record in the
instance array (viewer/draw_record.py). Commands are sorted from near to far, so that near
surfaces hide far ones before those are shaded. A terrain tile that is only partly in the
picture has a command for each run of its blocks there (viewer/runs.py), and one record.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.cell_error import error_px_per_m
from geopage.screen_error import (
    STILL,
    Lens,
    Sweep,
    is_hidden,
    lens_of,
)
from geopage.view import ViewState
from tiles import geodesy
from tiles.frames import Ecef
from tiles.kernels import brief, inlined
from tiles.terrain import TEXTURE_SIDE
from viewer.clearance import LEAN, ROUNDED, beside_m, may_sink
from viewer.draw_record import INSTANCE_FLOATS, fill
from viewer.facing import faces
from viewer.look import HIGH_M
from viewer.runs import MOST_RUNS, seen_runs, whole_run
from viewer.slots import FAR_PERIOD, NEAR_PERIOD, PATCH_M

COMMAND_WORDS = 5
TERRAIN_DRAWS = 4
"""Commands for a terrain tile that there is room for, on average."""
GRAIN_TEXEL_PX = 1.6
"""A texel must be larger than this for the ground to show grain (terrain.frag)."""
SKIRT_REACH = math.sqrt(1 + 2 * LEAN**2)
"""A skirt's lower edge is at most so many times its depth from the rim, at a corner."""
TerrainDraws = tuple[int, int, float, tuple[int, int, int], int]
"""Of `cull_terrain`"""


class Eye(NamedTuple):
    """What the kernels need of a view."""

    lens: Lens
    planes: NDArray[np.float64]
    """(5, 3) inward unit normals through the eye: left, right, bottom, top, front"""
    place: tuple[float, float, float]
    """longitude, latitude, height (rad, rad, m)"""


def eye_of(view: ViewState, sweep: Sweep = STILL) -> Eye:
    """Return a view, and how it moves, as the kernels take it."""
    x, y = view.width_px / 2 / view.focal_px, view.height_px / 2 / view.focal_px
    camera = np.array(
        ((1, 0, -x), (-1, 0, -x), (0, 1, -y), (0, -1, -y), (0, 0, -1)), np.float64
    )
    camera /= np.linalg.norm(camera, axis=1, keepdims=True)
    lon, lat, height_m = (float(x) for x in geodesy.to_geodetic(Ecef(view.eye)))
    planes = np.ascontiguousarray(camera @ view.rotation)
    return Eye(lens_of(view, sweep=sweep), planes, (lon, lat, height_m))


@brief
def is_visible(centre: NDArray[np.float64], radius_m: float, eye: Eye) -> bool:
    """Say whether a sphere may be in the picture: in its pyramid, before the horizon."""
    x, y = centre[0] - eye.lens.eye[0], centre[1] - eye.lens.eye[1]
    z = centre[2] - eye.lens.eye[2]
    for i in range(5):
        plane = eye.planes[i]
        if plane[0] * x + plane[1] * y + plane[2] * z < -radius_m:
            return False
    return not is_hidden(eye.lens, x, y, z, radius_m)


@inlined
def put_command(
    command: NDArray[np.uint32], slot: np.void, first: int, count: int, instance: int
) -> None:
    """Write a command that draws a range of a mesh with a record."""
    command[0] = count
    command[1] = 1
    command[2] = slot["first_index"] + first
    command[3] = slot["base_vertex"]
    command[4] = instance


class Room(NamedTuple):
    """Preallocated arrays that the kernels write."""

    commands: NDArray[np.uint32]
    """(n, 5) sorted near to far"""
    instances: NDArray[np.float32]
    """(n, 20) viewer/draw_record.py"""
    unsorted: NDArray[np.uint32]
    keys: NDArray[np.float64]


def make_room(draws: int) -> Room:
    """Return arrays for a number of draws."""
    return Room(
        np.zeros((draws, COMMAND_WORDS), np.uint32),
        np.zeros((draws, INSTANCE_FLOATS), np.float32),
        np.zeros((draws, COMMAND_WORDS), np.uint32),
        np.zeros(draws, np.float64),
    )


class Lists(NamedTuple):
    """One lane of a draw list with the arrays that its rows point to."""

    rows: NDArray[np.int32]
    slots: NDArray[np.void]
    centre: NDArray[np.float64]
    radius_m: NDArray[np.float64]
    box_m: NDArray[np.float32]
    """(n, 5) `Tree.box_m`"""
    records: NDArray[np.void]
    pieces: NDArray[np.void]
    """(layers, 1 + MOST_RUNGS, MOST_PIECES) of terrain tiles, by texture layer"""


@brief
def terrain_runs(
    lists: Lists,
    row: int,
    part: int,
    skirt_m: float,
    eye: Eye,
    runs: NDArray[np.int64],
) -> int:
    """Write what of a visible tile's mesh may be in the picture; returns how many runs.

    Parameters
    ----------
    skirt_m : its skirt's depth; infinite to draw all of it
    runs : (MOST_RUNS, 2) first index and number of indices, both from the mesh's start
    """
    slot = lists.slots[row]
    # What sinks is drawn elsewhere than its boxes say.
    if _may_sink(lists, row, eye):
        return whole_run(slot, part, runs)
    sphere, view = (lists.centre[row], lists.radius_m[row]), (eye.lens, eye.planes)
    reach_m = SKIRT_REACH * skirt_m
    margin_m = 2 * skirt_m + ROUNDED * slot["scale_m"]
    sides = faces(slot["box_rad"], eye.lens.eye, eye.place[0], margin_m)
    pieces = lists.pieces[slot["layer"], part]
    return seen_runs(slot, pieces, part, sphere, view, (sides, reach_m), runs)


@inlined
def _may_sink(lists: Lists, row: int, eye: Eye) -> bool:
    record, slot = lists.records[row], lists.slots[row]
    if record["max_height_m"] <= eye.place[2]:
        return False
    away_m = beside_m(slot["box_rad"], eye.place)
    return may_sink(away_m, slot["scale_m"], record["children"])


@inlined
def has_whole_skirts(lists: Lists, eye: Eye) -> bool:
    """Say whether no skirt may be left out: without planes, or where a tile sinks.

    All skirts reach as much deeper as it sinks.
    """
    found = not eye.planes.any()
    for row in lists.rows:
        found = found or _may_sink(lists, row, eye)
    return found


@brief
def cull_terrain(
    lists: Lists,
    rung: NDArray[np.uint8],
    skirt_m: NDArray[np.float32],
    detail_m: NDArray[np.float32],
    eye: Eye,
    picture_px: float,
    room: Room,
) -> TerrainDraws:
    """Fill `room` with the visible parts of terrain tiles, sorted by kind.

    Parameters
    ----------
    rung : (n,) which mesh of each tile is drawn
    detail_m : (rows of the forest,) size of what a tile's data show; smaller is a texel;
        negative where nothing may be made up between them

    Returns
    -------
    draws, triangles, screen error in px as a mean weighted by the tiles' areas, and how
    many of the draws are of each kind: grain and water, grain, water; the others follow;
    and the number of tiles, which is that of records
    """
    n, error_sum, area_sum = 0, 0.0, 1e-9
    runs = np.empty((len(lists.rows), MOST_RUNS, 2), np.int64)
    counts, whole = np.empty(len(lists.rows), np.int64), has_whole_skirts(lists, eye)
    period = FAR_PERIOD if eye.place[2] > HIGH_M else NEAR_PERIOD
    for entry in range(len(lists.rows)):
        row = lists.rows[entry]
        slot = lists.slots[row]
        radius = lists.radius_m[row] + skirt_m[entry]
        centre = lists.centre[row]
        if slot["uploaded"] == 0 or not is_visible(centre, radius, eye):
            continue
        part, deep_m = rung[entry], np.inf if whole else float(skirt_m[entry])
        counts[n] = terrain_runs(lists, row, part, deep_m, eye, runs[n])
        if counts[n] == 0:
            continue
        record = lists.records[row]
        scale = error_px_per_m(
            eye.lens, centre, lists.radius_m[row], lists.box_m[row], slot["box_rad"]
        )
        error_px = scale * max(slot["part_error_m"][part], record["texel_m"])
        fill(room.instances[n], slot, eye.lens.eye, entry, error_px)
        room.instances[n, 7] = skirt_m[entry]
        room.instances[n, 14] = LEAN
        room.instances[n, 8] = slot["noise"][0] % period
        room.instances[n, 9] = slot["noise"][1] % period
        room.instances[n, 10] = slot["noise"][2]
        room.instances[n, 11] = slot["layer"]
        texel_m = slot["noise"][2] * PATCH_M / TEXTURE_SIDE
        seen_m = max(texel_m, abs(detail_m[row]))
        room.instances[n, 15] = seen_m / max(texel_m, 1e-6)
        grains = detail_m[row] >= 0 and seen_m * scale > GRAIN_TEXEL_PX
        kind = 3 - (2 if grains else 0) - slot["wet"]
        room.keys[n] = kind + 0.5 / (1.0 + scale)
        n += 1
        area = min((2.0 * radius * scale) ** 2, picture_px)
        error_sum += area * min(error_px, 1e6)
        area_sum += area
    draws, triangles, kinds = _command_runs(lists, rung, (counts[:n], runs), room)
    return draws, triangles, error_sum / area_sum, kinds, n


@brief
def _command_runs(
    lists: Lists,
    rung: NDArray[np.uint8],
    parts: tuple[NDArray[np.int64], NDArray[np.int64]],
    room: Room,
) -> tuple[int, int, tuple[int, int, int]]:
    """Write the commands of the tiles that have records and keys, in the keys' order.

    Parameters
    ----------
    parts : how many runs each record's tile has, (n,), and the runs

    Returns
    -------
    draws, triangles, and draws of the first three kinds
    """
    counts, runs = parts
    tiles, kinds = len(counts), np.zeros(4, np.int64)
    n, indices, order = 0, 0, np.argsort(room.keys[:tiles])
    for i in range(tiles):
        entry, count, run = (
            int(room.instances[order[i], 12]),
            counts[order[i]],
            runs[order[i]],
        )
        slot, part = lists.slots[lists.rows[entry]], rung[entry]
        if n + count + tiles - 1 - i > len(room.commands):
            count = whole_run(slot, part, run)
        for k in range(count):
            first = slot["part_first"][part] + run[k, 0]
            put_command(room.commands[n], slot, first, run[k, 1], order[i])
            indices += run[k, 1]
            n += 1
        kinds[int(room.keys[order[i]])] += count
    return n, indices // 3, (kinds[0], kinds[1], kinds[2])
