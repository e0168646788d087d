# SPDX-License-Identifier: Apache-2.0
"""Small worlds to page: index records by arithmetic, and real stores of tiny tiles."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geopage.view import ViewState
from tiles import bounds, cells, geodesy, zones
from tiles import objects as object_tiles
from tiles import terrain as terrain_tiles
from tiles.codec import checksum
from tiles.frames import Ecef
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import VERTEX, Mesh
from tiles.objects import OBJECT, PROXY, ObjectTile
from tiles.terrain import TerrainTile
from tiles.writer import Writer

SPOT = (np.radians(-122.447), np.radians(37.76))
"""Longitude and latitude of the place that has detail."""
GLOBE_LEVELS = 3
SPOT_LEVEL = 12
BLOCK_LEVEL = 12
"""Level of the cells that hold the town's buildings."""
CITY_LEVELS = (8, 10, BLOCK_LEVEL)
"""Levels that have object tiles; those between them are passed through."""
STRIP_CELLS = 40
"""Cells of `SPOT_LEVEL` that `wide_globe` has east of the spot."""


def view_at(
    height_m: float,
    place: tuple[float, float] = SPOT,
    pitch_deg: float = -90.0,
    heading_deg: float = 0.0,
    t_s: float = 0.0,
) -> ViewState:
    """A view above a place, looking along heading and pitch."""
    lon, lat = place
    east, north, up = geodesy.enu_axes(lon, lat)
    heading, pitch = np.radians(heading_deg), np.radians(pitch_deg)
    level = np.sin(heading) * east + np.cos(heading) * north
    forward = np.cos(pitch) * level + np.sin(pitch) * up
    right = np.cos(heading) * east - np.sin(heading) * north
    rotation = np.stack((right, np.cross(right, forward), -forward))
    eye = Ecef(np.asarray(geodesy.to_ecef(lon, lat, height_m)))
    return ViewState(t_s, eye, rotation, 360 / np.tan(np.radians(30)), 1280, 720)


def globe_cells(levels: int = GLOBE_LEVELS) -> NDArray[np.int64]:
    """All cells of levels 0 to `levels` - 1."""
    found = [cells.make(np.arange(32), 0, 0, 0)]
    for _ in range(levels - 1):
        found = [*found, cells.children(found[-1]).ravel()]
    return np.concatenate(found)


def spot_cells(level: int, place: tuple[float, float] = SPOT) -> NDArray[np.int64]:
    """Every cell that must be there so that the spot's cell of a level is."""
    path = np.array([cells.cell_at(*place, n) for n in range(level)])
    return np.asarray(cells.children(path).ravel())


def terrain_records(wanted: NDArray[np.int64]) -> NDArray[np.void]:
    """Index records as an ingest makes them: errors of edge / 256, 100 m of relief."""
    found = np.unique(wanted)
    records = np.zeros(len(found), INDEX)
    records["cell"] = found
    centre, radius_m = bounds.sphere_of(found, 0.0, 100.0)
    records["centre"], records["radius_m"] = centre, np.ceil(radius_m)
    records["max_height_m"] = 100.0
    level = cells.level(found)
    records["error_m"] = 2.0e4 / 2.0**level
    records["row"] = np.arange(1, len(found) + 1)
    records["tile_bytes"], records["memory_bytes"] = 1000, 4000
    return records


def object_records(place: tuple[float, float] = SPOT) -> NDArray[np.void]:
    """Index records of a small town: skyline, districts and blocks with buildings."""
    blocks = town_blocks(place)
    above = [np.unique(cells.ancestor(blocks, n)) for n in range(BLOCK_LEVEL)]
    ids = np.sort(np.concatenate((blocks, *above)))
    level = cells.level(ids)
    records = np.zeros(len(ids), INDEX)
    records["cell"] = ids
    inside = cells.contains(ids[:, None], blocks[None, :])
    points = block_centres(blocks)
    for i in range(len(ids)):
        own = points[inside[i]]
        records["centre"][i] = own.mean(axis=0)
        reach_m = np.linalg.norm(own - records["centre"][i], axis=1).max() + 60.0
        records["radius_m"][i] = np.float32(reach_m)
    records["max_height_m"] = 60.0
    has_tile = np.isin(level, CITY_LEVELS)
    records["row"][has_tile] = np.arange(1, has_tile.sum() + 1)
    records["tile_bytes"], records["memory_bytes"] = 800 * has_tile, 3000 * has_tile
    records["own_dimension_m"] = np.where(level == BLOCK_LEVEL, 20.0, 0.0)
    records["subtree_dimension_m"] = 20.0
    top, middle = level <= CITY_LEVELS[0], level <= CITY_LEVELS[1]
    records["error_m"] = np.select([top, middle], [40.0, 10.0], 0.0)
    records["proxy_dimension_m"] = np.select([top, middle], [5000.0, 2500.0], 0.0)
    below = np.isin(cells.children(ids), ids)
    records["proxies"] = np.where(middle, below @ np.array((1, 2, 4, 8), np.uint8), 0)
    return records


