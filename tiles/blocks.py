# SPDX-License-Identifier: Apache-2.0
"""Blocks of a terrain mesh: neighbouring triangles with a box, so that a part is drawn.

A cell has BLOCKS blocks, 8 x 8 where it is about as wide as high, and fewer columns of
more rows towards the poles; a triangle belongs to that of its centroid. A mesh's triangles
are sorted along a Morton curve, so each block is a range of its indices, and what a view
sees of a mesh is a few ranges. Its skirt has more: the parts of the cell's sides.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.frames import Ecef, Floats, Ints
from tiles.kernels import inlined, kernel
from tiles.mesh import UV_ONE, VERTEX

BLOCK_BITS = 3
BLOCKS = 1 << 2 * BLOCK_BITS
SIDES = 4
"""of a skirt: south, east, north, west"""
SIDE_PARTS = 8
"""of a side, each as long"""
SKIRT_PIECES = SIDES * SIDE_PARTS
MOST_PIECES = BLOCKS + SKIRT_PIECES
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
    """Sort a skirt's triangles by the parts of the cell's sides.

    Parameters
    ----------
    walls : (s, 3)
    vertices, spots : of `in_blocks`

    Returns
    -------
    walls : (s, 3)
    sides : (SKIRT_PIECES,) BLOCK, boxes of a skirt without depth; or None where a triangle
        is on no side
    """
    part = _side_parts(walls, vertices["detail"])
    if (part < 0).any():
        return None
    order = np.argsort(part, kind="stable")
    return walls[order], _boxed(*_held(part, walls, spots, SKIRT_PIECES))


@kernel
def _side_parts(walls: NDArray[np.uint16], uv: NDArray[np.uint16]) -> Ints:
    """Return the number of the part that each triangle is in, -1 where it is on no side."""
    part = np.full(len(walls), -1)
    for t in range(len(walls)):
        for side in range(SIDES):
            axis, edge = (side + 1) % 2, UV_ONE if side in (1, 2) else 0
            there, along = True, 0
            for k in range(3):
                there = there and uv[walls[t, k], axis] == edge
                along += uv[walls[t, k], 1 - axis]
            if there:
                nth = min(along * SIDE_PARTS // (3 * UV_ONE), SIDE_PARTS - 1)
                part[t] = side * SIDE_PARTS + nth
                break
    return part


@kernel
def _held(
    piece: Ints, triangles: NDArray[np.uint16], spots: Floats, pieces: int
) -> tuple[Ints, Floats, Floats]:
    """Count the triangles of pieces, and find their least and largest spots."""
    count = np.zeros(pieces, np.int64)
    low, high = np.full((pieces, 3), np.inf), np.full((pieces, 3), -np.inf)
    for t in range(len(triangles)):
        count[piece[t]] += 1
        _widen(low[piece[t]], high[piece[t]], spots, triangles[t])
    return count, low, high


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


def slimness(cell: int) -> int:
    """Return how often a cell's columns of blocks are halved, and its rows doubled.

    That makes blocks of a cell that is narrow for its height about square.
    """
    _, south, _, north = (float(side) for side in cells.bounds_rad(cell))
    return min(round(-math.log2(math.cos((south + north) / 2)) / 2), BLOCK_BITS)


def in_blocks(
    triangles: NDArray[np.uint16], vertices: NDArray[np.void], spots: Floats, slim: int
) -> tuple[NDArray[np.uint16], NDArray[np.void]]:
    """Sort a surface's triangles into blocks.

    Parameters
    ----------
    triangles : (t, 3)
    vertices : (v,) VERTEX
    spots : (v, 3) of `spots_of`
    slim : of `slimness`

    Returns
    -------
    triangles : (t, 3)
    blocks : (BLOCKS,) BLOCK
    """
    code = _codes(triangles, vertices["detail"], slim)
    held = _held(code * BLOCKS >> 2 * BITS, triangles, spots, BLOCKS)
    return triangles[_order(code)], _boxed(*held)


@kernel
def _codes(triangles: NDArray[np.uint16], uv: NDArray[np.uint16], slim: int) -> Ints:
    """Return codes of triangles' centroids: rows of 2 x `slim` bits, in each Morton's."""
    place = np.zeros((len(triangles), 2), np.int64)
    for t in range(len(triangles)):
        for k in range(3):
            for axis in range(2):
                place[t, axis] += uv[triangles[t, k], axis]
    place = np.minimum((place << BITS) // (3 * UV_ONE), (1 << BITS) - 1)
    row = place[:, 1] >> BITS - 2 * slim
    place[:, 1] = (place[:, 1] << 2 * slim) & (1 << BITS) - 1
    codes: Ints = row << 2 * BITS - 2 * slim | morton(place) >> 2 * slim
    return codes


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
