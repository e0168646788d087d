# SPDX-License-Identifier: Apache-2.0
"""A real store of rough ground, fine at zone corners, the antimeridian and both poles."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ingest.terrain import RasterOptions, ingest_rasters
from tests.ingest.rasters import hills, north_up, write

Floats = NDArray[np.float64]
ELLIPSOID = RasterOptions(datum="ellipsoid")
INSETS = (
    ("zone_corner", -0.15, 45.15, 0.01, "EPSG:4326"),
    ("west_of_180", 179.7, 0.15, 0.01, "EPSG:4326"),
    ("east_of_180", -180.0, 0.15, 0.01, "EPSG:4326"),
    ("north_pole", -150e3, 150e3, 10e3, "EPSG:3413"),
    ("south_pole", -150e3, 150e3, 10e3, "EPSG:3031"),
)
"""Name, west, north, spacing and CRS"""
SIDE = 30


def on_sphere(lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Return unit vectors, (..., 3)."""
    axis = np.cos(lat_rad)
    parts = axis * np.cos(lon_rad), axis * np.sin(lon_rad), np.sin(lat_rad)
    return np.stack(np.broadcast_arrays(*parts), -1)


def noise(points: Floats, octaves: range, fall: float = 0.8) -> Floats:
    """Return waves in space, alike everywhere on the sphere; (...) for (..., 3) points."""
    rng = np.random.default_rng(3)
    height = np.zeros(points.shape[:-1])
    for octave in octaves:
        for _ in range(6):
            way = rng.normal(size=3)
            phase = 2.0**octave * points @ (way / np.linalg.norm(way))
            height += np.sin(phase + rng.uniform(0, 2 * np.pi)) * 2.0 ** (-fall * octave)
    return height


def write_earth(path: Path, step_deg: float, octaves: range, height_m: float) -> Path:
    """Write a whole earth of noise, int16 metres above the ellipsoid."""
    lat = np.radians(90 - step_deg * (np.arange(round(180 / step_deg)) + 0.5))[:, None]
    lon = np.radians(-180 + step_deg * (np.arange(round(360 / step_deg)) + 0.5))[None, :]
    posts = height_m * noise(on_sphere(lon, lat), octaves)
    return write(path, posts.astype(np.int16), north_up(-180, 90, step_deg), "EPSG:4326")


def make_store(folder: Path) -> Path:
    """Make the store; its insets stand hundreds of metres above the rest."""
    files = [write_earth(folder / "earth.tif", 1.0, range(1, 6), 600.0)]
    for name, west, north, step, crs in INSETS:
        posts = hills((SIDE, SIDE), 1.0, 400.0)
        files.append(write(folder / f"{name}.tif", posts, north_up(west, north, step), crs))
    store = folder / "rough.geopage"
    ingest_rasters(store, [(file, ELLIPSOID) for file in files], workers=1)
    return store
