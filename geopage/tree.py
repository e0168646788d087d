# SPDX-License-Identifier: Apache-2.0
"""A lane's forest as the contiguous arrays that the selection's kernels walk."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles import bounds, cells
from tiles.forest import Forest, Rows
from tiles.frames import Ecef
from tiles.index_tree import rung_errors_m
from tiles.kernels import kernel
from tiles.lanes import Lane
from tiles.terrain import MOST_RUNGS

F4 = NDArray[np.float32]
F8 = NDArray[np.float64]
U1 = NDArray[np.uint8]


class Tree(NamedTuple):
    """Arrays over the rows of one forest; a tuple, because kernels take tuples."""

    roots: Rows
    """(r,) rows without a parent, ascending"""
    level: NDArray[np.int16]
    parent: Rows
    children: Rows
    """(n, 4) SW, SE, NW, NE, -1 where there is none"""
    links: Rows
    """(n, 4) deepest row that covers the neighbour to the S, E, N, W"""
    centre: F8
    """(n, 3) bounding sphere's centre, ECEF m"""
    radius_m: F8
    box_m: F4
    """(n, 5) half the sides of the box around a cell of terrain: east, north, up; and its
    least and greatest height above the ellipsoid; the sphere's radius for objects, which
    may reach out of their cell"""
    box_rad: F8
    """(n, 4) west, south, east, north of a cell of terrain; 0 for objects"""
    error_m: F4
    """what the threshold is held against: terrain mesh or texel, worst proxy of objects"""
    mesh_error_m: F4
    """error of the drawn surface alone, for skirts"""
    rung_m: F4
    """(n, 3) errors of the rungs of terrain tiles, finer first, infinite where none is"""
    own_m: F4
    subtree_m: F4
    proxy_m: F4
    """bounding dimensions: own objects, objects at or below, proxies at or below"""
    tile_bytes: NDArray[np.int64]
    """stored size"""
    memory_bytes: NDArray[np.int64]
    """what the tile takes when it is decoded or uploaded"""
    has_tile: U1
    proxies: U1
    """bit k: the tile has a proxy for child k"""


def tree_of(forest: Forest, lane: Lane) -> Tree:
    """Copy what kernels need out of a forest's index records."""
    records = forest.records
    has_tile = (records["row"] > 0).astype(np.uint8)
    error_m = records["error_m"].astype(np.float32)
    texel_m = records["texel_m"] if lane is Lane.TERRAIN else np.float32(0)
    selected_m = np.maximum(error_m, texel_m)
    is_town = np.float32(lane is Lane.OBJECTS)
    none_m = np.full((len(records), MOST_RUNGS), np.inf, np.float32)
    return Tree(
        np.flatnonzero(forest.parent < 0).astype(np.int32),
        np.asarray(cells.level(records["cell"])).astype(np.int16),
        np.ascontiguousarray(forest.parent),
        np.ascontiguousarray(forest.children),
        np.ascontiguousarray(forest.links),
        np.ascontiguousarray(forest.centre),
        np.ascontiguousarray(forest.radius_m),
        boxes_m(forest, lane),
        np.stack(cells.bounds_rad(records["cell"]), axis=-1) * (1 - is_town),
        selected_m.astype(np.float32),
        error_m,
        none_m if is_town else rung_errors_m(records),
        records["own_dimension_m"] * is_town,
        records["subtree_dimension_m"] * is_town,
        records["proxy_dimension_m"] * is_town,
        records["tile_bytes"].astype(np.int64),
        records["memory_bytes"].astype(np.int64),
        has_tile,
        records["proxies"] * has_tile,
    )


def boxes_m(forest: Forest, lane: Lane) -> F4:
    """Return `Tree.box_m` of a forest."""
    if lane is Lane.OBJECTS:
        return np.repeat(forest.radius_m[:, None], 5, axis=1).astype(np.float32)
    own = forest.records
    heights = own["min_height_m"], own["max_height_m"]
    half_m = bounds.half_sides_of(own["cell"], *heights, Ecef(forest.centre))
    half_m = np.nextafter(half_m.astype(np.float32), np.float32(np.inf))
    return np.column_stack((half_m, *heights))


@kernel
def are_among(n: int, rows: Rows, others: Rows) -> NDArray[np.bool_]:
    """Say which of some rows below `n` are among others.

    A store may hold a hundred times more rows than a view visits: only what is read is
    written before.
    """
    among = np.empty(n, np.bool_)
    among[rows] = False
    among[others] = True
    return among[rows]


def tree_bytes(tree: Tree, forest: Forest) -> int:
    """Return the bytes that a tree adds to those of its forest."""
    held = (forest.parent, forest.children, forest.links, forest.centre, forest.radius_m)
    return sum(a.nbytes for a in tree if not any(a is array for array in held))
