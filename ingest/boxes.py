# SPDX-License-Identifier: Apache-2.0
"""Boxes of longitude and latitude, which may reach over the antimeridian."""

import numpy as np

from tiles import cells

Box = tuple[float, float, float, float]
"""west, south, east, north, degrees; east may exceed 180"""
DEGREE_M = 111e3
"""A little less than the shortest degree of a great circle, so that boxes grow enough."""


def grown(box: Box, margin_m: float) -> Box:
    """Return a box that is larger by a margin on all sides."""
    west, south, east, north = box
    up = margin_m / DEGREE_M
    poleward = min(89.0, max(abs(south), abs(north)) + up)
    side = up / float(np.cos(np.radians(poleward)))
    return west - side, south - up, east + side, north + up


def meet(one: Box, other: Box) -> bool:
    """Say whether two boxes have a part in common."""
    return _common(one, other, 360.0) is not None


def overlap(cell: int, box: Box) -> Box | None:
    """Return the common part of a cell and a box, radians, or None."""
    west, south, east, north = np.radians(box).tolist()
    return _common(
        tuple(float(edge) for edge in cells.bounds_rad(cell)),
        (west, south, east, north),
        2 * np.pi,
    )


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
