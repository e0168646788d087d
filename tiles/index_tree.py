# SPDX-License-Identifier: Apache-2.0
"""What is needed to decide about a cell without reading its tile, as arrays.

An index block is one INDEX array: the cells of one subtree, at most `BLOCK_LEVELS`
levels deep, sorted by cell id.
"""

import numpy as np
from numpy.typing import NDArray

BLOCK_LEVELS = 8
INDEX = np.dtype(
    [
        ("cell", "<i8"),
        ("centre", "<f8", 3),  # bounding sphere of what the subtree draws, ECEF m
        ("radius_m", "<f4"),
        ("min_height_m", "<f4"),
        ("max_height_m", "<f4"),
        ("error_m", "<f4"),  # terrain: mesh; objects: worst of the cell's proxies
        ("texel_m", "<f4"),  # terrain: 0 where finer texture shows no more
        ("own_dimension_m", "<f4"),  # largest of the cell's own objects; see RUNG_FIELDS
        ("subtree_dimension_m", "<f4"),  # largest object at or below the cell; likewise
        ("proxy_dimension_m", "<f4"),  # largest proxy at or below the cell; likewise
        ("row", "<i4"),  # tile row in the store; 0: the cell has no tile of its own
        ("tile_bytes", "<u4"),  # stored
        ("memory_bytes", "<u4"),  # decoded
        ("check", "<u4"),  # checksum of lane, cell and body
        ("children", "u1"),  # bit k: child k is in the index
        ("proxies", "u1"),  # bit k: the tile has a proxy for child k
        ("unused", "u1", 2),
    ]
)
RUNG_FIELDS = "own_dimension_m", "subtree_dimension_m", "proxy_dimension_m"
"""Of a terrain cell these hold the errors of its tile's rungs, finer first, or 0."""


def rung_errors_m(records: NDArray[np.void]) -> NDArray[np.float32]:
    """Return the errors of terrain tiles' rungs, (n, 3), infinite where there is none."""
    stated = np.stack([records[name] for name in RUNG_FIELDS], axis=-1)
    return np.where(stated > 0, stated, np.float32(np.inf))


def drawn_errors_m(
    records: NDArray[np.void], rung: NDArray[np.uint8]
) -> NDArray[np.float32]:
    """Return the errors of the meshes that are drawn of terrain tiles, (n,).

    Parameters
    ----------
    rung : (n,) 0 for the whole mesh
    """
    every = np.column_stack([records["error_m"], rung_errors_m(records)])
    return np.asarray(every[np.arange(len(records)), rung])


def is_monotone(records: NDArray[np.void], parent: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Say for each record whether its error is at most its parent's.

    Parameters
    ----------
    records : (n,) INDEX
    parent : (n,) int32 positions in `records`, -1 for roots
    """
    above = np.where(parent >= 0, records["error_m"][parent], np.inf)
    return np.asarray(records["error_m"] <= above)
