# SPDX-License-Identifier: Apache-2.0
"""Stores with objects at all the places that hurt, written without ingest."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from tiles import cells, geodesy
from tiles.codec import checksum
from tiles.frames import Ecef, Floats, Ints
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import VERTEX, Mesh
from tiles.objects import OBJECT, PROXY, ObjectTile, encode
from tiles.writer import Writer

LEAF_LEVEL = 14
METRES = 111_320.0
"""Of a degree of latitude, roughly."""
HARD = [(0.0, 0.0), (45.0, 45.0), (180.0, 10.0), (-180.0, -45.0), (-135.0, 0.0)]
HARD += [(13.0, 47.0), (10.0, 89.97), (100.0, 89.9), (-60.0, -89.98), (44.99, 80.0)]
SIZES_M = (10.0, 40.0, 150.0, 250.0, 600.0, 3000.0)
SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
SHAPES = (
    shapely.Polygon(SQUARE),
    shapely.Polygon([(-1, -1), (1, -1), (1, -0.4), (-0.4, -0.4), (-0.4, 1), (-1, 1)]),
    shapely.Polygon(SQUARE, [[(0.6 * x, 0.6 * y) for x, y in SQUARE]]),
    shapely.MultiPolygon([shapely.box(-1, -1, -0.2, 1), shapely.box(0.2, -1, 1, 0.5)]),
    shapely.Polygon([(-1, 0), (0, -1), (1, 0), (0.2, 0.1), (0, 1)]),
)
"""In a box of -1 to 1: plain, concave, with a courtyard, in two parts, slanting."""


@dataclass(frozen=True, slots=True)
class Town:
    """A store and what is in it: object k has id k + 1."""

    path: Path
    footprint: np.ndarray
    """(n,) polygons, degrees; longitudes run past 180"""
    centre_deg: Floats
    """(n, 2)"""
    dimension_m: Floats


def homes(centre_deg: Floats, dimension_m: Floats) -> Ints:
    """The deepest cell around each centre that is wider than the object, else the root."""
    found = np.zeros(len(centre_deg), np.int64)
    for level in range(LEAF_LEVEL + 1):
        cell = cells.cell_at(*np.radians(centre_deg).T, level)
        found = np.where(
            (dimension_m < geodesy.cell_width_m(cell)) | (level == 0), cell, found
        )
    return found


def town(path: Path, rng: np.random.Generator, per_place: int) -> Town:
    """Footprints of all shapes and sizes around every hard place."""
    places = np.repeat(HARD, per_place, axis=0)
    size_m = rng.choice(SIZES_M, len(places))
    per_lat = size_m / METRES
    per_lon = np.minimum(per_lat / np.cos(np.radians(places[:, 1])), 80.0)
    centre = places + rng.normal(0, 1.5, (len(places), 2)) * np.stack((per_lon, per_lat), 1)
    centre[:, 1] = np.clip(centre[:, 1], -90 + per_lat, 90 - per_lat)
    half = np.stack((per_lon, per_lat * rng.uniform(0.3, 1, len(places))), 1) / 2
    shape = np.array(SHAPES, object)[rng.integers(len(SHAPES), size=len(places))]
    footprint = np.array(
        [
            shapely.transform(one, lambda xy, at=at, by=by: xy * by + at)
            for one, at, by in zip(shape, centre, half, strict=True)
        ]
    )
    write(path, footprint, centre, size_m)
    return Town(path, footprint, centre, size_m)


def write(
    path: Path, footprint: np.ndarray, centre_deg: Floats, dimension_m: Floats
) -> None:
    """Write a store with these objects, in their cells, and no mesh."""
    home = homes(centre_deg, dimension_m)
    ancestors = [np.unique(home)]
    for level in range(LEAF_LEVEL):
        deep = ancestors[0][cells.level(ancestors[0]) > level]
        ancestors.append(cells.ancestor(deep, level))
    records = np.zeros(len(np.unique(np.concatenate(ancestors))), INDEX)
    records["cell"] = np.unique(np.concatenate(ancestors))
    with Writer(path) as writer, writer.transaction():
        for k in np.flatnonzero(np.isin(records["cell"], home)):
            cell = int(records["cell"][k])
            body = encode(_tile(cell, np.flatnonzero(home == cell) + 1))
            records["row"][k] = writer.add_tiles(Lane.OBJECTS, [(cell, body)])[0]
            records["check"][k] = checksum(Lane.OBJECTS, cell, body)
            records["own_dimension_m"][k] = 1.0
        writer.replace_index(Lane.OBJECTS, records)
        writer.connection.executemany(
            "INSERT INTO object(id, source, cell, lon_deg, lat_deg, base_m, raised_m,"
            " height_m, dimension_m, footprint, attributes)"
            " VALUES(?, 'town', ?, ?, ?, 0, 0, 9, ?, ?, ?)",
            zip(
                range(1, len(home) + 1),
                home.tolist(),
                *centre_deg.T.tolist(),
                dimension_m.tolist(),
                shapely.to_wkb(footprint).tolist(),
                [f'{{"number": {k}}}' for k in range(len(home))],
                strict=True,
            ),
        )


def _tile(cell: int, ids: Ints) -> ObjectTile:
    mesh = Mesh(Ecef(np.zeros(3)), 1.0, np.zeros(3, VERTEX), np.zeros(3, "<u2"))
    objects = np.zeros(len(ids), OBJECT)
    objects["id"], objects["dimension_m"] = ids, 1.0
    return ObjectTile(cell, mesh, objects, np.zeros(0, PROXY))
