# SPDX-License-Identifier: Apache-2.0
"""Object tiles and their index: buildings in their cells, proxies above them."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest import object_levels
from ingest.extrude import CORNER_VERTICES, Prisms, extrude
from ingest.footprints import Geometries
from ingest.object_index import index_records
from ingest.object_tiles import OwnObjects, Proxies, make_tile, meshes_of
from ingest.object_tree import Tree, build_tree, proxied_children
from ingest.proxies import Boxes, Solids, make_boxes, measure, sample_surfaces
from ingest.raster_copy import Progress
from ingest.repair import area_m2, size_m
from tiles import cells
from tiles.codec import HEADER, checksum
from tiles.frames import Floats, Ints
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import VERTEX
from tiles.objects import ObjectTile, encode

_VERTEX_BYTES = VERTEX.itemsize + 4
# Half a 16-bit step in three directions, in units of a sphere around the tile.
_ROUNDING = 6e-5


@dataclass(frozen=True, slots=True)
class Buildings:
    """n buildings as they are drawn; heights above the ellipsoid, m."""

    id: Ints
    polygon: Geometries
    """(n,) degrees"""
    foot_m: Floats
    ground_m: Floats
    top_m: Floats
    dimension_m: Floats
    """(n,) bounding dimension: largest side of the box, what is below ground left out"""

    def take(self, order: Ints) -> "Buildings":
        """Return the buildings in another order."""
        return Buildings(
            self.id[order],
            self.polygon[order],
            self.foot_m[order],
            self.ground_m[order],
            self.top_m[order],
            self.dimension_m[order],
        )


@dataclass(frozen=True, slots=True)
class Pyramid:
    """The objects lane of a store, ready to be written."""

    records: NDArray[np.void]
    """(c,) INDEX sorted by cell; `row` is not known yet"""
    tiles: list[tuple[int, bytes]]
    tile_record: Ints
    """(t,) which record names each tile"""
    cell: Ints
    """(n,) cell of each building, in the order in which they were given"""

    def named(self, rows: list[int]) -> NDArray[np.void]:
        """Return the records with the store's rows of the tiles."""
        records = self.records.copy()
        records["row"][self.tile_record] = rows
        return records


def dimensions_m(polygon: Geometries, height_m: Floats) -> Floats:
    """Return bounding dimensions, (n,) m: the largest of width, length and height."""
    return np.maximum(np.maximum(*size_m(polygon)), height_m)


def centres_deg(polygon: Geometries) -> tuple[Floats, Floats]:
    """Return longitude and latitude of the middle of each polygon's box, degrees."""
    west, south, east, north = shapely.bounds(polygon).T
    return (west + east) / 2, (south + north) / 2


def build_pyramid(buildings: Buildings, progress: Progress) -> Pyramid:
    """Put buildings in cells, make proxies above them, and encode all tiles."""
    if not len(buildings.id):
        none = np.zeros(0, np.int64)
        return Pyramid(np.zeros(0, INDEX), [], none, none)
    cell = _cells_of(buildings)
    order = np.lexsort((-buildings.dimension_m, cell))
    buildings = buildings.take(order)
    tree = build_tree(cell[order])
    prisms = extrude(buildings.polygon, buildings.foot_m, buildings.top_m)
    meshes = meshes_of(prisms, np.arange(len(order) + 1), cell[order])
    own = OwnObjects(meshes, buildings.id, buildings.dimension_m)
    progress(1, 3, "extruded")

    bare = index_records(tree, meshes.drawn)
    child = proxied_children(tree, bare["radius_m"].astype(np.float64))
    proxies = _proxies(tree, child, buildings, prisms)
    records = index_records(tree, meshes.drawn + proxies.meshes.drawn)
    proxies = _decide(records, tree, child, own, proxies)
    progress(2, 3, "proxies")
    tiles, where = _encoded(records, tree, child, own, proxies)
    progress(3, 3, "tiles")
    return Pyramid(records, tiles, where, cell)


def _cells_of(buildings: Buildings) -> Ints:
    lon, lat = centres_deg(buildings.polygon)
    corners = shapely.get_num_coordinates(buildings.polygon)
    return object_levels.assign(
        np.radians(lon),
        np.radians(lat),
        buildings.dimension_m,
        CORNER_VERTICES * corners,
        _VERTEX_BYTES,
    )


