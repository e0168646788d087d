# SPDX-License-Identifier: Apache-2.0
"""Small made-up worlds: spheres with coloured tiles, and boxes that stand on them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.view import ViewState
from tiles import bounds, cells, geodesy, zones
from tiles.forest import Forest, build_forest
from tiles.frames import Ecef, Local
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import ROOF, SKIRT, UV_ONE, VERTEX, WALL, Mesh, quantise
from tiles.objects import OBJECT, PROXY, PROXY_ORDINAL, ObjectTile
from tiles.terrain import MIP_SIDES, TerrainTile, in_pieces

Height = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
Rgb = tuple[int, int, int]
ROOTS = cells.make(np.arange(zones.COUNT), 0, 0, 0)


def sea_level(lon: NDArray[np.float64], lat: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros(np.broadcast(lon, lat).shape)


def one_colour(rgb: Rgb) -> NDArray[np.uint8]:
    """BC1 blocks of all levels in one colour (5, 6, 5 bits)."""
    r, g, b = rgb
    colour = np.array([r >> 3 << 11 | g >> 2 << 5 | b >> 3] * 2, "<u2").view(np.uint8)
    block = np.concatenate([colour, np.zeros(4, np.uint8)])
    return np.tile(block, sum((side // 4) ** 2 for side in MIP_SIDES))


def checker(
    a: tuple[int, int, int], b: tuple[int, int, int], parts: int = 8
) -> NDArray[np.uint8]:
    """BC1 blocks of squares in two colours."""
    blocks_a, blocks_b = one_colour(a).reshape(-1, 8), one_colour(b).reshape(-1, 8)
    which = []
    for side in MIP_SIDES:
        i = np.arange(side // 4) * parts // max(side // 4, 1)
        which.append(((i[:, None] + i[None, :]) % 2).ravel())
    return np.where(np.concatenate(which)[:, None] == 0, blocks_a, blocks_b).ravel()


def terrain_tile(
    cell: int, texture: NDArray[np.uint8], side: int = 17, height: Height = sea_level
) -> TerrainTile:
    """A grid of side x side vertices with a skirt all around, in blocks."""
    west, south, east, north = (float(x) for x in cells.bounds_rad(cell))
    u, v = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    lon, lat = west + u * (east - west), south + v * (north - south)
    points = geodesy.to_ecef(lon, lat, height(lon, lat)).reshape(-1, 3)
    centre = points.mean(0)
    rim = _rim(side)
    steps, scale = quantise(Local(points - centre))
    vertices = np.zeros(len(steps) + len(rim), VERTEX)
    vertices["position"] = np.concatenate([steps, steps[rim]])
    uv = np.rint(np.stack((u, v), -1).reshape(-1, 2) * UV_ONE)
    vertices["detail"] = np.concatenate([uv, uv[rim]])
    vertices["flags"][len(steps) :] = SKIRT
    i = np.arange(side * side).reshape(side, side)
    a, b, c, d = i[:-1, :-1], i[:-1, 1:], i[1:, :-1], i[1:, 1:]
    surface = np.stack((a, b, d, a, d, c), -1).ravel()
    hang = len(steps) + np.arange(len(rim))
    nxt = np.roll(np.arange(len(rim)), -1)
    skirt = np.stack((rim, hang, rim[nxt], rim[nxt], hang, hang[nxt]), -1).ravel()
    indices = np.concatenate([surface, skirt]).astype(np.uint16)
    mesh = Mesh(Ecef(centre), scale, vertices, indices)
    return in_pieces(TerrainTile(cell, mesh, len(surface), 20_000.0, 0.0, texture))


def _rim(side: int) -> NDArray[np.int64]:
    i = np.arange(side * side).reshape(side, side)
    return np.concatenate([i[0, :-1], i[:-1, -1], i[-1, :0:-1], i[:0:-1, 0]])


def boxes_tile(
    cell: int,
    places: NDArray[np.float64],
    sizes: NDArray[np.float64],
    *,
    proxy: bool = False,
) -> ObjectTile:
    """Boxes standing on the ellipsoid.

    Parameters
    ----------
    places : (n, 3) longitude, latitude (rad) and height of the base (m)
    sizes : (n, 3) width, depth, height, m; sorted largest first here
    proxy : one box more, around nothing, as proxy of child 2
    """
    order = np.argsort(-sizes.max(axis=1), kind="stable")
    places, sizes = places[order], sizes[order]
    base = geodesy.to_ecef(*places.T)
    centre = base.mean(0)
    parts = [_box(*pair) for pair in zip(places, sizes, strict=True)]
    points = np.concatenate([p[0] for p in parts]) - centre
    steps, scale = quantise(Local(points))
    vertices = np.concatenate([p[1] for p in parts])
    vertices["position"] = steps
    vertices["detail"][:, 1] = np.repeat(np.arange(len(parts)), 24)
    indices = (BOX[None] + 24 * np.arange(len(parts))[:, None]).ravel().astype(np.uint16)
    objects = np.zeros(len(parts), OBJECT)
    objects["id"] = np.arange(len(parts))
    objects["centre"] = base - centre
    objects["dimension_m"] = sizes.max(1)
    objects["index_end"] = 36 * (1 + np.arange(len(parts)))
    proxies = np.zeros(1 if proxy else 0, PROXY)
    if proxy:
        vertices["detail"][-24:, 1] = PROXY_ORDINAL
        objects = objects[:-1]
        proxies[0] = (2, float(sizes[-1].max()), 1.0, len(indices) - 36, len(indices), 5)
    return ObjectTile(cell, Mesh(Ecef(centre), scale, vertices, indices), objects, proxies)


BOX = (np.array([0, 1, 2, 0, 2, 3])[None] + 4 * np.arange(6)[:, None]).ravel()
FACES = (
    ((0, 0, 1), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    ((0, 0, -1), (0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)),
    ((0, -1, 0), (0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)),
    ((1, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)),
    ((0, 1, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1)),
    ((-1, 0, 0), (0, 1, 0), (0, 0, 0), (0, 0, 1), (0, 1, 1)),
)


def _box(
    place: NDArray[np.float64], size: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.void]]:
    axes = geodesy.enu_axes(place[0], place[1])
    origin = geodesy.to_ecef(*place)
    corners = np.array([face[1:] for face in FACES], np.float64).reshape(-1, 3)
    points = origin + ((corners - (0.5, 0.5, 0.0)) * size) @ axes
    vertices = np.zeros(24, VERTEX)
    normals = np.array([face[0] for face in FACES], np.float64) @ axes
    vertices["normal"][:, :3] = np.repeat(np.rint(normals * 127), 4, axis=0)
    vertices["flags"] = np.repeat([ROOF, WALL, WALL, WALL, WALL, WALL], 4)
    vertices["detail"][:, 0] = np.rint(corners[:, 2] * size[2] * 10)
    return points, vertices


@dataclass
class World:
    """Forests with tiles for some of their rows."""

    forests: dict[Lane, Forest]
    terrain: dict[int, TerrainTile]
    objects: dict[int, ObjectTile]


def make_world(
    terrain: list[TerrainTile], objects: list[ObjectTile] | None = None
) -> World:
    """Index the tiles; one forest per lane, no parents needed."""
    objects = objects or []
    forests = {Lane.TERRAIN: _forest(terrain), Lane.OBJECTS: _forest(objects)}
    rows = {lane: forest.row_of for lane, forest in forests.items()}
    return World(
        forests,
        {int(rows[Lane.TERRAIN](tile.cell)): tile for tile in terrain},
        {int(rows[Lane.OBJECTS](tile.cell)): tile for tile in objects},
    )


def _forest(tiles: list[TerrainTile] | list[ObjectTile]) -> Forest:
    records = np.zeros(len(tiles), INDEX)
    for record, tile in zip(records, tiles, strict=True):
        points = tile.mesh.local
        record["cell"], record["row"] = tile.cell, 1
        record["centre"] = tile.mesh.centre
        record["radius_m"] = np.linalg.norm(points, axis=1).max() * 1.001 + 1e-3
        if isinstance(tile, TerrainTile):
            record["error_m"], record["texel_m"] = tile.error_m, tile.texel_m
    return build_forest(records)


def globe(side: int = 33) -> World:
    """The 32 zone roots, each with its own two colours."""
    tints = np.random.default_rng(5).integers(60, 220, (32, 2, 3))
    tiles = [
        terrain_tile(int(cell), checker(tuple(a), tuple(b)), side)
        for cell, (a, b) in zip(ROOTS, tints, strict=True)
    ]
    return make_world(tiles)


def whole_list(world: World, view: ViewState, threshold_px: float = 0.0) -> DrawList:
    """A draw list of everything."""
    terrain = np.array(sorted(world.terrain), np.int32)
    objects = np.array(sorted(world.objects), np.int32)
    return DrawList(
        1,
        view,
        terrain,
        np.zeros(len(terrain), np.float32),
        np.zeros(len(terrain), np.bool_),
        objects,
        np.ones(len(objects), np.bool_),
        np.full(len(objects), 15, np.uint8),
        threshold_px,
        threshold_px,
        settled=True,
    )


def sphere_bound(cell: int) -> tuple[NDArray[np.float64], float]:
    """The cell's own sphere at sea level."""
    centre, radius = bounds.sphere_of(cell, 0.0, 0.0)
    return centre, float(radius)
