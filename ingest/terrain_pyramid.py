# SPDX-License-Identifier: Apache-2.0
"""All terrain tiles of one zone: depth first, one path of surfaces in memory.

Going down, every inner cell is meshed at its own resolution. At each leaf the surfaces
of all its ancestors are measured at the leaf's posts, so that an inner tile's error is
its largest distance from the finest data below it, and grows monotonically upwards.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import Box, overlap, touches
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.terrain_tile import (
    LARGEST_BOUND_M,
    LEAF_SIDE,
    Painted,
    error_under,
    leaf_error_m,
    leaf_lattice,
    paint,
    step_m,
    tile_of,
)
from tiles import bounds, cells, geodesy
from tiles.codec import checksum
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.terrain import TEXTURE_SIDE, encode

MAX_LEVEL = 20
PROBE = 17


@dataclass(slots=True)
class Node:
    """A cell on the path from the zone's root, while its descendants are made."""

    cell: int
    painted: Painted | None
    """None where the stored tile stays"""
    error_m: float = 0.0
    low_m: float = np.inf
    high_m: float = -np.inf
    children: list["Node"] = field(default_factory=list)


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
    """Largest distance of each ancestor's surface from the subtree's leaves"""


class ZoneBuilder:
    """Makes the tiles of one zone, at once or in parts."""

    def __init__(
        self,
        mosaic: Mosaic,
        pictures: list[Layer],
        changed: list[Box],
        old: Mapping[int, NDArray[np.void]],
    ) -> None:
        self._mosaic, self._pictures = mosaic, pictures
        self._changed, self._old = changed, old
        self._path: list[Node] = []
        self._parts: dict[int, Part] = {}

    def build(self, root: int, parts: Iterable[Part] = ()) -> Iterator[Made]:
        """Yield every cell of the zone that no part has made, children before parents."""
        self._parts = {part.cell: part for part in parts}
        yield from self._visit(root)

    def build_part(self, cell: int) -> tuple[list[Made], Part]:
        """Make one subtree, and measure the surfaces above it at its leaves."""
        depth = int(cells.level(cell))
        above = [int(cells.ancestor(cell, level)) for level in range(depth)]
        self._path = [Node(one, self._inner(one)) for one in above]
        made = list(self._visit(cell))
        top = self._path[-1].children[0] if self._path else Node(cell, None)
        errors = {node.cell: node.error_m for node in self._path}
        return made, Part(cell, top.error_m, top.low_m, top.high_m, errors)

    def cut(self, root: int, most: int) -> list[int]:
        """Return subtrees of about `most` leaves, by area, that cover a zone."""
        found, open_ = [], [root]
        while open_:
            cell = open_.pop()
            if self._leaves(cell) > most and self._splits(cell):
                open_ += [int(child) for child in cells.children(cell)]
            else:
                found.append(cell)
        return found

    def _leaves(self, cell: int) -> float:
        """Estimate the leaves under a cell from the areas and spacings of the sources."""
        edge_m = float(geodesy.cell_edge_m(cell))
        west, south, east, north = cells.bounds_rad(cell)
        count = 0.0
        for layer in [*self._mosaic.layers, *self._pictures]:
            common = overlap(cell, layer.bounds_deg)
            if common is not None:
                area = (common[2] - common[0]) * (common[3] - common[1])
                share = area / float((east - west) * (north - south))
                side = TEXTURE_SIDE if layer.is_picture else LEAF_SIDE
                count += share * (edge_m / (side * layer.spacing_m)) ** 2
        return count

    def _inner(self, cell: int) -> Painted | None:
        """Mesh an inner cell, unless its stored tile stays."""
        if cell in self._old and not touches(cell, self._changed):
            return None
        return paint(self._mosaic, self._pictures, cell, None)

    def _visit(self, cell: int) -> Iterator[Made]:
        if cell in self._parts:
            self._adopt(self._parts[cell])
            return
        keep = cell in self._old and not touches(cell, self._changed)
        node = Node(cell, None)
        if self._splits(cell):
            node.painted = self._inner(cell)
            self._path.append(node)
            for child in cells.children(cell):
                yield from self._visit(int(child))
            self._path.pop()
        else:
            self._leaf(node, keep=keep)
        if self._path:
            self._path[-1].children.append(node)
        yield self._finish(node)

    def _adopt(self, part: Part) -> None:
        """Take over what a subtree made apart says about itself and its ancestors."""
        self._path[-1].children.append(
            Node(part.cell, None, part.error_m, part.low_m, part.high_m)
        )
        for node in self._path:
            node.error_m = max(node.error_m, part.above[node.cell])

    def _leaf(self, node: Node, *, keep: bool) -> None:
        if keep:
            lattice = leaf_lattice(self._mosaic, node.cell)
            node.error_m = float(self._old[node.cell]["error_m"])
        else:
            bound_m = self._leaf_bound_m(node.cell)
            node.painted = paint(self._mosaic, self._pictures, node.cell, bound_m)
            lattice = node.painted.lattice
            error_m = leaf_error_m(self._mosaic, node.cell, node.painted.surface)
            node.error_m = rounded_up(error_m)
        node.low_m, node.high_m = (
            float(lattice.height_m.min()),
            float(lattice.height_m.max()),
        )
        for above in self._path:
            if above.painted:
                gap = error_under(above.painted.surface, above.cell, lattice)
                above.error_m = max(above.error_m, gap + node.error_m)

    def _finish(self, node: Node) -> Made:
        for child in node.children:
            node.error_m = max(node.error_m, child.error_m)
            node.low_m, node.high_m = (
                min(node.low_m, child.low_m),
                max(node.high_m, child.high_m),
            )
        if node.painted is None:
            record = self._old[node.cell].reshape(1).copy()
            node.error_m = float(record["error_m"][0])
            return Made(record, None)
        own = node.painted.lattice.height_m
        node.low_m = min(node.low_m, float(own.min()))
        node.high_m = max(node.high_m, float(own.max()))
        node.error_m = rounded_up(node.error_m)
        tile = tile_of(node.cell, node.painted, node.error_m, leaf=not node.children)
        body = encode(tile)
        record = np.zeros(1, INDEX)
        # Between posts a triangle cuts through the planet, by no more than the error.
        low_m, high_m = node.low_m - node.error_m, node.high_m + node.error_m
        centre, radius_m = bounds.sphere_of(node.cell, low_m, high_m)
        record["cell"], record["centre"], record["radius_m"] = node.cell, centre, radius_m
        record["min_height_m"], record["max_height_m"] = low_m, high_m
        record["error_m"], record["texel_m"] = node.error_m, tile.texel_m
        record["children"] = 15 if node.children else 0
        record["tile_bytes"], record["check"] = (
            len(body),
            checksum(Lane.TERRAIN, node.cell, body),
        )
        record["memory_bytes"] = tile.mesh.gpu_bytes + tile.texture.nbytes
        return Made(record, body)

    def _splits(self, cell: int) -> bool:
        """Say whether a source shows more than a leaf of this size would hold."""
        if cells.level(cell) >= MAX_LEVEL:
            return False
        post_m, texel_m = step_m(cell, LEAF_SIDE), step_m(cell, TEXTURE_SIDE)
        finer = [layer for layer in self._mosaic.layers if layer.spacing_m < 0.999 * post_m]
        finer += [layer for layer in self._pictures if layer.spacing_m < 0.7 * texel_m]
        return any(has_posts(layer, cell) for layer in finer)

    def _leaf_bound_m(self, cell: int) -> float:
        """Return a hundredth of the source's post spacing, or half its own step.

        A small leaf beside a finer source follows the bend of the surface as closely
        as an inner cell of its size would.
        """
        held = [layer for layer in self._mosaic.layers if has_posts(layer, cell)]
        inner_m = min(step_m(cell, TEXTURE_SIDE), LARGEST_BOUND_M)
        if not held:
            return inner_m
        return min(inner_m, max(held[-1].spacing_m / 100, held[-1].vertical_step_m / 2))


def rounded_up(error_m: float) -> float:
    """Return the next float32, as which it is stored: an error never gets smaller."""
    stored = np.float32(error_m)
    above = np.nextafter(stored, np.float32(np.inf))
    return float(stored if stored >= error_m else above)


def has_posts(layer: Layer, cell: int) -> bool:
    """Say whether a source holds data somewhere in a cell."""
    common = overlap(cell, layer.bounds_deg)
    if common is None or layer.wraps or layer.is_picture:
        return common is not None
    west, south, east, north = common
    steps = (np.arange(PROBE) + 0.5) / PROBE
    lon, lat = np.meshgrid(west + steps * (east - west), south + steps * (north - south))
    coarse_m = (north - south) / PROBE * 6.4e6
    return bool(np.isfinite(layer.heights(lon.ravel(), lat.ravel(), coarse_m)).any())
