# SPDX-License-Identifier: Apache-2.0
"""Blocks of a terrain mesh: neighbouring triangles with a box, so that a part is drawn.

A cell has SIDE x SIDE squares; a triangle belongs to that of its centroid. A mesh's
triangles are sorted along a Morton curve, so each block is a range of its indices, and
what a view sees of a mesh is a few ranges.
"""

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Ecef, Floats, Ints
from tiles.mesh import UV_ONE, VERTEX

SIDE = 8
BLOCKS = SIDE * SIDE
BITS = 10
"""of a centroid's place, east and north, by which triangles are sorted"""
FEWEST = 64
"""A mesh of fewer triangles is drawn whole."""
BOX_STEPS = 512
"""Positions count in steps, boxes in so many of them: the farthest corner has 111."""
BLOCK = np.dtype(
    [
        ("low", "i1", 3),  # east, north and up from the mesh's centre, in BOX_STEPS steps
        ("high", "i1", 3),
        ("count", "<u2"),  # triangles
    ]
)


def morton(at: Ints) -> Ints:
    """Return Morton codes of (n, 2) numbers of ten bits."""
    code = np.zeros(len(at), np.int64)
    for bit in range(BITS):
        for axis in range(2):
            code |= (at[:, axis] >> bit & 1) << (2 * bit + axis)
    return code


def axes_of(centre: Ecef) -> Floats:
    """Return the directions that boxes are along: east, north, up; (3, 3)."""
    up = centre / np.linalg.norm(centre)
    east = np.array([-up[1], up[0], 0.0]) / np.hypot(up[0], up[1])
    return np.stack([east, np.cross(up, east), up])


def in_blocks(
    triangles: NDArray[np.uint16], vertices: NDArray[np.void], centre: Ecef
) -> tuple[NDArray[np.uint16], NDArray[np.void]]:
    """Sort a surface's triangles into blocks.

    Parameters
    ----------
    triangles : (t, 3)
    vertices : (v,) VERTEX
    centre : of the mesh

    Returns
    -------
    triangles : (t, 3)
    blocks : (BLOCKS,) BLOCK
    """
    assert vertices.dtype == VERTEX
    middle = vertices["detail"].astype(np.int64)[triangles].sum(axis=1)
    place = np.minimum((middle << BITS) // (3 * UV_ONE), (1 << BITS) - 1)
    code = morton(place)
    order = np.argsort(code, kind="stable")
    triangles = triangles[order]
    block = code[order] // ((1 << 2 * BITS) // BLOCKS)
    blocks = np.zeros(BLOCKS, BLOCK)
    blocks["count"] = np.bincount(block, minlength=BLOCKS)
    first = np.flatnonzero(np.diff(block, prepend=-1))
    spots = vertices["position"] @ axes_of(centre).T / BOX_STEPS
    corners = spots[triangles]
    low = np.minimum.reduceat(corners.min(axis=1), first)
    high = np.maximum.reduceat(corners.max(axis=1), first)
    blocks["low"][block[first]] = np.floor(low)
    blocks["high"][block[first]] = np.ceil(high)
    return triangles, blocks
