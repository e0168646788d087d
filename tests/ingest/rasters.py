# SPDX-License-Identifier: Apache-2.0
"""Small rasters for the tests, and what they say, computed without `ingest`."""

from functools import cache
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import pyproj
import rasterio
from numpy.typing import NDArray
from rasterio.errors import NotGeoreferencedWarning
from rasterio.transform import Affine
from rasterio.warp import transform_bounds

from ingest.terrain import RasterOptions, ingest_rasters
from tiles.samples import SAMPLES

Floats = NDArray[np.float64]

WEST, NORTH, STEP = 10.6, 46.7, 0.02
"""North-west corner and spacing of the coarse raster, degrees"""
SIDE = 60
UTM = "EPSG:32632"
INSET_STEP_M = 200.0
EGM96 = RasterOptions(datum="egm96")


def write(
    path: Path,
    posts: NDArray[Any],
    transform: Affine | None,
    crs: str | None,
    nodata: float | None = None,
    **more: object,
) -> Path:
    """Write (h, w) or (bands, h, w) posts as a GeoTIFF."""
    bands = posts if posts.ndim == 3 else posts[None]
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "count": len(bands),
        "dtype": posts.dtype,
        "crs": crs,
    }
    profile |= {"height": bands.shape[1], "width": bands.shape[2], "nodata": nodata}
    if transform is not None:
        profile["transform"] = transform
    with catch_warnings(), open_without_place(path, profile) as out:
        out.write(bands)
        for key, value in more.items():
            setattr(out, key, value)
    return path


def open_without_place(path: Path, profile: dict[str, Any]) -> Any:
    """Open for writing; a missing georeference is meant."""
    simplefilter("ignore", NotGeoreferencedWarning)
    return rasterio.open(path, "w", **profile)


def north_up(west: float, north: float, step: float) -> Affine:
    """Return the transform of a raster with square posts."""
    return Affine(step, 0.0, west, 0.0, -step, north)


def hills(shape: tuple[int, int], step: float, height_m: float) -> NDArray[np.float32]:
    """Return rough posts: waves of several lengths and some noise, (h, w) float32 m."""
    y, x = np.mgrid[: shape[0], : shape[1]] * step
    waves = np.sin(x / 7.0) * np.cos(y / 5.0) + 0.4 * np.sin(x / 2.3 + y / 1.7)
    noise = 0.01 * np.random.default_rng(7).standard_normal(shape)
    return np.asarray(height_m * (1.5 + waves + noise), np.float32)


def coarse(path: Path) -> Path:
    """Write 60 x 60 posts in degrees, about 2 km apart."""
    where = north_up(WEST, NORTH, STEP)
    return write(path, hills((SIDE, SIDE), 1.0, 400.0), where, "EPSG:4326")


def inset(path: Path) -> Path:
    """Write 50 x 40 posts in UTM, 200 m apart, without data in one corner."""
    posts = hills((40, 50), 0.6, 300.0) + np.float32(500.0)
    posts[:12, :9] = -9999.0
    x, y = pyproj.Transformer.from_crs(4326, UTM, always_xy=True).transform(11.1, 46.15)
    return write(path, posts, north_up(x, y, INSET_STEP_M), UTM, -9999.0)


def geoid_m(lon_deg: Floats, lat_deg: Floats) -> Floats:
    """Return EGM96 undulations as PROJ interpolates them."""
    shift = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
        f" +step +proj=vgridshift +grids={SAMPLES / 'egm96_15.tif'} +multiplier=1"
        " +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    return np.asarray(shift.transform(lon_deg, lat_deg, np.zeros(np.shape(lon_deg)))[2])


def pixels(path: Path, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
    """Return columns and rows, posts at whole numbers."""
    with rasterio.open(path) as dataset:
        to_file = pyproj.Transformer.from_crs(4326, dataset.crs, always_xy=True)
        a, b, c, d, e, f = tuple(dataset.transform)[:6]
    x, y = to_file.transform(lon_deg, lat_deg)
    col, row = np.linalg.solve([[a, b], [d, e]], np.stack([x - c, y - f]))
    return col - 0.5, row - 0.5


def source_height_m(path: Path, lon_deg: Floats, lat_deg: Floats) -> Floats:
    """Return elevations of a file's own triangles, NaN outside and at no data.

    The diagonal of a square of posts runs to larger row and column.
    """
    with rasterio.open(path) as dataset:
        posts = dataset.read(1).astype(np.float64)
        posts[dataset.read_masks(1) == 0] = np.nan
    col, row = pixels(path, lon_deg, lat_deg)
    inside = (col >= 0) & (row >= 0)
    inside &= (col < posts.shape[1] - 1) & (row < posts.shape[0] - 1)
    c, r = (np.where(inside, a, 0).astype(int) for a in (col, row))
    fx, fy = col - c, row - r
    nw, ne, sw, se = posts[r, c], posts[r, c + 1], posts[r + 1, c], posts[r + 1, c + 1]
    east = nw + fx * (ne - nw) + fy * (se - ne)
    south = nw + fy * (sw - nw) + fx * (se - sw)
    return np.asarray(np.where(inside, np.where(fx > fy, east, south), np.nan))


def places_in(path: Path, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return random longitudes and latitudes (degrees) at which a file holds data."""
    with rasterio.open(path) as dataset:
        box = transform_bounds(dataset.crs, 4326, *dataset.bounds)
    lon, lat = (
        rng.uniform(box[0], box[2], 4 * count),
        rng.uniform(box[1], box[3], 4 * count),
    )
    known = np.flatnonzero(np.isfinite(source_height_m(path, lon, lat)))[:count]
    assert len(known) == count
    return lon[known], lat[known]


@cache
def nested(base: Path) -> Path:
    """Return a folder with coarse.tif, inset.tif and the bare store of both; read only."""
    folder = base / "nested"
    folder.mkdir()
    files = [coarse(folder / "coarse.tif"), inset(folder / "inset.tif")]
    ingest_rasters(folder / "world.geopage", [(f, EGM96) for f in files], workers=1)
    return folder
