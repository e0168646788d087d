# SPDX-License-Identifier: Apache-2.0
"""Where each uploaded tile lies on the GPU, as arrays that kernels read.

A lane has one SLOT for each row of its forest. The own objects of object tiles have
their dimensions and index ends in one pool, because a view cuts each tile's objects,
which are sorted largest first, where they get smaller than the threshold.
"""

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.blocks import BLOCK, BLOCKS, MOST_PIECES
from tiles.objects import ObjectTile
from tiles.terrain import MOST_RUNGS, TerrainTile
from viewer.allocator import FirstFit

SLOT = np.dtype(
    [
        ("centre", "<f8", 3),
        ("scale_m", "<f4"),
        ("box_rad", "<f8", 4),  # terrain: west, south, east, north
        ("uploaded", "<i4"),
        ("base_vertex", "<i4"),
        ("vertex_count", "<i4"),
        ("first_index", "<i4"),
        ("index_count", "<i4"),
        ("layer", "<i4"),
        ("pool_start", "<i4"),
        ("pool_count", "<i4"),
        ("seed", "<i4"),
        ("noise", "<f4", 3),  # terrain: base u, base v, patches across the cell
        ("proxy_first", "<i4", 4),  # by child
        ("proxy_count", "<i4", 4),
        ("wet", "<i4"),  # terrain: its texture shows water
        ("surface_count", "<i4"),  # terrain: indices without the skirt
        ("in_pieces", "<i4"),  # terrain: its layer has pieces in `Arena.pieces`
        ("part_first", "<i4", 1 + MOST_RUNGS),  # terrain: whole mesh, rungs
        ("part_count", "<i4", 1 + MOST_RUNGS),
        ("part_error_m", "<f4", 1 + MOST_RUNGS),
    ],
    align=True,
)
ANYWHERE = np.array(((-128,) * 3, (127,) * 3, 0), BLOCK)
"""A block of a surface that has no blocks"""
POOL = np.dtype([("dimension_m", "<f4"), ("index_end", "<i4")])
PATCH_LEVEL = 16
"""Ground grain counts in patches as large as a cell of this level (76 m of latitude)."""
PATCH_M = 76.4
NEAR_PERIOD, FAR_PERIOD = 1024, 65536
"""Patches after which the grain repeats; the nearer it is, the finer are its places."""


def noise_of(cell: int) -> tuple[float, float, float]:
    """Return where a cell lies in the grain of the ground, which has no seams.

    Returns
    -------
    base_u, base_v : patches from the start of the period to the south-west corner
    patches : patches across the cell
    """
    row, col = (int(x) for x in cells.global_row_col(cell))
    patches = 2.0 ** (PATCH_LEVEL - int(cells.level(cell)))
    return col * patches % FAR_PERIOD, row * patches % FAR_PERIOD, patches


def make_pieces(layers: int) -> NDArray[np.void]:
    """Return the pieces of each mesh of the tiles in so many texture layers, none yet."""
    return np.zeros((layers, 1 + MOST_RUNGS, MOST_PIECES), BLOCK)


def put_parts(slot: np.void, pieces: NDArray[np.void], tile: TerrainTile) -> None:
    """Note a tile's meshes; what it lacks is drawn as its coarsest.

    Parameters
    ----------
    pieces : (1 + MOST_RUNGS, MOST_PIECES) of the tile's layer
    """
    parts = tile.parts()
    slot["in_pieces"] = len(tile.pieces) > 0
    which = np.minimum(np.arange(1 + MOST_RUNGS), len(parts) - 1)
    slot["part_first"] = parts["first_index"][which]
    slot["part_count"] = parts["index_count"][which]
    slot["part_error_m"] = parts["error_m"][which]
    if len(tile.pieces):
        pieces[:, :BLOCKS] = ANYWHERE
        pieces[:, 0]["count"] = parts["surface_index_count"][which] // 3
        pieces[:, -tile.pieces.shape[1] :] = tile.pieces[which]


class ObjectPool:
    """Dimensions, index ends and ids of all uploaded own objects, in ranges per tile."""

    def __init__(self, objects: int) -> None:
        self.records = np.zeros(objects, POOL)
        self.numbers = np.zeros(objects, np.int64)
        """ids of the objects in the store"""
        self._free = FirstFit(objects)

    def put(self, slot: np.void, tile: ObjectTile) -> bool:
        """Copy a tile's object and proxy tables; says whether there was room."""
        count = len(tile.objects)
        start = self._free.take(count) if count else 0
        if start is None:
            return False
        part = self.records[start : start + count]
        part["dimension_m"] = tile.objects["dimension_m"]
        part["index_end"] = tile.objects["index_end"]
        self.numbers[start : start + count] = tile.objects["id"]
        slot["pool_start"], slot["pool_count"] = start, count
        slot["proxy_count"] = 0
        for proxy in tile.proxies:
            first, end = int(proxy["index_start"]), int(proxy["index_end"])
            slot["proxy_first"][proxy["child"]] = first
            slot["proxy_count"][proxy["child"]] = end - first
        return True

    def give_back(self, slot: np.void) -> None:
        """Free the range of a tile."""
        self._free.give_back(int(slot["pool_start"]), int(slot["pool_count"]))


def make_slots(count: int) -> NDArray[np.void]:
    """Return the empty slots of a lane with `count` forest rows."""
    return np.zeros(max(count, 1), SLOT)