def _proxies(tree: Tree, child: Ints, buildings: Buildings, prisms: Prisms) -> Proxies:
    """Make a proxy of each cell in `child` (positions) and measure it."""
    solids = Solids(
        np.asarray(shapely.bounds(buildings.polygon), np.float64),
        area_m2(buildings.polygon),
        buildings.foot_m,
        buildings.ground_m,
        buildings.top_m,
    )
    first, last = tree.first[child], tree.last[child]
    boxes = make_boxes(solids, first, last)
    start = np.searchsorted(boxes.group, np.arange(len(child) + 1))
    meshes = meshes_of(
        extrude(boxes.polygon, boxes.foot_m, boxes.top_m),
        start,
        tree.cell[tree.parent[child]],
    )
    error = measure(boxes, sample_surfaces(prisms), first, last)
    return Proxies(
        meshes,
        cells.child_position(tree.cell[child]),
        _box_dimensions_m(boxes, start),
        error,
        last - first,
    )


def _box_dimensions_m(boxes: Boxes, start: Ints) -> Floats:
    if not len(boxes.group):
        return np.zeros(0)
    first = start[:-1]
    low = np.minimum.reduceat(boxes.bounds_deg[:, :2], first)
    high = np.maximum.reduceat(boxes.bounds_deg[:, 2:], first)
    whole = np.asarray(shapely.box(*low.T, *high.T), object)
    height = np.maximum.reduceat(boxes.top_m, first) - np.minimum.reduceat(
        boxes.ground_m, first
    )
    return dimensions_m(whole, height)


def _decide(
    records: NDArray[np.void], tree: Tree, child: Ints, own: OwnObjects, proxies: Proxies
) -> Proxies:
    """Fill in what the selection decides by; errors and dimensions never grow downwards."""
    parent = tree.parent[child]
    error = proxies.error_m + _ROUNDING * records["radius_m"][parent]
    worst, widest, largest = (np.zeros(len(records)) for _ in range(3))
    np.maximum.at(worst, parent, error)
    np.maximum.at(widest, parent, proxies.dimension_m)
    largest[tree.has_own] = own.dimension_m[tree.own_first[tree.has_own]]
    records["own_dimension_m"] = largest
    records["subtree_dimension_m"] = tree.raised(np.maximum, largest)
    records["proxy_dimension_m"] = tree.raised(np.maximum, widest)
    worst = tree.raised(np.maximum, worst)
    records["error_m"] = worst
    np.bitwise_or.at(
        records["proxies"], parent, np.left_shift(1, proxies.child).astype(np.uint8)
    )
    return replace(proxies, error_m=np.maximum(error, worst[child]))


def _encoded(
    records: NDArray[np.void], tree: Tree, child: Ints, own: OwnObjects, proxies: Proxies
) -> tuple[list[tuple[int, bytes]], Ints]:
    """Encode every tile, and say in the records how large it is and its checksum."""
    parent = tree.parent[child]
    where = np.flatnonzero(tree.has_own | np.isin(np.arange(len(records)), parent))
    proxy_first = np.searchsorted(parent, where)
    proxy_last = np.searchsorted(parent, where, side="right")
    tiles = []
    for k, place in enumerate(where.tolist()):
        own_range = slice(int(tree.own_first[place]), int(tree.own_last[place]))
        proxy_range = slice(int(proxy_first[k]), int(proxy_last[k]))
        cell = int(tree.cell[place])
        tile = make_tile(cell, own, proxies, own_range, proxy_range)
        body = encode(tile)
        records["tile_bytes"][place] = len(body)
        records["memory_bytes"][place] = _memory_bytes(tile)
        records["check"][place] = checksum(Lane.OBJECTS, cell, body)
        tiles.append((cell, body))
    return tiles, where


def _memory_bytes(tile: ObjectTile) -> int:
    tables = tile.objects.nbytes + tile.proxies.nbytes
    return HEADER.itemsize + tile.mesh.gpu_bytes + int(tables)
