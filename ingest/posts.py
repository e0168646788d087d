# SPDX-License-Identifier: Apache-2.0
"""Posts joined by triangles, in columns and rows: each square is cut from its first post.

`grid`, (2, 6), says where a place of a cell is: column and row as polynomials of the
fractions u and v, 1, u, v, uu, uv, vv.
"""

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import inlined, kernel


@inlined
def column_row(grid: Floats, u: float, v: float) -> tuple[float, float]:
    """Return column and row of a place of the cell."""
    x = grid[0, 0] + grid[0, 1] * u + grid[0, 2] * v
    y = grid[1, 0] + grid[1, 1] * u + grid[1, 2] * v
    x += grid[0, 3] * u * u + grid[0, 4] * u * v + grid[0, 5] * v * v
    y += grid[1, 3] * u * u + grid[1, 4] * u * v + grid[1, 5] * v * v
    return x, y


@inlined
def point_at(points: NDArray[np.float32], x: float, y: float) -> tuple[float, float, float]:
    """Return the point of the triangles at a column and row; outside, of the nearest."""
    c = min(max(int(np.floor(x)), 0), points.shape[1] - 2)
    r = min(max(int(np.floor(y)), 0), points.shape[0] - 2)
    fx, fy = x - c, y - r
    w00, w11 = 1.0 - max(fx, fy), min(fx, fy)
    w01, w10 = max(fx - fy, 0.0), max(fy - fx, 0.0)
    return (
        w00 * points[r, c, 0]
        + w01 * points[r, c + 1, 0]
        + w10 * points[r + 1, c, 0]
        + w11 * points[r + 1, c + 1, 0],
        w00 * points[r, c, 1]
        + w01 * points[r, c + 1, 1]
        + w10 * points[r + 1, c, 1]
        + w11 * points[r + 1, c + 1, 1],
        w00 * points[r, c, 2]
        + w01 * points[r, c + 1, 2]
        + w10 * points[r + 1, c, 2]
        + w11 * points[r + 1, c + 1, 2],
    )


@kernel
def bent_share(points: NDArray[np.float32], bound_m: float) -> float:
    """Return the share of inner posts further than a bound from between two others."""
    height, width, bent = points.shape[0], points.shape[1], 0
    for r in range(1, height - 1):
        for c in range(1, width - 1):
            east, north = 0.0, 0.0
            for k in range(3):
                here = points[r, c, k]
                east += (here - (points[r, c + 1, k] + points[r, c - 1, k]) / 2.0) ** 2
                north += (here - (points[r + 1, c, k] + points[r - 1, c, k]) / 2.0) ** 2
            bent += int(max(east, north) > bound_m * bound_m)
    return float(bent / max((height - 2) * (width - 2), 1))
