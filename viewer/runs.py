# SPDX-License-Identifier: Apache-2.0
"""Which ranges of a terrain mesh's indices a view needs: runs of pieces in the picture.

Pieces that follow each other are one run, and so are those with few triangles between
them: a command costs about as much. Of a skirt the sides that face the eye are drawn
(viewer/facing.py).
"""

import numpy as np
from numpy.typing import NDArray

from tiles.blocks import BLOCKS, BOX_STEPS, MOST_PIECES
from tiles.frames import Floats
from tiles.kernels import brief, inlined

MOST_RUNS = MOST_PIECES // 2
GAP = 16
"""Triangles between two runs that are drawn rather than left out"""
ROUNDED_STEPS = 1.0
"""Boxes count as so much larger, for vertices that a GPU rounds."""


@inlined
def whole_run(slot: np.void, part: int, runs: NDArray[np.int64]) -> int:
    """Write a mesh and its skirt as one run; returns 1."""
    runs[0, 0], runs[0, 1] = 0, slot["part_count"][part]
    return 1


@brief
def seen_runs(
    slot: np.void,
    pieces: NDArray[np.void],
    part: int,
    sphere: tuple[Floats, float],
    view: tuple[Floats, Floats],
    skirt: tuple[int, float],
    runs: NDArray[np.int64],
) -> int:
    """Write what of a mesh and its skirt may be in the picture.

    Parameters
    ----------
    pieces : (MOST_PIECES,) BLOCK of the mesh
    sphere : centre (3,) and radius that the tile lies in, ECEF m
    view : the eye (3,) ECEF m and inward unit normals (n, 3) of the planes through it
    skirt : bits of the sides that are wanted, and how far the skirt reaches from the rim, m
    runs : (MOST_RUNS, 2) first index and number of indices, both from the mesh's start

    Returns
    -------
    How many runs
    """
    if slot["in_pieces"] == 0:
        return whole_run(slot, part, runs)
    sides = np.empty((len(view[1]), 4))
    crossed = _crossed(slot, (sphere[0], sphere[1] + skirt[1]), view, sides)
    n, start, last, end = 0, 0, -3 * GAP - 3, 0
    for k in range(MOST_PIECES):
        first, end = end, end + 3 * pieces[k]["count"]
        if end == first or (k >= BLOCKS and not skirt[0] >> (k - BLOCKS) & 1):
            continue
        if not _is_in(pieces[k], sides, crossed, skirt[1] if k >= BLOCKS else 0.0):
            continue
        if first - last > 3 * GAP:
            n += 1
            start = first
        last = end
        runs[n - 1, 0], runs[n - 1, 1] = start, end - start
    return n


@brief
def _crossed(
    slot: np.void,
    sphere: tuple[Floats, float],
    view: tuple[Floats, Floats],
    sides: Floats,
) -> int:
    """Write the planes that cross a tile's sphere, for its boxes; returns how many.

    Parameters
    ----------
    sides : (n, 4) what a unit of a box along east, north and up is above the plane, and
        how far above it the mesh's centre is, m
    """
    eye, planes = view
    centre, size_m = slot["centre"], slot["scale_m"] * BOX_STEPS
    x, y, z = centre[0], centre[1], centre[2]
    flat = max(np.sqrt(x * x + y * y), 1e-9)
    long = max(np.sqrt(flat * flat + z * z), 1e-9)
    n = 0
    for i in range(len(planes)):
        a, b, c = planes[i, 0], planes[i, 1], planes[i, 2]
        off_m = a * (sphere[0][0] - eye[0]) + b * (sphere[0][1] - eye[1])
        off_m += c * (sphere[0][2] - eye[2])
        if off_m >= sphere[1]:
            continue
        outwards = (a * x + b * y) / flat
        sides[n, 0] = size_m * (b * x - a * y) / flat
        sides[n, 1] = size_m * (c * flat - outwards * z) / long
        sides[n, 2] = size_m * (outwards * flat + c * z) / long
        sides[n, 3] = a * (x - eye[0]) + b * (y - eye[1]) + c * (z - eye[2])
        sides[n, 3] += ROUNDED_STEPS * slot["scale_m"]
        n += 1
    return n


@brief
def _is_in(piece: np.void, sides: Floats, crossed: int, reach_m: float) -> bool:
    """Say whether not all that is so near to a piece's box is behind one of the planes."""
    for i in range(crossed):
        above_m = sides[i, 3] + reach_m
        for axis in range(3):
            per = sides[i, axis]
            above_m += per * (piece["high"][axis] if per > 0.0 else piece["low"][axis])
        if above_m < 0.0:
            return False
    return True
