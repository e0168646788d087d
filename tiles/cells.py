# SPDX-License-Identifier: Apache-2.0
"""Cells: the places of the forest, as 64-bit integers with arithmetic only.

A cell is a zone, a level L (0 is the whole zone, 28 is about 2 cm) and a row and
column inside its zone (row 0 south, column 0 west, 2**L of each). Its id is a
non-negative int64::

    bit  63 62 | 61 .. 57 | 56 .................... 0
          0  0 |   zone   | Morton bits, a one, zeros

    level  0   | z z z z z | 1 0 0 0 0 ...       0 0
    level  1   | z z z z z | r c 1 0 0 ...       0 0
    level  2   | z z z z z | r c r c 1 0 ...     0 0
    level 28   | z z z z z | r c r c r c ... r c r c 1

Each level adds one bit of the row (r) and one of the column (c), the highest first.
The lowest one bit is a sentinel: it says where the Morton bits end. In a formula:
``id = ((zone << 2*L | morton) << 1 | 1) << 2 * (28 - L)``.

What follows from it:

- Every cell of every level has its own id, and the id alone tells zone, level, row
  and column. 0 and all negative numbers are no cells and are free as "none" marks.
- The level is the position of the lowest one bit, which is always an even bit.
- The parent is found by moving the sentinel up two bits and clearing what is below.
- The four children, in the order SW, SE, NW, NE (child k adds row bit k >> 1 and
  column bit k & 1), have ascending ids, two before and two after their parent's.
- The ids of a cell and all its descendants fill the range from ``range_min`` to
  ``range_max`` and no other cell lies in it, so "contains" is two comparisons and a
  sorted array of ids keeps every subtree together (children 0 and 1, the cell itself,
  then children 2 and 3).
- Cells of one level, sorted, are in Morton (Z) order inside each zone.

Every function takes Python ints or int64 arrays of any shape, broadcasts, and gives
int64 of that shape. Ids are trusted; only the functions that say so check anything.
"""

import numpy as np
from numpy.typing import NDArray

from tiles import zones
from tiles.frames import Ints
from tiles.zones import Bounds, FloatLike, IntLike

MAX_LEVEL = 28
POLAR_RAD = np.pi / 2 - 1e-9
"""A latitude beyond is a pole."""
_ONE = np.int64(1)
_SPREAD = (
    (16, 0x0000FFFF0000FFFF),
    (8, 0x00FF00FF00FF00FF),
    (4, 0x0F0F0F0F0F0F0F0F),
    (2, 0x3333333333333333),
    (1, 0x5555555555555555),
)


def make(zone: IntLike, level: IntLike, row: IntLike, col: IntLike) -> Ints:
    """Return the id of the cell at a row and column inside its zone.

    Raises
    ------
    ValueError
        When zone, level, row or column is out of range.
    """
    zone, level, row, col = (np.asarray(x, np.int64) for x in (zone, level, row, col))
    _require_level(level)
    side = _ONE << level
    inside = (row >= 0) & (row < side) & (col >= 0) & (col < side)
    if not np.all(inside & (zone >= 0) & (zone < zones.COUNT)):
        raise ValueError("a zone, row or column is outside the forest")
    morton = _spread(row) << 1 | _spread(col)
    return ((zone << 2 * level | morton) << 1 | 1) << 2 * (MAX_LEVEL - level)


def level(cell: IntLike) -> Ints:
    """Return the level, 0 for a whole zone."""
    return MAX_LEVEL - _zeros(cell) // 2


def zone(cell: IntLike) -> Ints:
    """Return the zone, 0 to 31."""
    return np.asarray(cell, np.int64) >> 2 * MAX_LEVEL + 1


def row_col(cell: IntLike) -> tuple[Ints, Ints]:
    """Return row and column inside the zone; row 0 is south, column 0 is west."""
    cell = np.asarray(cell, np.int64)
    zeros = _zeros(cell)
    # The zone is cut off after the shift: 56 - zeros = 2 * level Morton bits stay.
    morton = (cell >> zeros + 1) & ((_ONE << 2 * MAX_LEVEL - zeros) - 1)
    return _gather(morton >> 1), _gather(morton)


def ancestor(cell: IntLike, level: IntLike) -> Ints:
    """Return the cell of a level that contains this one (itself at its own level).

    Raises
    ------
    ValueError
        When the level is negative or deeper than the cell's own.
    """
    cell = np.asarray(cell, np.int64)
    level = np.asarray(level, np.int64)
    _require_level(level)
    sentinel = _ONE << 2 * (MAX_LEVEL - level)
    if np.any(sentinel < _sentinel(cell)):
        raise ValueError("a cell has no ancestor deeper than itself")
    return (cell & -sentinel) | sentinel


