# SPDX-License-Identifier: Apache-2.0
"""Chunks of a raster's posts, 8 x 8 squares each, in ECEF, as kernels want them."""

import math

import numpy as np

from tiles.frames import WGS84_E2, Floats
from tiles.kernels import inlined, kernel
from tiles.points import Point
from tiles.source_posts import (
    COLS,
    FIRST,
    PLACE_COLS,
    PLACE_ROWS,
    ROWS,
    STEP,
    TABLE,
    WRAPS,
    Rasters,
)

SIDE = 8
"""Squares of posts along the edge of a chunk."""
ELLIPSE = 1.0 / (1.0 - WGS84_E2)
"""(a / b) squared: from a place on the ellipsoid to its normal"""


def new_room() -> Floats:
    """Return room for the posts of one chunk: (9, 9, 4) ECEF m around a point, height."""
    return np.empty((SIDE + 1, SIDE + 1, 4))


@kernel
def squares(rasters: Rasters, source: int) -> tuple[int, int]:
    """Return rows and columns of the squares between a source's posts."""
    shape = rasters.shape
    return shape[source, ROWS] - 1, shape[source, COLS] - 1 + shape[source, WRAPS]


@inlined
def _turned(col: int, cols: int) -> int:
    """Return the column again after one turn round the globe."""
    return col - cols if col >= cols else col


@kernel
def load(
    rasters: Rasters, source: int, row: int, col: int, near: Point, room: Floats
) -> tuple[int, int]:
    """Write the posts of a chunk into `room`, around `near`; NaN where no data.

    Returns
    -------
    Rows and columns of squares in the chunk.
    """
    shape = rasters.shape[source]
    high, wide = squares(rasters, source)
    top, left = row * SIDE, col * SIDE
    high, wide = min(high - top, SIDE), min(wide - left, SIDE)
    for r in range(high + 1):
        start = shape[FIRST] + (top + r) * shape[COLS]
        for c in range(wide + 1):
            room[r, c, 3] = rasters.height_m[start + _turned(left + c, shape[COLS])]
    if shape[STEP] == 0:
        _by_rows_and_columns(rasters, source, (top, left, high, wide), near, room)
    elif shape[STEP] == 1:
        for r in range(high + 1):
            for c in range(wide + 1):
                line = (
                    shape[TABLE] + (top + r) * shape[COLS] + _turned(left + c, shape[COLS])
                )
                foot = (
                    rasters.table[line, 0],
                    rasters.table[line, 1],
                    rasters.table[line, 2],
                )
                _stand(foot, near, room, r, c)
    else:
        _by_places(rasters, source, (top, left, high, wide), near, room)
    return high, wide


@kernel
def _by_rows_and_columns(
    rasters: Rasters,
    source: int,
    part: tuple[int, int, int, int],
    near: Point,
    room: Floats,
) -> None:
    """Place posts on meridians and parallels."""
    top, left, high, wide = part
    shape = rasters.shape[source]
    first = shape[TABLE] + shape[ROWS]
    for r in range(high + 1):
        line = shape[TABLE] + top + r
        axis, cos_lat = rasters.table[line, 0], rasters.table[line, 1]
        z, sin_lat = rasters.table[line, 2], rasters.table[line, 3]
        for c in range(wide + 1):
            way = first + _turned(left + c, shape[COLS])
            height = room[r, c, 3]
            out = axis + height * cos_lat
            room[r, c, 0] = out * rasters.table[way, 0] - near[0]
            room[r, c, 1] = out * rasters.table[way, 1] - near[1]
            room[r, c, 2] = z + height * sin_lat - near[2]


@kernel
def _by_places(
    rasters: Rasters,
    source: int,
    part: tuple[int, int, int, int],
    near: Point,
    room: Floats,
) -> None:
    """Place posts between known places by cubics through four of them."""
    top, left, high, wide = part
    shape = rasters.shape[source]
    step, count = shape[STEP], shape[PLACE_COLS]
    first_row = min(max(top // step - 1, 0), shape[PLACE_ROWS] - 4)
    first_col = min(max(left // step - 1, 0), count - 4)
    for c in range(wide + 1):
        at = _cubic((left + c) / step - first_col)
        rows = np.zeros((4, 3))
        for i in range(4):
            line = shape[TABLE] + (first_row + i) * count + first_col
            for j in range(4):
                for k in range(3):
                    rows[i, k] += at[j] * rasters.table[line + j, k]
        for r in range(high + 1):
            by = _cubic((top + r) / step - first_row)
            x = (
                by[0] * rows[0, 0]
                + by[1] * rows[1, 0]
                + by[2] * rows[2, 0]
                + by[3] * rows[3, 0]
            )
            y = (
                by[0] * rows[0, 1]
                + by[1] * rows[1, 1]
                + by[2] * rows[2, 1]
                + by[3] * rows[3, 1]
            )
            z = (
                by[0] * rows[0, 2]
                + by[1] * rows[1, 2]
                + by[2] * rows[2, 2]
                + by[3] * rows[3, 2]
            )
            _stand((x, y, z), near, room, r, c)


@kernel
def _cubic(x: float) -> tuple[float, float, float, float]:
    """Return the weights of values at 0, 1, 2 and 3 in the cubic through them."""
    a, b, c, d = x, x - 1.0, x - 2.0, x - 3.0
    return -b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0


@kernel
def _stand(foot: Point, near: Point, room: Floats, r: int, c: int) -> None:
    """Place the post that stands on a place of the ellipsoid."""
    z = foot[2] * ELLIPSE
    scale = room[r, c, 3] / math.sqrt(foot[0] * foot[0] + foot[1] * foot[1] + z * z)
    room[r, c, 0] = foot[0] + scale * foot[0] - near[0]
    room[r, c, 1] = foot[1] + scale * foot[1] - near[1]
    room[r, c, 2] = foot[2] + scale * z - near[2]
