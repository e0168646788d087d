# SPDX-License-Identifier: Apache-2.0
"""Writing the sample files in one way: small, tiled, with all that a reader needs."""

from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.crs import CRS
from rasterio.transform import Affine

GEOGRAPHIC = CRS.from_epsg(4326)
UTM_10N = CRS.from_epsg(32610)
VOID = -32768


def north_up(west: float, north: float, dx: float, dy: float) -> Affine:
    """Transform of a picture whose first pixel's outer corner is (west, north)."""
    return Affine(dx, 0.0, west, 0.0, -dy, north)


def write_dem(
    path: Path, heights: NDArray[Any], crs: CRS, transform: Affine, nodata: float | None
) -> None:
    """Write elevations (rows, columns) as a tiled, deflated GeoTIFF of areas."""
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "dtype": heights.dtype.name,
        "count": 1,
        "height": heights.shape[0],
        "width": heights.shape[1],
        "crs": crs,
        "transform": transform,
        "nodata": nodata,
        "tiled": True,
        "blockxsize": 256,
        "blockysize": 256,
        "compress": "deflate",
        "zlevel": 9,
        "predictor": 3 if heights.dtype.kind == "f" else 2,
    }
    with rasterio.open(path, "w", **profile) as file:
        file.write(heights, 1)
        file.update_tags(AREA_OR_POINT="Area")
        file.units = ("metre",)


def write_rgb_jpeg(
    path: Path, picture: NDArray[np.uint8], crs: CRS, transform: Affine, quality: int
) -> None:
    """Write a colour picture (rows, columns, 3) as a GeoTIFF with JPEG blocks."""
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "dtype": "uint8",
        "count": 3,
        "height": picture.shape[0],
        "width": picture.shape[1],
        "crs": crs,
        "transform": transform,
        "tiled": True,
        "blockxsize": 256,
        "blockysize": 256,
        "compress": "jpeg",
        "photometric": "ycbcr",
        "jpeg_quality": quality,
    }
    with rasterio.open(path, "w", **profile) as file:
        file.write(np.moveaxis(picture, 2, 0))
