# SPDX-License-Identifier: Apache-2.0
"""Which cell holds an object: one block-sized level for the ordinary, higher for large.

A cell splits while it holds more than 32 objects (or 64 KiB of mesh), or is wider than
a block of tiles should be, and only while its children would still be wider than its
ordinary objects. An object lives at the deepest existing level whose cells are wider
than the object, so the four linked cells of a point hold all that can reach it.
"""

import numpy as np
from numpy.typing import NDArray

from tiles import cells, geodesy
from tiles.errors import InputError
from tiles.frames import Floats, Ints

MAX_OBJECTS = 32
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
    active = np.arange(len(lon_rad))
    below = cells.cell_at(lon_rad, lat_rad, 0)
    for level in range(cells.MAX_LEVEL):
        if not len(active):
            break
        leaf[active] = level
        cell = below
        below = cells.cell_at(lon_rad[active], lat_rad[active], level + 1)
        fits = geodesy.cell_width_m(below) > dimension_m[active]
        splits = _splits(cell, fits, size[active])
        active, below = active[splits], below[splits]
    return leaf


def _splits(cell: Ints, fits: NDArray[np.bool_], size: Ints) -> NDArray[np.bool_]:
    """Tell for each object whether its cell splits; `fits`: it is smaller than a child."""
    unique, where, count = np.unique(cell, return_inverse=True, return_counts=True)
    fitting = np.bincount(where, fits) >= ORDINARY * count
    heavy = np.bincount(where, size) > MAX_MESH_BYTES
    wide = geodesy.cell_edge_m(unique) > MAX_LEAF_M
    splits = (wide | heavy | (count > MAX_OBJECTS)) & fitting
    return np.asarray(splits[where])


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