def town_blocks(place: tuple[float, float]) -> NDArray[np.int64]:
    """Sixteen block cells around a place."""
    west, south, _, _ = cells.bounds_rad(cells.cell_at(*place, BLOCK_LEVEL))
    steps = zones.SIZE_RAD / 2**BLOCK_LEVEL * np.arange(0.5, 4)
    lon, lat = np.meshgrid(west + steps, south + steps)
    return np.unique(cells.cell_at(lon.ravel(), lat.ravel(), BLOCK_LEVEL))


def block_centres(blocks: NDArray[np.int64]) -> Ecef:
    """Middles of cells on the ellipsoid, (n, 3)."""
    west, south, east, north = cells.bounds_rad(blocks)
    return geodesy.to_ecef((west + east) / 2, (south + north) / 2, 0.0)


def deep_globe() -> NDArray[np.void]:
    """Terrain records of a globe of three levels with one deep spot."""
    return terrain_records(np.concatenate((globe_cells(), spot_cells(SPOT_LEVEL))))


def write_store(path: Path, land: NDArray[np.void], things: NDArray[np.void]) -> None:
    """Write a store of tiny tiles, filling in rows, sizes and checksums of the records."""
    with Writer(path) as writer, writer.transaction():
        write_lane(writer, Lane.TERRAIN, land, terrain_body)
        write_lane(writer, Lane.OBJECTS, things, _object_body)


def write_index(path: Path, land: NDArray[np.void], things: NDArray[np.void]) -> None:
    """Write a store without tiles, for paging that reads nothing."""
    with Writer(path) as writer, writer.transaction():
        for lane, records in ((Lane.TERRAIN, land), (Lane.OBJECTS, things)):
            writer.replace_index(lane, records)


def wide_globe() -> NDArray[np.void]:
    """Terrain records of a globe of four levels with a strip of detail east of the spot."""
    steps = zones.SIZE_RAD / 2**SPOT_LEVEL * np.arange(0.0, STRIP_CELLS, 0.9)
    strip = [spot_cells(SPOT_LEVEL, (SPOT[0] + step, SPOT[1])) for step in steps]
    return terrain_records(np.concatenate((globe_cells(4), *strip)))


def write_lane(
    writer: Writer,
    lane: Lane,
    records: NDArray[np.void],
    body_of: Callable[[np.void], bytes],
) -> None:
    """Write tiles and index of a lane inside a transaction."""
    named = np.flatnonzero(records["row"] > 0)
    bodies = [body_of(records[i]) for i in named]
    ids = [int(cell) for cell in records["cell"][named]]
    records["row"][named] = writer.add_tiles(lane, zip(ids, bodies, strict=True))
    records["tile_bytes"][named] = [len(body) for body in bodies]
    records["check"][named] = [
        checksum(lane, cell, body) for cell, body in zip(ids, bodies, strict=True)
    ]
    writer.replace_index(lane, records)


def _mesh(record: np.void) -> Mesh:
    vertices = np.zeros(3, VERTEX)
    vertices["position"][1:, 0] = 100, -100
    return Mesh(record["centre"].copy(), 0.5, vertices, np.arange(3, dtype=np.uint16))


def terrain_body(record: np.void) -> bytes:
    """One triangle and a black texture."""
    texture = np.zeros(terrain_tiles.TEXTURE_BYTES, np.uint8)
    error_m = float(record["error_m"])
    tile = TerrainTile(int(record["cell"]), _mesh(record), 3, error_m, 0.0, texture)
    return terrain_tiles.encode(tile)


def _object_body(record: np.void) -> bytes:
    objects = np.zeros(int(record["own_dimension_m"] > 0), OBJECT)
    objects["dimension_m"], objects["index_end"] = record["own_dimension_m"], 3
    proxies = np.zeros(4 if record["proxy_dimension_m"] > 0 else 0, PROXY)
    proxies["child"], proxies["index_end"] = np.arange(len(proxies)), 3
    tile = ObjectTile(int(record["cell"]), _mesh(record), objects, proxies)
    return object_tiles.encode(tile)
