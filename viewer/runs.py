# SPDX-License-Identifier: Apache-2.0
"""Which ranges of a terrain mesh's indices a view needs: runs of pieces that it may show.

A piece is left out where its box is outside of the picture, or where the planet hides it.
Pieces that follow each other are one run, and so are those with few triangles between
them: a command costs about as much. Of a skirt the sides that face the eye are drawn
(viewer/facing.py).
"""

import math

import numpy as np
from numpy.typing import NDArray

from geopage.screen_error import Lens, is_hidden
from tiles.blocks import BLOCKS, BOX_STEPS, MOST_PIECES, SIDE_PARTS
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
    view: tuple[Lens, Floats],
    skirt: tuple[int, float],
    runs: NDArray[np.int64],
) -> int:
    """Write what of a mesh and its skirt a view may show.

    Parameters
    ----------
    pieces : (MOST_PIECES,) BLOCK of the mesh
    sphere : centre (3,) and radius that the tile lies in, ECEF m
    view : its lens, and inward unit normals (n, 3) of the planes through the eye
    skirt : bits of the sides that are wanted, and how far the skirt reaches from the rim, m
    runs : (MOST_RUNS, 2) first index and number of indices, both from the mesh's start

    Returns
    -------
    How many runs
    """
    if slot["in_pieces"] == 0:
        return whole_run(slot, part, runs)
    (lens, planes), radius_m = view, sphere[1] + skirt[1]
    axes, sides = np.empty((4, 3)), np.empty((len(planes), 4))
    _put_axes(slot, lens.eye, axes)
    crossed = _crossed((sphere[0], radius_m), (lens.eye, planes), axes, sides)
    sets = _sets(lens, sphere[0], radius_m)
    n, start, last, end = 0, 0, -3 * GAP - 3, 0
    for k in range(MOST_PIECES):
        first, end = end, end + 3 * pieces[k]["count"]
        of_skirt = k >= BLOCKS
        if end == first or (of_skirt and not skirt[0] >> (k - BLOCKS) // SIDE_PARTS & 1):
            continue
        reach_m = skirt[1] if of_skirt else 0.0
        if not _is_in(pieces[k], sides, crossed, reach_m):
            continue
        if sets and _has_set(pieces[k], axes, lens, reach_m):
            continue
        if first - last > 3 * GAP:
            n += 1
            start = first
        last = end
        runs[n - 1, 0], runs[n - 1, 1] = start, end - start
    return n


@brief
def _put_axes(slot: np.void, eye: Floats, axes: Floats) -> None:
    """Write a unit of a tile's boxes along east, north and up, and its centre from the eye.

    Parameters
    ----------
    axes : (4, 3) m
    """
    centre, size_m = slot["centre"], slot["scale_m"] * BOX_STEPS
    x, y, z = centre[0], centre[1], centre[2]
    flat = max(math.sqrt(x * x + y * y), 1e-9)
    long = max(math.sqrt(flat * flat + z * z), 1e-9)
    east, inwards = size_m / flat, -size_m * z / (long * flat)
    axes[0, 0], axes[0, 1], axes[0, 2] = -y * east, x * east, 0.0
    axes[1, 0], axes[1, 1] = x * inwards, y * inwards
    axes[1, 2] = size_m * flat / long
    for i in range(3):
        axes[2, i] = size_m * centre[i] / long
        axes[3, i] = centre[i] - eye[i]


@brief
def _crossed(
    sphere: tuple[Floats, float],
    view: tuple[Floats, Floats],
    axes: Floats,
    sides: Floats,
) -> int:
    """Write the planes that cross a tile's sphere, for its boxes; returns how many.

    Parameters
    ----------
    view : the eye, and the planes
    axes : of `_put_axes`
    sides : (n, 4) what a unit of a box along east, north and up is above the plane, and
        how far above it the mesh's centre is, m
    """
    eye, planes = view
    rounded_m = ROUNDED_STEPS / BOX_STEPS * math.sqrt((axes[2] ** 2).sum())
    n = 0
    for i in range(len(planes)):
        off_m = 0.0
        for k in range(3):
            off_m += planes[i, k] * (sphere[0][k] - eye[k])
        if off_m >= sphere[1]:
            continue
        for axis in range(4):
            sides[n, axis] = 0.0
            for k in range(3):
                sides[n, axis] += planes[i, k] * axes[axis, k]
        sides[n, 3] += rounded_m
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


@brief
def _sets(lens: Lens, centre: Floats, radius_m: float) -> bool:
    """Say whether the planet may hide a part of a sphere: it is not wholly before it."""
    eye, along = lens.eye, 0.0
    far_m = math.sqrt(eye[0] * eye[0] + eye[1] * eye[1] + eye[2] * eye[2])
    for k in range(3):
        along += eye[k] * centre[k]
    before = (along / far_m - radius_m) * far_m >= lens.occluder_m * lens.occluder_m
    return far_m > lens.occluder_m and not before


@brief
def _has_set(piece: np.void, axes: Floats, lens: Lens, reach_m: float) -> bool:
    """Say whether the planet hides all that is so near to a piece's box.

    What it hides is convex, so a box is hidden if its corners are.
    """
    low, high, rounded = piece["low"], piece["high"], ROUNDED_STEPS / BOX_STEPS
    for corner in range(8):
        x, y, z = axes[3, 0], axes[3, 1], axes[3, 2]
        for axis in range(3):
            far = high[axis] + rounded if corner >> axis & 1 else low[axis] - rounded
            x += far * axes[axis, 0]
            y += far * axes[axis, 1]
            z += far * axes[axis, 2]
        if not is_hidden(lens, x, y, z, reach_m):
            return False
    return True
