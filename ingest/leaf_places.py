# SPDX-License-Identifier: Apache-2.0
"""Which places of a leaf may be vertices: on its edges, and posts inside."""

import numpy as np
from numpy.typing import NDArray

from ingest.posts import column_row
from ingest.upright import of_family
from tiles.frames import Floats
from tiles.kernels import inlined, kernel

RIM_STEPS = 64
"""An edge of a cell is straight among columns and rows over so small a part of it."""
NO_LINE = 1e-6
"""An edge along which a number changes by less crosses no line of that number."""


@kernel
def first_ones(at: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first of places, (n, 2), that are alike, in their order."""
    room = 2
    while room < 2 * len(at):
        room *= 2
    slots, kept = np.full(room, -1), np.empty(len(at), np.int64)
    count = 0
    for i in range(len(at)):
        slot = (at[i, 0] * 40_503 + at[i, 1] * 2_654_435_761 >> 7) & (room - 1)
        while slots[slot] >= 0:
            other = slots[slot]
            if at[other, 0] == at[i, 0] and at[other, 1] == at[i, 1]:
                break
            slot = (slot + 1) & (room - 1)
        if slots[slot] < 0:
            slots[slot] = kept[count] = i
            count += 1
    return kept[:count]


@kernel
def posts_inside(uv: Floats) -> Floats:
    """Return those of places, (h, w, 2) fractions of a cell, that lie in it, (n, 2)."""
    found, count = np.empty((uv.shape[0] * uv.shape[1], 2)), 0
    for r in range(uv.shape[0]):
        for c in range(uv.shape[1]):
            u, v = uv[r, c, 0], uv[r, c, 1]
            if 1e-9 < u < 1.0 - 1e-9 and 1e-9 < v < 1.0 - 1e-9:
                found[count, 0], found[count, 1] = u, v
                count += 1
    return found[:count]


@kernel
def rim_crossings(grid: Floats) -> Floats:
    """Return where a cell's edges cross columns, rows or diagonals of posts, (n, 2).

    Parameters
    ----------
    grid : (2, 6) of `posts`
    """
    numbers = np.empty(RIM_STEPS + 1)
    found, count = np.empty((64, 2)), 0
    for edge in range(4):
        for family in range(3):
            if not _numbers_along(grid, edge, family, numbers):
                continue
            for i in range(RIM_STEPS):
                start, end = numbers[i], numbers[i + 1]
                low, high = min(start, end), max(start, end)
                for n in range(int(np.ceil(low)), int(np.floor(high)) + 1):
                    if n == end and i < RIM_STEPS - 1:
                        continue  # the next step has it
                    if count == len(found):
                        found = np.concatenate((found, np.empty_like(found)))
                    t = (i + (n - start) / (end - start)) / RIM_STEPS
                    found[count, 0], found[count, 1] = _on_edge(edge, t)
                    count += 1
    return found[:count]


@inlined
def _on_edge(edge: int, t: float) -> tuple[float, float]:
    """Return a place on the south, north, west or east edge of a cell."""
    u = t if edge < 2 else edge - 2.0
    v = t if edge >= 2 else edge + 0.0
    return u, v


@inlined
def _numbers_along(grid: Floats, edge: int, family: int, numbers: Floats) -> bool:
    """Write an edge's columns, rows or diagonals; says whether they only rise or fall."""
    for i in range(RIM_STEPS + 1):
        u, v = _on_edge(edge, i / RIM_STEPS)
        x, y = column_row(grid, u, v)
        numbers[i] = of_family(family, x, y)
    rise = numbers[RIM_STEPS] - numbers[0]
    one_way = abs(rise) >= NO_LINE
    for i in range(RIM_STEPS):
        one_way = one_way and (numbers[i + 1] - numbers[i]) * rise > 0.0
    return bool(one_way)
