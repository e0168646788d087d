# SPDX-License-Identifier: Apache-2.0
"""A real store, small enough to be made in a test: coarse earth, and a few blocks."""

import json
from pathlib import Path

import numpy as np
import rasterio
from rasterio import Affine

from ingest.buildings import BuildingOptions, ingest_buildings
from ingest.terrain import RasterOptions, ingest_rasters

LON_DEG, LAT_DEG = 10.0, 45.0
STEP_DEG = 0.4
COLS = round(360 / STEP_DEG)
BLOCK_M = 20.0
ROWS = 12


def write_earth(path: Path) -> None:
    """Write a whole earth of smooth hills, elevations in metres."""
    lat = np.radians(90 - STEP_DEG * (np.arange(COLS // 2) + 0.5))[:, None]
    lon = np.radians(-180 + STEP_DEG * (np.arange(COLS) + 0.5))[None, :]
    hills = 800.0 * np.sin(3 * lon) * np.cos(lat) ** 2 + 300.0 * np.sin(4 * lat)
    profile = {"driver": "GTiff", "width": COLS, "height": COLS // 2}
    profile |= {"count": 1, "dtype": "int16"}
    transform = Affine(STEP_DEG, 0, -180, 0, -STEP_DEG, 90)
    with rasterio.open(path, "w", crs="EPSG:4326", transform=transform, **profile) as file:
        file.write(hills.astype(np.int16), 1)


def write_city(path: Path) -> int:
    """Write a square of blocks with heights; returns how many."""
    metre = 1 / 111_000.0
    features = []
    for row in range(ROWS):
        for col in range(ROWS):
            west = LON_DEG + 1.8 * BLOCK_M * col * metre / np.cos(np.radians(LAT_DEG))
            south = LAT_DEG + 1.8 * BLOCK_M * row * metre
            east = west + BLOCK_M * metre / np.cos(np.radians(LAT_DEG))
            north = south + BLOCK_M * metre
            corners = [[west, south], [east, south], [east, north], [west, north]]
            ring = [*corners, corners[0]]
            geometry = {"type": "Polygon", "coordinates": [ring]}
            properties = {"height": 10 + (row * col) % 17, "name": f"{row}-{col}"}
            feature = {"type": "Feature", "properties": properties}
            features.append({**feature, "geometry": geometry})
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return len(features)


def make_store(folder: Path) -> Path:
    """Make the store."""
    earth, city, store = folder / "hills.tif", folder / "city.geojson", folder / "w.geopage"
    write_earth(earth)
    write_city(city)
    options = RasterOptions("terrain", datum="egm96")
    ingest_rasters(store, [(earth, options)], workers=1)
    ingest_buildings(store, [city], BuildingOptions())
    return store


def write_path(path: Path, duration_s: float, heights_m: tuple[float, float]) -> Path:
    """Write a flight straight down to the city."""
    middle = LAT_DEG + 0.9 * BLOCK_M * ROWS / 111_000.0
    east = LON_DEG + 0.9 * BLOCK_M * ROWS / 111_000.0 / np.cos(np.radians(LAT_DEG))
    pose = {"lat_deg": middle, "lon_deg": east, "heading_deg": 0.0, "pitch_deg": -90.0}
    frames = [
        {"t_s": 0.0, "height_m": heights_m[0], **pose},
        {"t_s": duration_s, "height_m": heights_m[1], **pose},
    ]
    whole: dict[str, object] = {"name": path.stem, "duration_s": duration_s}
    whole["height_reference"] = "ground"
    whole |= {"interpolation": "log_height", "keyframes": frames}
    path.write_text(json.dumps(whole))
    return path
