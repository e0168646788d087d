# SPDX-License-Identifier: Apache-2.0
"""Which cell holds an object: one block-sized level for the ordinary, higher for large.

A cell splits while it holds more than 48 objects (or 64 KiB of mesh), or is wider than
a block of tiles should be, and only while its children would still be wider than its
ordinary objects. That leaves about 25 in a cell and 120 in the linked cells of a
building; splitting above 32 leaves 12 and 57, above 64 as many as 35 and 160 (San
Francisco). An object lives at the deepest existing level whose cells are wider
than the object, so the four linked cells of a point hold all that can reach it.
"""

import numpy as np
from numpy.typing import NDArray

from tiles import cells, geodesy
from tiles.errors import InputError
from tiles.frames import Floats, Ints

MAX_OBJECTS = 48
MAX_MESH_BYTES = 64 << 10
MAX_LEAF_M = 1500.0
"""Wider cells always split: 16-bit steps of a leaf stay below 4 cm."""
MAX_VERTICES = 60_000
"""Own vertices of a cell; 16-bit indices and the proxies' share of them."""
ORDINARY = 0.9
"""Share of a cell's objects that must be smaller than the child that would hold them."""


def assign(
    lon_rad: Floats,
    lat_rad: Floats,
    dimension_m: Floats,
    vertex_count: Ints,
    vertex_bytes: int,
) -> Ints:
    """Return the cell of each object.

    Parameters
    ----------
    lon_rad, lat_rad : (n,) centres
    dimension_m : (n,) bounding dimensions
    vertex_count : (n,) vertices of each object's mesh
    vertex_bytes : bytes of mesh per vertex, indices included
    """
    leaf_level = _leaf_levels(lon_rad, lat_rad, dimension_m, vertex_count * vertex_bytes)
    cell = cells.cell_at(lon_rad, lat_rad, leaf_level)
    level = leaf_level.copy()
    while (high := (level > 0) & (geodesy.cell_width_m(cell) <= dimension_m)).any():
        level[high] -= 1
        cell[high] = cells.ancestor(cell[high], level[high])
    return _pushed_up(cell, dimension_m, vertex_count)


def _leaf_levels(lon_rad: Floats, lat_rad: Floats, dimension_m: Floats, size: Ints) -> Ints:
    """Split from the zone roots down; all cells of one level at once."""
    leaf = np.zeros(len(lon_rad), np.int64)
    deep = cells.cell_at(lon_rad, lat_rad, cells.MAX_LEVEL)
    # Sorted, the objects of every cell of every level stand together.
    active = np.argsort(deep, kind="stable")
    deep = deep[active]
    for level in range(cells.MAX_LEVEL):
        if not len(active):
            break
        leaf[active] = level
        below = cells.ancestor(deep, level + 1)
        first, count = _runs(below)
        width_m = np.repeat(geodesy.cell_width_m(below[first]), count)
        fits = width_m > dimension_m[active]
        splits = _splits(cells.ancestor(deep, level), fits, size[active])
        active, deep = active[splits], deep[splits]
    return leaf


def _splits(cell: Ints, fits: NDArray[np.bool_], size: Ints) -> NDArray[np.bool_]:
    """Tell for each object whether its cell splits.

    Parameters
    ----------
    cell : (n,) sorted
    fits : (n,) the object is smaller than the child that would hold it
    """
    first, count = _runs(cell)
    fitting = np.add.reduceat(fits.astype(np.int64), first) >= ORDINARY * count
    heavy = np.add.reduceat(size, first) > MAX_MESH_BYTES
    wide = geodesy.cell_edge_m(cell[first]) > MAX_LEAF_M
    splits = (wide | heavy | (count > MAX_OBJECTS)) & fitting
    return np.repeat(splits, count)


def _runs(cell: Ints) -> tuple[Ints, Ints]:
    """Return where each cell begins in a sorted array, and how often it is there."""
    first = np.flatnonzero(np.concatenate(([True], cell[1:] != cell[:-1])))
    return first, np.diff(np.append(first, len(cell)))


def _pushed_up(cell: Ints, dimension_m: Floats, vertex_count: Ints) -> Ints:
    """Move what a cell's 16-bit indices can't reach to its parent, largest first."""
    cell = cell.copy()
    for level in range(int(cells.level(cell).max(initial=0)), -1, -1):
        here = np.flatnonzero(cells.level(cell) == level)
        here = here[np.lexsort((dimension_m[here], cell[here]))]
        total = np.cumsum(vertex_count[here])
        first = np.searchsorted(cell[here], cell[here])
        before = total[first] - vertex_count[here][first]
        over = here[total - before > MAX_VERTICES]
        if len(over) and level == 0:
            advice = "leave some of its buildings out"
            raise InputError(cells.text(int(cell[over[0]])), "too many buildings", advice)
        cell[over] = cells.ancestor(cell[over], max(level - 1, 0))
    return cell
