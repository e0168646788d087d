# SPDX-License-Identifier: Apache-2.0
"""The triangles that a draw list draws, and the shortest distance to them."""

import math
from collections import OrderedDict
from typing import NamedTuple

import numpy as np

from geopage.draw_list import DrawList
from tiles import cells, terrain
from tiles.blocks import morton
from tiles.forest import Forest
from tiles.frames import Ecef, Floats, Ints
from tiles.geodesy import to_geodetic
from tiles.kernels import kernel
from tiles.lanes import Lane
from tiles.mesh import UV_ONE
from tiles.points import Point, dot, nearest_on_triangle
from tiles.store import Store
from tiles.terrain import TerrainTile

LEAF = 4
"""Triangles in a box that is not divided further."""
CACHE_TILES = 2048
DEEPEST = 64


class TileBoxes(NamedTuple):
    """The surface triangles of one tile (skirts apart) in a complete binary tree."""

    cell: int
    centre: Floats
    """(3,) ECEF m"""
    radius_m: float
    error_m: float
    """Stated by the tile"""
    corners: Floats
    """(leaves x LEAF, 9) around the centre, m; NaN pads the last leaf"""
    boxes: Floats
    """(2 leaves, 6) least and largest x, y, z; node i has children 2 i and 2 i + 1"""


class DrawnSurface(NamedTuple):
    """All tiles of one draw list."""

    cell: Ints
    """(n,)"""
    centre: Floats
    """(n, 3)"""
    radius_m: Floats
    """(n,)"""
    corners: Floats
    boxes: Floats
    leaves: Ints
    """(n,) leaves of each tile, a power of two"""
    first: Ints
    """(n,) where each tile's leaves begin; its corners at LEAF times, boxes at 2 times"""


class DrawnTiles:
    """Reads tiles as they are drawn. Thread: the one that made it."""

    def __init__(self, store: Store, forest: Forest) -> None:
        self._store, self._forest = store, forest
        self._cache: OrderedDict[tuple[int, int], TileBoxes] = OrderedDict()

    def tile(self, row: int, rung: int = 0) -> TileBoxes:
        """Return the triangles of a mesh of the tile in a row of the forest."""
        if (row, rung) in self._cache:
            self._cache.move_to_end((row, rung))
            return self._cache[row, rung]
        found = self._cache[row, rung] = boxes_of(self.read(row), rung)
        if len(self._cache) > CACHE_TILES:
            self._cache.popitem(last=False)
        return found

    def read(self, row: int) -> TerrainTile:
        """Return the tile in a row of the forest."""
        record = self._forest.records[row]
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        return terrain.decode(self._store.checked_body(Lane.TERRAIN, *key))

    def surface(self, drawn: DrawList) -> DrawnSurface:
        """Return the surface of a list's terrain."""
        return join(self._tiles(drawn))

    def _tiles(self, drawn: DrawList) -> list[TileBoxes]:
        pairs = zip(drawn.terrain.tolist(), drawn.rungs().tolist(), strict=True)
        return [self.tile(row, rung) for row, rung in pairs]

    def leaf_error_m(self, drawn: DrawList) -> Floats:
        """Return what leaves state as their error, m; 0 for tiles with children."""
        rows, errors = drawn.terrain, np.array([one.error_m for one in self._tiles(drawn)])
        return np.where(self._forest.records["children"][rows] == 0, errors, 0.0)


