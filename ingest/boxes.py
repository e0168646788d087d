# SPDX-License-Identifier: Apache-2.0
"""Boxes of longitude and latitude, which may reach over the antimeridian."""

from functools import lru_cache

import numpy as np

from tiles import cells, geodesy

Box = tuple[float, float, float, float]
"""west, south, east, north, degrees; east may exceed 180"""
DEGREE_M = 111e3
"""A little less than the shortest degree of a great circle, so that boxes grow enough."""
POLE_DEG = 89.9
"""What reaches further has all longitudes."""


@lru_cache(65536)
def edges_rad(cell: int) -> Box:
    """Return the west, south, east and north edge of a cell; asked for often."""
    west, south, east, north = (float(edge) for edge in cells.bounds_rad(cell))
    return west, south, east, north


@lru_cache(65536)
def edge_m(cell: int) -> float:
    """Return the true edge of a cell, the root of its area."""
    return float(geodesy.cell_edge_m(cell))


def grown(box: Box, margin_m: float) -> Box:
    """Return a box that is larger by a margin on all sides, also over a pole."""
    west, south, east, north = box
    up = margin_m / DEGREE_M
    if up and max(-south, north) + up >= POLE_DEG:
        return -180.0, south - up, 180.0, north + up
    poleward = max(abs(south), abs(north)) + up
    side = up / float(np.cos(np.radians(poleward)))
    return west - side, south - up, east + side, north + up


def meet(one: Box, other: Box) -> bool:
    """Say whether two boxes have a part in common."""
    return _common(one, other, 360.0) is not None


def overlap(cell: int, box: Box) -> Box | None:
    """Return the common part of a cell and a box, radians, or None."""
    west, south, east, north = np.radians(box).tolist()
    return _common(edges_rad(cell), (west, south, east, north), 2 * np.pi)


def touches(cell: int, boxes: list[Box]) -> bool:
    """Say whether a cell meets any of the boxes."""
    return any(overlap(cell, box) is not None for box in boxes)


def _common(one: tuple[float, ...], other: Box, turn: float) -> Box | None:
    west, south, east, north = one
    for off in (-turn, 0.0, turn):
        w, e = max(west, other[0] + off), min(east, other[2] + off)
        s, n = max(south, other[1]), min(north, other[3])
        if w < e and s < n:
            return w, s, e, n
    return None


@lru_cache(65536)
def window_in(ancestor: int, cell: int) -> tuple[float, float, float]:
    """Return (u, v, size) of a cell in an ancestor, fractions, exact."""
    below, top = _zeros(cell), _zeros(ancestor)
    depth = (top - below) // 2
    row = col = 0
    for bit in range(depth):
        child = cell >> below + 1 + 2 * bit
        row, col = row | (child >> 1 & 1) << bit, col | (child & 1) << bit
    scale = 2.0**-depth
    return col * scale, row * scale, scale


def _zeros(cell: int) -> int:
    """Return the number of zeros below the lowest one bit of a cell's id."""
    return (cell & -cell).bit_length() - 1