def children(cell: IntLike) -> Ints:
    """Return the four children, shape (..., 4), in the order SW, SE, NW, NE.

    Raises
    ------
    ValueError
        When a cell is of the deepest level.
    """
    cell = np.asarray(cell, np.int64)[..., np.newaxis]
    sentinel = _sentinel(cell)
    if np.any(sentinel == 1):
        raise ValueError("a cell of the deepest level has no children")
    return cell - sentinel + (sentinel >> 2) * np.array((1, 3, 5, 7), np.int64)


def child_position(cell: IntLike) -> Ints:
    """Return which child of its parent the cell is, 0 to 3; ValueError for a root."""
    cell = np.asarray(cell, np.int64)
    zeros = _zeros(cell)
    if np.any(zeros >= 2 * MAX_LEVEL):
        raise ValueError("a zone root is nobody's child")
    return (cell >> zeros + 1) & 3


def range_min(cell: IntLike) -> Ints:
    """Return the smallest id among the cell and its descendants."""
    cell = np.asarray(cell, np.int64)
    return cell - (_sentinel(cell) - 1)


def range_max(cell: IntLike) -> Ints:
    """Return the largest id among the cell and its descendants (inclusive)."""
    cell = np.asarray(cell, np.int64)
    return cell + (_sentinel(cell) - 1)


def contains(a: IntLike, b: IntLike) -> NDArray[np.bool_]:
    """Tell whether b is a or a descendant of a."""
    return (range_min(a) <= b) & (b <= range_max(a))


def cell_at(lon_rad: FloatLike, lat_rad: FloatLike, level: IntLike) -> Ints:
    """Return the cell of a level that holds a point.

    Longitude wraps, latitude is clamped. A point on an edge is in the cell to its east
    or north; the north pole is in the northernmost row. Exact against ``bounds_rad``.
    ValueError when a coordinate is not finite or the level is out of range.
    """
    _require_level(level)
    row, col = zones.grid_at(lon_rad, lat_rad, level)
    return from_global(level, row, col)


def global_row_col(cell: IntLike) -> tuple[Ints, Ints]:
    """Return row (0 to 4*2**L - 1) and column (0 to 8*2**L - 1) over the whole globe."""
    row, col = row_col(cell)
    zone_row, zone_col = zones.row_col(zone(cell))
    depth = level(cell)
    return (zone_row << depth) + row, (zone_col << depth) + col


def from_global(level: IntLike, row: IntLike, col: IntLike) -> Ints:
    """Return the cell at a row and column of the whole globe; columns wrap around.

    Raises
    ------
    ValueError
        When the level or the row is out of range (``links`` goes over the poles).
    """
    level = np.asarray(level, np.int64)
    _require_level(level)
    row = np.asarray(row, np.int64)
    col = np.asarray(col, np.int64) & ((zones.COLUMNS << level) - 1)
    mask = (_ONE << level) - 1
    return make(zones.zone_of(row >> level, col >> level), level, row & mask, col & mask)


def bounds_rad(
    cell: IntLike,
) -> Bounds:
    """Return (west, south, east, north) in radians, float64.

    Each is an integer times ``zones.step_rad``, so shared edges are bit-identical,
    also between levels. The last column's east is +pi.
    """
    row, col = global_row_col(cell)
    return zones.grid_bounds_rad(level(cell), row, col)


def text(cell: int | np.int64) -> str:
    """Return one cell as "zone/level/row/col", for messages."""
    row, col = row_col(cell)
    return f"{int(zone(cell))}/{int(level(cell))}/{int(row)}/{int(col)}"


def _require_level(level: IntLike) -> None:
    if not np.all((np.asarray(level) >= 0) & (np.asarray(level) <= MAX_LEVEL)):
        raise ValueError(f"a level is not between 0 and {MAX_LEVEL}")


def _sentinel(cell: Ints) -> Ints:
    """Return the lowest one bit."""
    return cell & -cell


def _zeros(cell: IntLike) -> Ints:
    """Return the number of zeros below the lowest one bit."""
    # A power of two is exact in float64, and frexp gives its exponent plus one.
    sentinel = _sentinel(np.asarray(cell, np.int64))
    return np.frexp(sentinel.astype(np.float64))[1].astype(np.int64) - 1


def _spread(x: Ints) -> Ints:
    """Put zeros between the 28 bits of x."""
    for shift, mask in _SPREAD:
        x = (x | x << shift) & mask
    return x


def _gather(x: Ints) -> Ints:
    """Take every second bit of x, the inverse of ``_spread``."""
    x = x & _SPREAD[-1][1]
    for (shift, _), (_, mask) in zip(_SPREAD[:0:-1], _SPREAD[-2::-1], strict=True):
        x = (x | x >> shift) & mask
    return (x | x >> 16) & 0xFFFFFFF
