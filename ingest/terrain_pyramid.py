# SPDX-License-Identifier: Apache-2.0
"""All terrain tiles of one zone, made subtree by subtree.

A leaf is meshed on its source's own posts. Inside a subtree an inner cell is meshed from
the vertices of its children, and held to its bound at every post below it. The few large
cells above the subtrees are meshed on a lattice of their own, measured at every post of
every subtree, and mended where it missed a summit (ingest/large_cell.py). So each tile's
error is its largest distance from the finest data, and grows monotonically upwards.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ingest.affected import Affected
from ingest.large_cell import Miss, Watched, mended, meshing_of, watched
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.rungs import Rung, joined_mesh, laddered, laddered_inner
from ingest.stored_tile import rounded_up, stored_surface
from ingest.terrain_mesh import Places, Surface
from ingest.terrain_plan import Plan
from ingest.terrain_tile import LEAF_SIDE, inner_bound_m, joined, painted, step_m
from ingest.truth import Truth, places_of, truth_of
from tiles import bounds, cells
from tiles.codec import checksum
from tiles.index_tree import INDEX, RUNG_FIELDS
from tiles.lanes import Lane
from tiles.terrain import TEXTURE_SIDE, TerrainTile, encode, in_pieces

HEIGHTS = "min_height_m", "max_height_m"
FLAT_TRIANGLES = 200
"""Four leaves that need no more than this together become one."""
FLAT_TEXELS = 2.0
"""... as long as a texel is no larger than this many posts"""
MOST_LARGE = 64
"""Surfaces above the parts that are kept from part to part"""


@dataclass(slots=True)
class Node:
    """A cell whose tile is being made, or stays."""

    cell: int
    surface: Surface | None = None
    """None where the stored tile stays"""
    error_m: float = 0.0
    low_m: float = np.inf
    high_m: float = -np.inf
    children: list["Node"] = field(default_factory=list)
    truths: list[Truth] = field(default_factory=list)
    """of all leaves below"""
    rungs: list[Rung] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Made:
    """A finished index record, and the stored body where the tile is new."""

    record: NDArray[np.void]
    """(1,) INDEX; `row` is the old one where the tile stays, else 0"""
    body: bytes | None


@dataclass(frozen=True, slots=True)
class Part:
    """What the rest of a zone must know of a subtree that was made apart."""

    cell: int
    error_m: float
    low_m: float
    high_m: float
    above: dict[int, float]
    """Largest distance of each ancestor's surface from the subtree's posts"""
    misses: dict[int, list[Miss]] = field(default_factory=dict)
    """Where an ancestor's surface is beyond its bound"""


