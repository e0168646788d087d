# SPDX-License-Identifier: Apache-2.0
"""Where all objects of a store live, and in which branches their tiles are made.

This is the one step that looks at all objects at once; it needs a few numbers of each.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ingest import object_levels
from ingest.object_cut import Cut, branch, branch_roots
from ingest.object_tree import Tree, below_proxies, build_tree, contents_m, proxied_children
from tiles import geodesy
from tiles.frames import Floats, Ints
from tiles.mesh import VERTEX

_VERTEX_BYTES = VERTEX.itemsize + 4


@dataclass(frozen=True, slots=True)
class Outline:
    """What the plan needs to know about n objects."""

    id: Ints
    """(n,) ascending"""
    lon_deg: Floats
    lat_deg: Floats
    """(n,) middle of the footprint's box"""
    dimension_m: Floats
    vertex_count: Ints
    """(n,) vertices of the mesh, at most"""


@dataclass(frozen=True, slots=True)
class Plan:
    """The cells of n objects as a tree, and where it is cut."""

    order: Ints
    """(n,) the objects in the order of their cells, largest first in each"""
    cell: Ints
    """(n,) in the order in which they were given"""
    tree: Tree
    held: Ints
    """(p,) cells with a proxy in their parent's tile"""
    roots: Ints
    """(b,) roots of branches"""
    is_wanted: NDArray[np.bool_]
    """(c,) a proxy above is made of what stands for the cell"""

    def branch(self, number: int) -> tuple[Cut, Ints]:
        """Return a branch and its objects, positions as they were given."""
        root = int(self.roots[number])
        first, last = int(self.tree.first[root]), int(self.tree.last[root])
        wanted = bool(self.is_wanted[root])
        cut = branch(self.tree, self.held, root, is_wanted=wanted)
        return cut, self.order[first:last]


def plan_objects(outline: Outline, at_most: int) -> Plan:
    """Give every object its cell, and cut the tree of cells in branches.

    Parameters
    ----------
    at_most : objects of a branch, if it can be split
    """
    lon, lat = np.radians(outline.lon_deg), np.radians(outline.lat_deg)
    cell = object_levels.assign(
        lon, lat, outline.dimension_m, outline.vertex_count, _VERTEX_BYTES
    )
    order = np.lexsort((-outline.dimension_m, cell))
    tree = build_tree(cell[order])
    place = geodesy.to_ecef(lon[order], lat[order], 0.0)
    held = proxied_children(tree, contents_m(tree, place, outline.dimension_m[order]))
    wanted = below_proxies(tree, held)
    return Plan(order, cell, tree, held, branch_roots(tree, at_most), wanted)
