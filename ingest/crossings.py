# SPDX-License-Identifier: Apache-2.0
"""Where a mesh's edges run among columns and rows of posts."""

from tiles.frames import Floats
from tiles.kernels import inlined


@inlined
def crossed(family: int, parts: Floats, i: int) -> tuple[float, float]:
    """Return what an edge's ends are in columns, rows or diagonals; or 0 and 1."""
    start, end = 0.0, 1.0
    if family == 0:
        start, end = parts[i, 2], parts[i, 4]
    elif family == 1:
        start, end = parts[i, 3], parts[i, 5]
    elif family == 2:
        start, end = parts[i, 2] - parts[i, 3], parts[i, 4] - parts[i, 5]
    return start, end


@inlined
def inside(u0: float, v0: float, u1: float, v1: float) -> tuple[float, float]:
    """Return the part of an edge inside the leaf, fractions from start to end."""
    low, high = 0.0, 1.0
    if min(u0, v0, u1, v1) < 0.0 or max(u0, v0, u1, v1) > 1.0:
        for start, step in ((u0, u1 - u0), (v0, v1 - v0)):
            if step == 0.0:
                if start < 0.0 or start > 1.0:
                    high = -1.0
                continue
            one, other = -start / step, (1.0 - start) / step
            low, high = max(low, min(one, other)), min(high, max(one, other))
    return low, high
