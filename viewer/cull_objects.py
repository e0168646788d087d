# SPDX-License-Identifier: Apache-2.0
"""From a draw list and the newest pose to the GPU commands of buildings and proxies."""

import numpy as np
from numpy.typing import NDArray

from geopage.screen_error import blur_px, px_per_m
from tiles.kernels import brief, inlined
from viewer.cull import Eye, Lists, Room, is_visible, put_command
from viewer.draw_record import fill

NEAREST_FIRST = 1e12
CHILDREN = 4


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
            put_command(room.unsorted[n], slot, first, count, n)
            room.keys[n] = -scale
            if not is_solid:
                room.keys[n] += NEAREST_FIRST
                fading += 1
            n += 1
            triangles += count // 3
            objects += seen if part == CHILDREN else 1
    _sort(room.keys, room.unsorted, room.commands, n)
    return n, triangles, objects, fading