def join(tiles: list[TileBoxes]) -> DrawnSurface:
    """Put tiles together; they keep their order."""
    leaves = np.array([len(tile.boxes) // 2 for tile in tiles], np.int64)
    return DrawnSurface(
        np.array([tile.cell for tile in tiles], np.int64),
        np.stack([tile.centre for tile in tiles]),
        np.array([tile.radius_m for tile in tiles]),
        np.concatenate([tile.corners for tile in tiles]),
        np.concatenate([tile.boxes for tile in tiles]),
        leaves,
        np.concatenate([[0], np.cumsum(leaves)[:-1]]).astype(np.int64),
    )


def boxes_of(tile: TerrainTile, rung: int = 0) -> TileBoxes:
    """Sort a mesh's triangles into boxes, neighbours beside each other."""
    triangles = tile.surface(rung)
    corners = tile.mesh.local[triangles]
    middle = tile.mesh.vertices["detail"][triangles].mean(axis=1) / UV_ONE
    order = np.argsort(morton((middle * 1023).astype(np.int64)), kind="stable")
    leaves = 1 << max(0, math.ceil(math.log2(max(len(triangles), 1) / LEAF)))
    padded = np.full((leaves * LEAF, 3, 3), np.nan)
    padded[: len(triangles)] = corners[order]
    boxes = np.full((2 * leaves, 6), np.inf)
    by_leaf = np.where(np.isnan(padded), np.inf, padded).reshape(leaves, -1, 3)
    boxes[leaves:, :3] = by_leaf.min(axis=1)
    boxes[leaves:, 3:] = (
        np.where(np.isnan(padded), -np.inf, padded).reshape(leaves, -1, 3).max(axis=1)
    )
    start = leaves
    while start > 1:
        pairs = boxes[start : 2 * start].reshape(-1, 2, 6)
        start //= 2
        boxes[start : 2 * start, :3] = pairs[..., :3].min(axis=1)
        boxes[start : 2 * start, 3:] = pairs[..., 3:].max(axis=1)
    radius_m = float(np.linalg.norm(corners, axis=2).max()) if len(corners) else -np.inf
    return TileBoxes(
        tile.cell, tile.mesh.centre, radius_m, tile.error_m, padded.reshape(-1, 9), boxes
    )


def holders(surface: DrawnSurface, points: Floats) -> Ints:
    """Return the tile whose cell holds the place of each point, (n, 3) ECEF m; -1 none."""
    lon, lat, _ = to_geodetic(Ecef(points))
    place = cells.cell_at(lon, lat, cells.MAX_LEVEL)
    first = cells.range_min(surface.cell)
    order = np.argsort(first)
    found = order[np.maximum(np.searchsorted(first[order], place, side="right") - 1, 0)]
    return np.where(cells.contains(surface.cell[found], place), found, -1)


@kernel
def distances_to(
    surface: DrawnSurface, points: Floats, hint: Ints, limit_m: Floats, enough_m: Floats
) -> Floats:
    """Return the shortest distance of each point to the drawn triangles.

    Parameters
    ----------
    points : (n, 3) ECEF m
    hint : (n,) tile that is probably near, -1 unknown
    limit_m : (n,) upper bounds that are known; they come back when nothing is nearer
    enough_m : (n,) the search may end with any distance up to this

    Returns
    -------
    (n,) m
    """
    out = np.empty(len(points))
    waiting, bound = np.empty(DEEPEST, np.int64), np.empty(DEEPEST)
    for i in range(len(points)):
        p = (points[i, 0], points[i, 1], points[i, 2])
        best = limit_m[i]
        first = hint[i]
        if first < 0:
            first = _closest_ball(surface, p)
        for k in range(-1, len(surface.radius_m)):
            if best <= enough_m[i]:
                break
            one = first if k < 0 else k
            if k == first or _off_ball(surface, one, p) >= best:
                continue
            best = min(best, _in_tile(surface, one, p, best, waiting, bound))
        out[i] = best
    return out


@kernel
def _off_ball(surface: DrawnSurface, tile: int, p: Point) -> float:
    """Return how far a point is outside a tile's ball, negative inside."""
    x = p[0] - surface.centre[tile, 0]
    y = p[1] - surface.centre[tile, 1]
    z = p[2] - surface.centre[tile, 2]
    radius_m: float = surface.radius_m[tile]
    return math.sqrt(x * x + y * y + z * z) - radius_m


@kernel
def _closest_ball(surface: DrawnSurface, p: Point) -> int:
    best, found = math.inf, 0
    for tile in range(len(surface.radius_m)):
        off = _off_ball(surface, tile, p)
        if off < best:
            best, found = off, tile
    return found


@kernel
def _in_tile(
    surface: DrawnSurface, tile: int, p: Point, best: float, waiting: Ints, bound: Floats
) -> float:
    """Return the distance to one tile's triangles where it is below `best`."""
    x = p[0] - surface.centre[tile, 0]
    y = p[1] - surface.centre[tile, 1]
    z = p[2] - surface.centre[tile, 2]
    leaves, first = surface.leaves[tile], surface.first[tile]
    waiting[0], bound[0], count = 1, 0.0, 1
    square = best * best
    while count:
        count -= 1
        if bound[count] >= square:
            continue
        node = waiting[count]
        if node >= leaves:
            start = (first + node - leaves) * LEAF
            for t in range(start, start + LEAF):
                square = min(square, _to_triangle(surface.corners, t, x, y, z, square))
            continue
        near = _to_box(surface.boxes, 2 * first + 2 * node, x, y, z)
        far = _to_box(surface.boxes, 2 * first + 2 * node + 1, x, y, z)
        swap = int(near <= far)  # the nearer child is looked at first
        waiting[count], bound[count] = 2 * node + swap, far if swap else near
        waiting[count + 1], bound[count + 1] = 2 * node + 1 - swap, near if swap else far
        count += 2
    return math.sqrt(square)


@kernel
def _to_box(boxes: Floats, node: int, x: float, y: float, z: float) -> float:
    """Return the squared distance of a point to a box, inf for an empty one."""
    dx = max(boxes[node, 0] - x, 0.0, x - boxes[node, 3])
    dy = max(boxes[node, 1] - y, 0.0, y - boxes[node, 4])
    dz = max(boxes[node, 2] - z, 0.0, z - boxes[node, 5])
    square: float = dx * dx + dy * dy + dz * dz
    return square


@kernel
def _to_triangle(
    corners: Floats, t: int, x: float, y: float, z: float, best: float
) -> float:
    """Return the squared distance of a point to a triangle, `best` for padding."""
    if math.isnan(corners[t, 0]):
        return best
    a = (corners[t, 0] - x, corners[t, 1] - y, corners[t, 2] - z)
    b = (corners[t, 3] - x, corners[t, 4] - y, corners[t, 5] - z)
    c = (corners[t, 6] - x, corners[t, 7] - y, corners[t, 8] - z)
    q = nearest_on_triangle(a, b, c)
    return dot(q, q)
