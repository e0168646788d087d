# SPDX-License-Identifier: Apache-2.0
"""Which cells the sources ask for: where a cell splits, and how close a leaf must be."""

from functools import lru_cache

from ingest.boxes import edge_m, edges_rad, overlap
from ingest.feather import bent_lattice, followed_m, source_bound_m
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.terrain_tile import LEAF_SIDE, inner_bound_m, step_m
from ingest.truth import OWN_LATTICE, post_count
from tiles import cells
from tiles.mesh import STEPS
from tiles.terrain import TEXTURE_SIDE

MAX_LEVEL = 20
MOST_POSTS = 40_000
"""In a leaf: its vertices are named by 16 bits"""


class Plan:
    """The shape of the pyramid over some sources."""

    def __init__(self, mosaic: Mosaic, pictures: list[Layer]) -> None:
        self._mosaic, self._pictures = mosaic, pictures
        self._held: dict[int, list[Layer]] = {}
        self._followed_m = lru_cache(65536)(self._followed)
        self.lattice = lru_cache(65536)(self._lattice_of)
        """squares along an edge of a leaf's own lattice; 0 where none shows its bend"""

    def cut(self, root: int, most: int) -> list[int]:
        """Return subtrees of about `most` leaves, by area, that cover a zone."""
        found, open_ = [], [root]
        while open_:
            cell = open_.pop()
            if self._leaves(cell) > most and self.splits(cell):
                open_ += [int(child) for child in cells.children(cell)]
            else:
                found.append(cell)
        return found

    def tiles(self, cell: int) -> int:
        """Estimate the tiles of a subtree, at least one."""
        return max(round(4 / 3 * self._leaves(cell)), 1)

    def _leaves(self, cell: int) -> float:
        """Estimate the leaves under a cell from the areas and spacings of the sources."""
        west, south, east, north = edges_rad(cell)
        count = 0.0
        for layer in [*self._mosaic.layers, *self._pictures]:
            common = overlap(cell, layer.bounds_deg)
            if common is not None:
                area = (common[2] - common[0]) * (common[3] - common[1])
                share = area / float((east - west) * (north - south))
                side = TEXTURE_SIDE if layer.is_picture else LEAF_SIDE
                count += share * (edge_m(cell) / (side * layer.spacing_m)) ** 2
        return count

    def first_leaves(self, cell: int) -> list[int]:
        """Return the leaves that a leaf was made of: flat ones were joined."""
        if not self.splits(cell):
            return [cell]
        children = (int(child) for child in cells.children(cell))
        return [leaf for child in children for leaf in self.first_leaves(child)]

    def splits(self, cell: int) -> bool:
        """Say whether a source shows more than a leaf of this size would hold."""
        if cells.level(cell) >= MAX_LEVEL:
            return False
        post_m = step_m(cell, LEAF_SIDE)
        held = self.held(cell)
        if any(layer.spacing_m < 0.999 * post_m for layer in held):
            return True
        # Near a pole, posts are much denser along parallels.
        if any(post_count(layer, cell) > MOST_POSTS for layer in held):
            return True
        return self.shown_finer(cell) or not self.lattice(cell)

    def _followed(self, cell: int) -> tuple[float, float]:
        return followed_m(self._mosaic, cell, self.held(cell))

    def _lattice_of(self, cell: int) -> int:
        bound_m, spacing_m = self._followed_m(cell)
        if spacing_m >= step_m(cell, OWN_LATTICE):
            return OWN_LATTICE
        # A large cell's vertices are rounded to more than the bound.
        rounds = bound_m < step_m(cell, STEPS)
        return 0 if rounds else bent_lattice(self._mosaic, cell, bound_m)

    def shown_finer(self, cell: int) -> bool:
        """Say whether a picture shows more than the texels of a cell."""
        texel_m = step_m(cell, TEXTURE_SIDE)
        finer = [layer for layer in self._pictures if layer.spacing_m < 0.7 * texel_m]
        return any(overlap(cell, layer.bounds_deg) for layer in finer)

    def held(self, cell: int) -> list[Layer]:
        """Return the elevation models with posts in a cell, coarsest first."""
        if cell not in self._held:
            box = list(edges_rad(cell))
            self._held[cell] = [one for one in self._mosaic.layers if one.holds(box)]
        return self._held[cell]

    def leaf_bound_m(self, cell: int) -> float:
        """Return the bound of the finest source in a leaf, or of one that bends it.

        But at most that of an inner cell of its size.
        """
        most_m = min(inner_bound_m(cell), self._followed_m(cell)[0])
        held = self.held(cell)
        return min(most_m, source_bound_m(held[-1])) if held else most_m
