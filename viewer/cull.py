# SPDX-License-Identifier: Apache-2.0
"""From a draw list and the newest pose to GPU commands, in kernels.

A command is what glMultiDrawElementsIndirect reads: index count, instance count, first
index, base vertex, base instance. Its base instance is the number of its record in the
instance array (viewer/draw_record.py). Commands are sorted from near to far, so that near
surfaces hide far ones before those are shaded.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.screen_error import (
    STILL,
    Lens,
    Sweep,
    blur_px,
    error_px_per_m,
    is_hidden,
    lens_of,
    px_per_m,
)
from geopage.view import ViewState
from tiles import geodesy
from tiles.frames import Ecef
from tiles.kernels import brief, inlined
from tiles.terrain import TEXTURE_SIDE
from viewer.clearance import LEAN
from viewer.draw_record import INSTANCE_FLOATS, fill
from viewer.look import HIGH_M
from viewer.slots import FAR_PERIOD, NEAR_PERIOD, PATCH_M

COMMAND_WORDS = 5
GRAIN_TEXEL_PX = 1.6
"""A texel must be larger than this for the ground to show grain (terrain.frag)."""
NEAREST_FIRST = 1e12
CHILDREN = 4


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
def _command(command: NDArray[np.uint32], slot: np.void, first: int, count: int) -> None:
    command[0] = count
    command[1] = 1
    command[2] = slot["first_index"] + first
    command[3] = slot["base_vertex"]


@inlined
def _sort(
    keys: NDArray[np.float64],
    commands: NDArray[np.uint32],
    sorted_commands: NDArray[np.uint32],
    n: int,
) -> None:
    order = np.argsort(keys[:n])
    for i in range(n):
        sorted_commands[i] = commands[order[i]]
        sorted_commands[i, 4] = order[i]


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
    half_m: NDArray[np.float32]
    """(n, 3) `Tree.half_m`"""
    records: NDArray[np.void]


@brief
def cull_terrain(
    lists: Lists,
    rung: NDArray[np.uint8],
    skirt_m: NDArray[np.float32],
    detail_m: NDArray[np.float32],
    eye: Eye,
    picture_px: float,
    room: Room,
) -> tuple[int, int, float, tuple[int, int, int]]:
    """Fill `room` with the visible terrain tiles, sorted by kind.

    Parameters
    ----------
    rung : (n,) which mesh of each tile is drawn
    detail_m : (rows of the forest,) size of what a tile's data show; smaller is a texel

    Returns
    -------
    draws, triangles, screen error in px as a mean weighted by the tiles' areas, and how
    many of the draws are of each kind: grain and water, grain, water; the others follow
    """
    n, triangles, error_sum, area_sum = 0, 0, 0.0, 1e-9
    kinds = np.zeros(4, np.int64)
    period = FAR_PERIOD if eye.place[2] > HIGH_M else NEAR_PERIOD
    for entry in range(len(lists.rows)):
        row = lists.rows[entry]
        slot = lists.slots[row]
        radius = lists.radius_m[row] + skirt_m[entry]
        centre = lists.centre[row]
        if slot["uploaded"] == 0 or not is_visible(centre, radius, eye):
            continue
        record = lists.records[row]
        scale = error_px_per_m(eye.lens, centre, lists.radius_m[row], lists.half_m[row])
        part = rung[entry]
        error_px = scale * max(slot["part_error_m"][part], record["texel_m"])
        fill(room.instances[n], slot, eye.lens.eye, entry, error_px)
        room.instances[n, 7] = skirt_m[entry]
        room.instances[n, 14] = LEAN
        room.instances[n, 8] = slot["noise"][0] % period
        room.instances[n, 9] = slot["noise"][1] % period
        room.instances[n, 10] = slot["noise"][2]
        room.instances[n, 11] = slot["layer"]
        count = slot["part_count"][part]
        _command(room.unsorted[n], slot, slot["part_first"][part], count)
        texel_m = slot["noise"][2] * PATCH_M / TEXTURE_SIDE
        seen_m = max(texel_m, detail_m[row])
        room.instances[n, 15] = seen_m / max(texel_m, 1e-6)
        kind = 3 - (2 if seen_m * scale > GRAIN_TEXEL_PX else 0) - slot["wet"]
        kinds[kind] += 1
        room.keys[n] = kind - scale / (1.0 + scale)
        n += 1
        triangles += count // 3
        area = min((2.0 * radius * scale) ** 2, picture_px)
        error_sum += area * min(error_px, 1e6)
        area_sum += area
    _sort(room.keys, room.unsorted, room.commands, n)
    return n, triangles, error_sum / area_sum, (kinds[0], kinds[1], kinds[2])


@brief
def count_above(pool: NDArray[np.void], slot: np.void, dimension_m: float) -> int:
    """Return how many of a tile's own objects are larger, by bisection."""
    low, high = slot["pool_start"], slot["pool_start"] + slot["pool_count"]
    while low < high:
        middle = (low + high) // 2
        if pool[middle]["dimension_m"] > dimension_m:
            low = middle + 1
        else:
            high = middle
    return int(low - slot["pool_start"])


