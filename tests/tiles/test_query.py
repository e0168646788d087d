# SPDX-License-Identifier: Apache-2.0
"""Objects at a place through linked cells, against asking every object."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from tiles import cells, geodesy
from tiles.codec import checksum
from tiles.forest import Forest, build_forest
from tiles.frames import Ecef, Floats, Local
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import ROOF, VERTEX, Mesh, quantise
from tiles.objects import OBJECT, PROXY, ObjectTile, encode
from tiles.query import linked_rows, objects_at
from tiles.store import Store
from tiles.writer import Writer

LEAF_LEVEL = 14
HARD = [(0.0, 0.0), (45.0, 45.0), (180.0, 10.0), (-180.0, -45.0), (-135.0, 0.0)]
HARD += [(13.0, 47.0), (10.0, 89.99), (100.0, 90.0), (-60.0, -89.999), (44.99, 80.0)]
SIZES_M = (10.0, 40.0, 150.0, 250.0, 600.0, 4000.0)


def home_of(lon_rad: float, lat_rad: float, dimension_m: float) -> int:
    """The deepest cell around the centre that is wider than the object, else the root."""
    for level in range(LEAF_LEVEL, -1, -1):
        cell = int(cells.cell_at(lon_rad, lat_rad, level))
        if dimension_m < float(geodesy.cell_width_m(cell)):
            return cell
    return int(cells.cell_at(lon_rad, lat_rad, 0))


def roof_of(lon_rad: float, lat_rad: float, side_m: float, turn: float) -> Ecef:
    """Corners of a square, turned, in the tangent plane of its centre: (4, 3)."""
    angle = turn + np.arange(4) * np.pi / 2
    east, north, _ = geodesy.enu_axes(lon_rad, lat_rad)
    half = side_m / np.sqrt(2)
    spokes = np.cos(angle)[:, None] * east + np.sin(angle)[:, None] * north
    return Ecef(geodesy.to_ecef(lon_rad, lat_rad, 0.0) + half * spokes)


def tile_of(cell: int, ids: list[int], roofs: list[Ecef]) -> ObjectTile:
    corners = np.concatenate(roofs)
    centre = corners.mean(axis=0)
    vertices = np.zeros(len(corners), VERTEX)
    vertices["position"], scale_m = quantise(Local(corners - centre))
    vertices["flags"] = ROOF
    vertices["detail"][:, 1] = np.repeat(np.arange(len(roofs)), 4)
    quads = 4 * np.arange(len(roofs))[:, None] + np.array([0, 1, 2, 0, 2, 3])
    mesh = Mesh(Ecef(centre), scale_m, vertices, quads.ravel().astype("<u2"))
    objects = np.zeros(len(ids), OBJECT)
    objects["id"], objects["dimension_m"] = ids, 1.0
    return ObjectTile(cell, mesh, objects, np.zeros(0, PROXY))


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[int, Ecef], Floats]:
    """Squares of many sizes at all the places that hurt: store, roofs by id, centres."""
    rng = np.random.default_rng(11)
    roofs, homes, centres = {}, {}, []
    for lon, lat in np.radians(HARD):
        for side_m in np.repeat(SIZES_M, 6):
            spread = rng.normal(0, side_m / 6.37e6, 2)
            at = geodesy.to_geodetic(
                Ecef(
                    geodesy.to_ecef(lon, lat, 0.0)
                    + spread @ geodesy.enu_axes(lon, lat)[:2] * 6.37e6
                )
            )
            place = float(at[0]), float(at[1])
            one = len(roofs) + 1
            roofs[one] = roof_of(*place, float(side_m), float(rng.uniform(0, 6)))
            homes[one] = home_of(*place, float(side_m) * np.sqrt(2))
            centres.append(place)
    path = tmp_path_factory.mktemp("query") / "town.geopage"
    held = sorted(set(homes.values()))
    whole = {
        int(cells.ancestor(c, k)) for c in held for k in range(int(cells.level(c)) + 1)
    }
    records = np.zeros(len(whole), INDEX)
    records["cell"] = sorted(whole)
    with Writer(path) as writer, writer.transaction():
        for record in records[np.isin(records["cell"], held)]:
            cell = int(record["cell"])
            ids = [one for one, home in homes.items() if home == cell]
            body = encode(tile_of(cell, ids, [roofs[one] for one in ids]))
            k = np.flatnonzero(records["cell"] == cell)
            records["row"][k] = writer.add_tiles(Lane.OBJECTS, [(cell, body)])
            records["check"][k] = checksum(Lane.OBJECTS, cell, body)
            records["own_dimension_m"][k] = 1.0
        writer.replace_index(Lane.OBJECTS, records)
    return path, roofs, np.array(centres)


def standing(roofs: dict[int, Ecef], lon_rad: float, lat_rad: float) -> dict[int, float]:
    """Ask every object: distance of the place inside (+) or outside (-) its roof, m."""
    east_north = geodesy.enu_axes(lon_rad, lat_rad)[:2]
    foot = geodesy.to_ecef(lon_rad, lat_rad, 0.0)
    found = {}
    for one, roof in roofs.items():
        if np.linalg.norm(roof.mean(axis=0) - foot) < 8000:
            polygon = shapely.Polygon((roof - foot) @ east_north.T)
            inside = polygon.contains(shapely.Point(0, 0))
            edge_m = polygon.exterior.distance(shapely.Point(0, 0))
            found[one] = edge_m if inside else -edge_m
    return found


def test_linked_cells_find_what_asking_every_object_finds(
    town: tuple[Path, dict[int, Ecef], Floats], rng: np.random.Generator
) -> None:
    path, roofs, centres = town
    total = 0
    with Store(path) as store:
        forest = build_forest(store.index(Lane.OBJECTS))
        for lon, lat in centres[:: len(centres) // 120]:
            east, north, _ = geodesy.enu_axes(lon, lat)
            off_m = rng.normal(0, 60, 2)
            point = geodesy.to_ecef(lon, lat, 0.0) + off_m[0] * east + off_m[1] * north
            place = tuple(float(v) for v in geodesy.to_geodetic(Ecef(point))[:2])
            truth = standing(roofs, *place)
            found = set(objects_at(store, forest, *place))
            sure = {one for one, inside_m in truth.items() if inside_m > 0.5}
            assert (
                sure <= found <= {one for one, inside_m in truth.items() if inside_m > -0.5}
            )
            total += len(sure)
    assert total > 150


def test_few_cells_are_asked(town: tuple[Path, dict[int, Ecef], Floats]) -> None:
    with Store(town[0]) as store:
        forest = build_forest(store.index(Lane.OBJECTS))
        for lon, lat in town[2]:
            rows = linked_rows(forest, float(lon), float(lat))
            per_level = np.bincount(cells.level(forest.records["cell"][rows]))
            assert per_level[1:].max(initial=0) <= 4
            assert len(set(rows.tolist())) == len(rows)


def test_an_empty_forest_holds_nothing() -> None:
    empty: Forest = build_forest(np.zeros(0, INDEX))
    assert len(linked_rows(empty, 0.0, 0.0)) == 0
