# SPDX-License-Identifier: Apache-2.0
"""Blocks of a terrain mesh: neighbouring triangles with a box, so that a part is drawn.

A cell has SIDE x SIDE squares; a triangle belongs to that of its centroid. A mesh's
triangles are sorted along a Morton curve, so each block is a range of its indices, and
what a view sees of a mesh is a few ranges. Its skirt has four more: the cell's sides.
"""

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Ecef, Floats, Ints
from tiles.kernels import inlined, kernel
from tiles.mesh import UV_ONE, VERTEX

SIDE = 8
BLOCKS = SIDE * SIDE
SIDES = 4
"""of a skirt: south, east, north, west"""
MOST_PIECES = BLOCKS + SIDES
BITS = 10
"""of a centroid's place, east and north, by which triangles are sorted"""
FEWEST = 64
"""The surface of a mesh of fewer triangles is drawn whole."""
BOX_STEPS = 512
"""Positions count in steps, boxes in so many of them: the farthest corner has 111."""
BLOCK = np.dtype(
    [
        ("low", "i1", 3),  # east, north and up from the mesh's centre, in BOX_STEPS steps
        ("high", "i1", 3),
        ("count", "<u2"),  # triangles
    ]
)


@kernel
def morton(at: Ints) -> Ints:
    """Return Morton codes of (n, 2) numbers of ten bits."""
    code = np.zeros(len(at), np.int64)
    for i in range(len(at)):
        for axis in range(2):
            # Zeros come between the bits, half as many bits together each time.
            spread = at[i, axis]
            spread = (spread | spread << 8) & 0x00FF00FF
            spread = (spread | spread << 4) & 0x0F0F0F0F
            spread = (spread | spread << 2) & 0x33333333
            spread = (spread | spread << 1) & 0x55555555
            code[i] |= spread << axis
    return code


def axes_of(centre: Ecef) -> Floats:
    """Return the directions that boxes are along: east, north, up; (3, 3)."""
    up = centre / np.linalg.norm(centre)
    east = np.array([-up[1], up[0], 0.0]) / np.hypot(up[0], up[1])
    return np.stack([east, np.cross(up, east), up])


def spots_of(vertices: NDArray[np.void], centre: Ecef) -> Floats:
    """Return where a mesh's vertices, VERTEX, are from its centre, (v, 3) BOX_STEPS."""
    assert vertices.dtype == VERTEX
    return np.asarray(vertices["position"] @ axes_of(centre).T / BOX_STEPS)


def in_sides(
    walls: NDArray[np.uint16], vertices: NDArray[np.void], spots: Floats
) -> tuple[NDArray[np.uint16], NDArray[np.void]] | None:
    """Sort a skirt's triangles by the cell's sides.

    Parameters
    ----------
    walls : (s, 3)
    vertices, spots : of `in_blocks`

    Returns
    -------
    walls : (s, 3)
    sides : (SIDES,) BLOCK, boxes of a skirt without depth; or None where a triangle is on
        no side
    """
    ordered, count, low, high = _sides(walls, vertices["detail"], spots)
    if count.sum() < len(walls):
        return None
    return ordered, _boxed(count, low, high)


@kernel
def _sides(
    walls: NDArray[np.uint16], uv: NDArray[np.uint16], spots: Floats
) -> tuple[NDArray[np.uint16], Ints, Floats, Floats]:
    """Take the triangles of each side in turn; see `_sorted`."""
    ordered, n = np.empty_like(walls), 0
    count = np.zeros(SIDES, np.int64)
    low, high = np.full((SIDES, 3), np.inf), np.full((SIDES, 3), -np.inf)
    for side in range(SIDES):
        axis, edge = (side + 1) % 2, UV_ONE if side in (1, 2) else 0
        for t in range(len(walls)):
            corners = walls[t]
            if uv[corners[0], axis] != edge or uv[corners[1], axis] != edge:
                continue
            if uv[corners[2], axis] != edge:
                continue
            ordered[n] = corners
            n += 1
            count[side] += 1
            _widen(low[side], high[side], spots, corners)
    return ordered, count, low, high


@inlined
def _widen(low: Floats, high: Floats, spots: Floats, corners: NDArray[np.uint16]) -> None:
    """Make a box hold a triangle."""
    for k in range(3):
        for axis in range(3):
            spot = spots[corners[k], axis]
            low[axis] = min(low[axis], spot)
            high[axis] = max(high[axis], spot)


def _boxed(count: Ints, low: Floats, high: Floats) -> NDArray[np.void]:
    """Return counts and boxes as BLOCK."""
    blocks = np.zeros(len(count), BLOCK)
    low[count == 0] = high[count == 0] = 0.0
    blocks["count"], blocks["low"], blocks["high"] = count, np.floor(low), np.ceil(high)
    return blocks


def in_blocks(
    triangles: NDArray[np.uint16], vertices: NDArray[np.void], spots: Floats
) -> tuple[NDArray[np.uint16], NDArray[np.void]]:
    """Sort a surface's triangles into blocks.

    Parameters
    ----------
    triangles : (t, 3)
    vertices : (v,) VERTEX
    spots : (v, 3) of `spots_of`

    Returns
    -------
    triangles : (t, 3)
    blocks : (BLOCKS,) BLOCK
    """
    ordered, count, low, high = _sorted(triangles, vertices["detail"], spots)
    return ordered, _boxed(count, low, high)


@kernel
def _sorted(
    triangles: NDArray[np.uint16], uv: NDArray[np.uint16], spots: Floats
) -> tuple[NDArray[np.uint16], Ints, Floats, Floats]:
    """Put triangles in order; count each block's, and find their least and largest spots.

    Parameters
    ----------
    uv, spots : (v, 2) and (v, 3) of the vertices
    """
    place = np.zeros((len(triangles), 2), np.int64)
    for t in range(len(triangles)):
        for k in range(3):
            for axis in range(2):
                place[t, axis] += uv[triangles[t, k], axis]
    code = morton(np.minimum((place << BITS) // (3 * UV_ONE), (1 << BITS) - 1))
    count = np.zeros(BLOCKS, np.int64)
    low, high = np.full((BLOCKS, 3), np.inf), np.full((BLOCKS, 3), -np.inf)
    for t in range(len(triangles)):
        block = code[t] * BLOCKS >> 2 * BITS
        count[block] += 1
        _widen(low[block], high[block], spots, triangles[t])
    ordered, order = np.empty_like(triangles), _order(code)
    for t in range(len(triangles)):
        for k in range(3):
            ordered[t, k] = triangles[order[t], k]
    return ordered, count, low, high


@kernel
def _order(code: Ints) -> Ints:
    """Return the order of codes of 2 x BITS bits, as a stable sort finds it."""
    order = np.arange(len(code))
    for shift in (0, BITS):
        start = np.zeros((1 << BITS) + 1, np.int64)
        for i in range(len(code)):
            start[(code[i] >> shift & (1 << BITS) - 1) + 1] += 1
        start = np.cumsum(start)
        before, order = order, np.empty_like(order)
        for one in before:
            digit = code[one] >> shift & (1 << BITS) - 1
            order[start[digit]] = one
            start[digit] += 1
    return order