@brief
def cull_objects(
    lists: Lists,
    parts: tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.void], NDArray[np.uint8]],
    shares: NDArray[np.float32],
    eye: Eye,
    threshold_px: float,
    room: Room,
) -> tuple[int, int, int, int]:
    """Fill `room` with the visible own objects above the threshold and the proxies.

    Parameters
    ----------
    parts : `own` and `proxies` of the draw list, the pool of object tables, and
        `Coats.proxies`
    shares : (m, 2) `Fade.shares`, or (0, 2) when nothing fades

    Returns
    -------
    draws, triangles, objects (own objects and proxies), and how many of the draws, at
    the end, fade
    """
    own, proxies, pool, coats = parts
    n, triangles, objects, fading = 0, 0, 0, 0
    low, high = np.float32(0.0), np.float32(1.0)
    for entry in range(len(lists.rows)):
        row = lists.rows[entry]
        slot = lists.slots[row]
        radius = lists.radius_m[row]
        centre = lists.centre[row]
        if len(shares):
            low, high = shares[entry, 0], shares[entry, 1]
        if slot["uploaded"] == 0 or low >= high or not is_visible(centre, radius, eye):
            continue
        is_solid = low == 0.0 and high == 1.0
        scale = px_per_m(eye.lens, centre[0], centre[1], centre[2], radius)
        least = threshold_px
        if eye.lens.sweep.shutter_s > 0.0:
            blur = blur_px(eye.lens, centre[0], centre[1], centre[2], radius)
            least = max(blur, threshold_px)
        seen = count_above(pool, slot, least / scale) if own[entry] else 0
        for part in range(CHILDREN + 1):
            first, count = 0, 0
            if part == CHILDREN and seen > 0:
                count = pool[slot["pool_start"] + seen - 1]["index_end"]
            elif part < CHILDREN and proxies[entry] >> part & 1:
                first, count = slot["proxy_first"][part], slot["proxy_count"][part]
            if count <= 0 or n == len(room.keys):
                continue
            fill(room.instances[n], slot, eye.lens.eye, entry, 0.0)
            room.instances[n, 8] = slot["seed"]
            room.instances[n, 9], room.instances[n, 10] = low, high
            room.instances[n, 11] = (
                slot["pool_start"] if part == CHILDREN else coats[row, part]
            )
            _command(room.unsorted[n], slot, first, count)
            room.keys[n] = -scale
            if not is_solid:
                room.keys[n] += NEAREST_FIRST
                fading += 1
            n += 1
            triangles += count // 3
            objects += seen if part == CHILDREN else 1
    _sort(room.keys, room.unsorted, room.commands, n)
    return n, triangles, objects, fading
