# SPDX-License-Identifier: Apache-2.0
"""A city on ground so rough that every terrain level differs by metres under it."""

import json
from pathlib import Path

import numpy as np
import shapely
from shapely import affinity

from ingest.buildings import BuildingOptions, ingest_buildings
from ingest.terrain import ingest_rasters
from tests.ingest.rasters import north_up, write
from tests.viewer.rough_world import ELLIPSOID, Floats, write_earth

LON_DEG, LAT_DEG = 10.1, 45.1
DEGREE_M = 111_000.0
SIDE = 14
"""Houses along an edge of the city."""
GRID_M = 80.0


def ground_m(east_m: Floats, north_m: Floats) -> Floats:
    """Ridges and valleys of all lengths from 60 m on, slopes up to about one in two."""
    rng = np.random.default_rng(11)
    height = np.full(np.broadcast(east_m, north_m).shape, 500.0)
    for wave_m in (60, 90, 140, 220, 400, 900, 2000, 6000):
        for _ in range(3):
            turn, phase = rng.uniform(0, 2 * np.pi, 2)
            along = np.cos(turn) * east_m + np.sin(turn) * north_m
            height = height + 0.015 * wave_m * np.sin(2 * np.pi * along / wave_m + phase)
    return height


def write_ground(path: Path, step_m: float, posts: int) -> Path:
    """Write a square of ground around the city."""
    reach_m = step_m * posts / 2
    centre = step_m * (np.arange(posts) + 0.5) - reach_m
    height = ground_m(centre[None, :], -centre[:, None]).astype(np.float32)
    west, north = LON_DEG - reach_m / DEGREE_M, LAT_DEG + reach_m / DEGREE_M
    return write(path, height, north_up(west, north, step_m / DEGREE_M), "EPSG:4326")


def write_houses(path: Path) -> Path:
    """Write houses of many sizes and turns, some lower than their slope."""
    rng = np.random.default_rng(5)
    features = []
    for k in range(SIDE * SIDE):
        x, y = (np.array(divmod(k, SIDE)) - SIDE / 2) * GRID_M
        width, depth = rng.uniform(6, 40, 2)
        house = affinity.rotate(shapely.box(0, 0, width, depth), rng.uniform(0, 90))
        house = affinity.translate(house, x, y)
        squeeze = 1 / np.cos(np.radians(LAT_DEG))
        house = affinity.scale(house, squeeze / DEGREE_M, 1 / DEGREE_M, origin=(0, 0))
        house = affinity.translate(house, LON_DEG, LAT_DEG)
        properties = {"height": float(rng.choice([3, 6, 9, 15, 30])), "name": f"house {k}"}
        geometry = json.loads(shapely.to_geojson(house))
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def add_ground(folder: Path, store: Path) -> None:
    """Ingest a rough earth, and the ground around the city in two finenesses."""
    files = [
        write_earth(folder / "earth.tif", 2.0, range(1, 4), 100.0),
        write_ground(folder / "around.tif", 90.0, 100),
        write_ground(folder / "city.tif", 10.0, 130),
    ]
    ingest_rasters(store, [(file, ELLIPSOID) for file in files], workers=1)


def add_houses(folder: Path, store: Path) -> None:
    """Ingest the houses."""
    houses = write_houses(folder / "houses.geojson")
    ingest_buildings(store, [houses], BuildingOptions())


def make_store(folder: Path) -> Path:
    """Make the store."""
    store = folder / "hills.geopage"
    add_ground(folder, store)
    add_houses(folder, store)
    return store
