# SPDX-License-Identifier: Apache-2.0
"""Links: which cells touch, across zones, the antimeridian and the poles.

All neighbours are of the cell's own level. East and west the columns of the globe
wrap, so zones and the antimeridian need no care. The rule at a pole: going north from
the northernmost row (or south from the southernmost) one arrives, over the pole, in
the cell of the opposite meridian: the same polar row, the column plus half of all
columns. The corner neighbours over a pole are the two side neighbours of that opposite
cell; the one reached by stepping west first lies west of it by column number. (All
cells of a polar row meet in the pole's point; only these three count as neighbours.)
With this rule every relation is symmetric, and a cell has eight different neighbours
at every level.

The linked cells of a point (VGIS, IEEE Visualization 1999, section 3) are its cell and
the three neighbours nearest to the quadrant of the cell that holds the point. An object
lives in the cell of its centre and is no wider than that cell's ``cell_width_m``, so
every object of a level that reaches the point lives in one of the four.
"""

import numpy as np

from tiles import cells, zones
from tiles.frames import Ints
from tiles.zones import FloatLike, IntLike

# Steps (north, east) in the order S, E, N, W.
_NORTH = np.array((-1, 0, 1, 0), np.int64)
_EAST = np.array((0, 1, 0, -1), np.int64)


def edge_neighbours(cell: IntLike) -> Ints:
    """Return the four cells across the edges, shape (..., 4), order S, E, N, W."""
    return _stepped(cell, _NORTH, _EAST)


def linked_cells(lon_rad: FloatLike, lat_rad: FloatLike, level: IntLike) -> Ints:
    """Return the cell that holds a point and the three nearest to its quadrant.

    Parameters
    ----------
    lon_rad, lat_rad
        The point, radians; longitude wraps, latitude is clamped to the poles.
    level
        Level of the cells, 0 to 28.

    Returns
    -------
    (..., 4) int64: the point's cell, its neighbour east or west, its neighbour north or
    south, and the one across that corner.
    """
    cell = cells.cell_at(lon_rad, lat_rad, level)
    # The quadrant is the last bit of the row and column one level deeper: 0 or 1.
    row, col = zones.grid_at(lon_rad, lat_rad, np.asarray(level, np.int64) + 1)
    north = (row & 1)[..., np.newaxis] * 2 - 1
    east = (col & 1)[..., np.newaxis] * 2 - 1
    mask = np.array((0, 1), np.int64)
    return _stepped(cell, north * mask[[0, 0, 1, 1]], east * mask[[0, 1, 0, 1]])


def _stepped(cell: IntLike, north: Ints, east: Ints) -> Ints:
    """Return cells at most one step away, the steps along a new last axis."""
    cell = np.asarray(cell, np.int64)[..., np.newaxis]
    level = cells.level(cell)
    row, col = cells.global_row_col(cell)
    row, col = row + north, col + east
    last = (zones.ROWS << level) - 1
    over = (row < 0) | (row > last)
    col = np.where(over, col + (zones.COLUMNS // 2 << level), col)
    return cells.from_global(level, np.clip(row, 0, last), col)