class ZoneBuilder:
    """Makes the tiles of one zone, at once or in parts."""

    def __init__(self, mosaic: Mosaic, pictures: list[Layer], affected: Affected) -> None:
        self._mosaic, self._pictures, self._affected = mosaic, pictures, affected
        self._meshed = lru_cache(MOST_LARGE)(self._mesh_large)

    def build(
        self,
        root: int,
        parts: Iterable[Part],
        old: Mapping[int, NDArray[np.void]],
        below: NDArray[np.void],
    ) -> list[Made]:
        """Make every cell of a zone that lies above the parts that cover it.

        Parameters
        ----------
        old : index records of cells around, which stay where nothing changed
        below : index records of the cells in the parts
        """
        self._begin(old)
        self._below = below
        self._finish(self._over({part.cell: part for part in parts}, root))
        return self._bounded()

    def build_part(
        self, cell: int, old: Mapping[int, NDArray[np.void]]
    ) -> tuple[list[Made], Part]:
        """Make one subtree, and measure the surfaces above it at its posts."""
        self._begin(old)
        depth = int(cells.level(cell))
        above = [int(cells.ancestor(cell, level)) for level in range(depth)]
        self._above += [
            watched(self._mosaic, self._meshed(one), self._old.get(one))
            for one in above
            if not self._stays(one)
        ]
        top = self._visit(cell, posts=False)
        self._finish(top)
        errors = {one.surface.cell: one.error_m for one in self._above}
        misses = {one.surface.cell: list(one.misses.values()) for one in self._above}
        part = Part(cell, top.error_m, top.low_m, top.high_m, errors, misses)
        return self._bounded(), part

    def _begin(self, old: Mapping[int, NDArray[np.void]]) -> None:
        self._plan = Plan(self._mosaic, self._pictures)
        self._old = old
        self._above: list[Watched] = []
        self._made: list[Made] = []
        self._spans: list[tuple[NDArray[np.void], float, float]] = []

    def _bounded(self) -> list[Made]:
        """Return what was made, with the spheres of all tiles found at once."""
        if self._spans:
            records, low_m, high_m = zip(*self._spans, strict=True)
            made = np.array([int(one["cell"][0]) for one in records])
            spheres = bounds.sphere_of(made, np.array(low_m), np.array(high_m))
            for record, centre, radius_m in zip(records, *spheres, strict=True):
                record["centre"], record["radius_m"] = centre, radius_m
        return self._made

    def _stays(self, cell: int) -> bool:
        return cell in self._old and not self._affected.touches(cell)

    def _large(self, cell: int) -> Node:
        """Mesh a cell above the parts, unless its stored tile stays."""
        if self._stays(cell):
            return Node(cell)
        return Node(cell, self._meshed(cell))

    def _mesh_large(self, cell: int) -> Surface:
        return meshing_of(self._mosaic, cell).surface()

    def _over(self, parts: Mapping[int, Part], cell: int) -> Node:
        """Put a cell above the parts together from what they say about it."""
        if cell in parts:
            part = parts[cell]
            return Node(cell, None, part.error_m, part.low_m, part.high_m)
        node = self._large(cell)
        below = [part for part in parts.values() if cells.contains(cell, part.cell)]
        if node.surface:
            node.error_m = max(part.above[cell] for part in below)
            misses = [miss for part in below for miss in part.misses.get(cell, [])]
            if misses:
                parts_of = self._mosaic, self._plan, self._below
                node.surface, node.error_m = mended(cell, misses, *parts_of)
        for child in cells.children(cell):
            node.children.append(self._over(parts, int(child)))
            if int(child) not in parts:
                self._finish(node.children[-1])
        return node

    def _visit(self, cell: int, *, posts: bool) -> Node:
        """Make a subtree; its top is finished by the caller.

        Parameters
        ----------
        posts : whether the cell above needs the posts below, even if the subtree stays
        """
        if self._stays(cell):
            return self._kept(cell, posts=posts)
        node = Node(cell)
        if not self._plan.splits(cell):
            node.truths = [self._measured(cell)]
            return self._leaf(node, places_of(node.truths[0]))
        for child in cells.children(cell):
            node.children.append(self._visit(int(child), posts=True))
            node.truths += node.children[-1].truths
        surfaces = [(one.cell, one.surface or self._stored(one)) for one in node.children]
        places = joined(cell, surfaces, inner_bound_m(cell))
        if self._is_flat(node):
            one = self._leaf(Node(cell, truths=node.truths), places)
            errors = (child.error_m for child in node.children)
            if one.error_m <= max(self._plan.leaf_bound_m(cell), *errors):  # else cliffs
                return one
        made = laddered_inner(cell, places, inner_bound_m(cell), node.truths)
        node.surface, node.error_m, node.rungs = made
        for child in node.children:
            self._finish(child)
        return node

    def _stored(self, node: Node) -> Surface:
        return stored_surface(self._mosaic.connection, self._old[node.cell])

    def _kept(self, cell: int, *, posts: bool) -> Node:
        """Take over a stored subtree; its posts are needed where cells above are new."""
        first, last = int(cells.range_min(cell)), int(cells.range_max(cell))
        own = self._old[cell]
        error_m, low_m, high_m = (float(own[key]) for key in ("error_m", *HEIGHTS))
        node = Node(cell, None, error_m, low_m, high_m)
        asked = posts or self._asked(cell)
        for one, record in self._old.items():
            if first <= one <= last:
                if one != cell:
                    self._made.append(Made(record.reshape(1).copy(), None))
                if asked and not record["children"]:
                    leaves = self._plan.first_leaves(one)
                    asking = [leaf for leaf in leaves if posts or self._asked(leaf)]
                    node.truths += [self._measured(leaf) for leaf in asking]
        return node

    def _asked(self, cell: int) -> bool:
        """Say whether a cell above the part needs the posts of an unchanged cell."""
        return any(above.asks(cell) for above in self._above)

    def _measured(self, leaf: int) -> Truth:
        """Find what a leaf stands for, and measure the surfaces above the part with it."""
        truth = truth_of(self._mosaic, leaf, LEAF_SIDE, self._plan.lattice(leaf))
        for one in self._above:
            one.hold(truth)
        return truth

    def _leaf(self, node: Node, places: Places) -> Node:
        """Mesh a leaf."""
        bound_m = self._plan.leaf_bound_m(node.cell)
        made = laddered(node.cell, places, bound_m, node.truths)
        node.surface, node.error_m, node.rungs = made
        node.low_m = min(truth.low_m for truth in node.truths)
        node.high_m = max(truth.high_m for truth in node.truths)
        return node

    def _is_flat(self, node: Node) -> bool:
        """Say whether four leaves are better drawn as one."""
        fresh = [one.surface for one in node.children if one.surface and not one.children]
        if len(fresh) < 4 or self._plan.shown_finer(node.cell):
            return False
        if sum(len(one.triangles) for one in fresh) > FLAT_TRIANGLES:
            return False
        finest_m = min(
            (layer.spacing_m for layer in self._plan.held(node.cell)), default=0.0
        )
        return step_m(node.cell, TEXTURE_SIDE) <= FLAT_TEXELS * finest_m

    def _finish(self, node: Node) -> None:
        """Append a cell's record and body."""
        for child in node.children:
            node.error_m = max(node.error_m, child.error_m)
            node.low_m = min(node.low_m, child.low_m)
            node.high_m = max(node.high_m, child.high_m)
        if node.surface is None:
            record = self._old[node.cell].reshape(1).copy()
            node.error_m = float(record["error_m"][0])
            self._made.append(Made(record, None))
            return
        node.error_m = rounded_up(node.error_m)
        node.truths = []
        self._made.append(self._encoded(node, node.surface))

    def _encoded(self, node: Node, surface: Surface) -> Made:
        held = self._plan.held(node.cell)
        texture, finer_m = painted(self._mosaic, held, self._pictures, node.cell)
        texel_m = finer_m if node.children else 0.0
        count = 3 * len(surface.shown[0])
        coarser = [rung for rung in node.rungs if rung.error_m > node.error_m]
        mesh, rungs = joined_mesh(surface, coarser)
        parts = count, node.error_m, texel_m, texture, rungs
        tile = in_pieces(TerrainTile(node.cell, mesh, *parts))
        body = encode(tile)
        record = np.zeros(1, INDEX)
        # Between posts a triangle cuts through the planet, by no more than the error.
        most_m = float(max([node.error_m, *rungs["error_m"]]))
        low_m, high_m = node.low_m - most_m, node.high_m + node.error_m
        self._spans.append((record, low_m, high_m))
        record["cell"] = node.cell
        record["min_height_m"], record["max_height_m"] = low_m, high_m
        record["error_m"], record["texel_m"] = node.error_m, tile.texel_m
        for name, rung in zip(RUNG_FIELDS, rungs, strict=False):
            record[name] = rung["error_m"]
        record["children"] = 15 if node.children else 0
        record["tile_bytes"] = len(body)
        record["check"] = checksum(Lane.TERRAIN, node.cell, body)
        record["memory_bytes"] = tile.mesh.gpu_bytes + tile.texture.nbytes
        return Made(record, body)
