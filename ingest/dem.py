# SPDX-License-Identifier: Apache-2.0
"""Open a raster, and refuse in one line what can't be placed on the earth."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from tiles.errors import InputError
from tiles.frames import WGS84_A_M
from tiles.placement import is_lon_lat

DRIVERS = {
    ".hgt": "SRTMHGT",
    ".zip": "SRTMHGT",
    ".nc": "netCDF",
    ".img": "HFA",
    ".asc": "AAIGrid",
    ".png": "PNG",
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".vrt": "VRT",
}
"""The driver of each ending, GTiff of all others: a file can't choose its own reader, so a
VRT disguised as a TIFF, which could name any other file, is refused."""


@dataclass(frozen=True, slots=True)
class RasterInfo:
    """Where a raster's posts are, and what they mean."""

    path: str
    crs: str
    """WKT"""
    transform: tuple[float, float, float, float, float, float]
    """x = a (col + .5) + b (row + .5) + c, y = d (col + .5) + e (row + .5) + f"""
    width: int
    height: int
    bands: int
    nodata: float | None
    bounds_deg: tuple[float, float, float, float]
    """west, south, east, north; east may exceed 180"""
    spacing_m: float
    """Distance of neighbouring posts at the middle of the raster"""
    wraps: bool
    """Its columns go round the whole globe"""


def open_raster(path: str | Path) -> rasterio.DatasetReader:
    """Open a raster with an allow-listed driver.

    Raises
    ------
    InputError
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "no such file", "check the path")
    driver = DRIVERS.get(path.suffix.lower(), "GTiff")
    try:
        with warnings.catch_warnings():
            # `describe` refuses it, in a line of its own.
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            dataset = rasterio.open(path, driver=driver)
    except (RasterioError, OSError) as error:
        raise unreadable(path, error) from error
    if not dataset.count:
        raise InputError(path, "holds several rasters", "extract one with gdal_translate")
    if np.dtype(dataset.dtypes[0]).kind == "c":
        raise InputError(path, "holds complex numbers", "give elevations in metres")
    return dataset


def unreadable(path: str | Path, error: Exception) -> InputError:
    """Say in one line why GDAL can't read a file."""
    # rasterio's own message may only point to GDAL's, which says what is wrong.
    found = error.__cause__ or error
    reason = (str(found).splitlines() or [type(found).__name__])[0]
    reason = reason.replace(f"'{path}'", "it").replace(str(path), "it").rstrip(".")
    advice = "give a GeoTIFF, HGT or VRT file"
    return InputError(path, f"can't be read as a raster ({reason})", advice)


def describe(
    path: str | Path, dataset: rasterio.DatasetReader, crs: str | None
) -> RasterInfo:
    """Place a raster on the earth.

    Parameters
    ----------
    crs : replaces the file's own; anything that pyproj understands

    Raises
    ------
    InputError
        Without a CRS or georeference.
    """
    wkt = crs or (dataset.crs.to_wkt() if dataset.crs else None)
    if wkt is None:
        raise InputError(
            path, "has no CRS", "name it with --crs, for example --crs EPSG:4326"
        )
    try:
        horizontal = _horizontal(pyproj.CRS.from_user_input(wkt))
    except pyproj.exceptions.CRSError as error:
        raise InputError(path, f"unknown CRS {wkt[:60]!r}", "give --crs EPSG:n") from error
    if dataset.transform.is_identity:
        raise InputError(
            path, "has no georeference", "write one with gdal_translate -a_ullr"
        )
    transform = tuple(dataset.transform)[:6]
    bounds = _bounds_deg(horizontal, dataset)
    turn = abs(transform[0]) * dataset.width
    wraps = is_lon_lat(horizontal) and abs(turn - 360) < 1e-6 and not transform[3]
    return RasterInfo(
        str(path),
        horizontal.to_wkt(),
        transform,
        dataset.width,
        dataset.height,
        dataset.count,
        None if dataset.nodata is None else float(dataset.nodata),
        bounds,
        _spacing_m(horizontal, transform, bounds),
        wraps,
    )


def _horizontal(crs: pyproj.CRS) -> pyproj.CRS:
    return crs.sub_crs_list[0] if crs.is_compound else crs


def _bounds_deg(
    crs: pyproj.CRS, dataset: rasterio.DatasetReader
) -> tuple[float, float, float, float]:
    a, b, c, d, e, f = tuple(dataset.transform)[:6]
    corners = [(i, j) for i in (0, dataset.width) for j in (0, dataset.height)]
    xs = [a * i + b * j + c for i, j in corners]
    ys = [d * i + e * j + f for i, j in corners]
    box = (min(xs), min(ys), max(xs), max(ys))
    if is_lon_lat(crs):
        return box
    to_degrees = pyproj.Transformer.from_crs(crs, 4326, always_xy=True)
    west, south, east, north = to_degrees.transform_bounds(*box, densify_pts=41)
    return west, south, east + 360 if east < west else east, north


def _spacing_m(
    crs: pyproj.CRS,
    transform: tuple[float, ...],
    bounds_deg: tuple[float, float, float, float],
) -> float:
    """Spacing of the posts at the raster's middle: the wider of the two directions."""
    along = float(np.hypot(transform[0], transform[3]))
    across = float(np.hypot(transform[1], transform[4]))
    if not crs.is_geographic or crs.is_derived:
        return max(along, across) * crs.axis_info[0].unit_conversion_factor
    middle = np.radians((bounds_deg[1] + bounds_deg[3]) / 2)
    degree_m = np.radians(1) * WGS84_A_M
    return float(max(along * degree_m * np.cos(middle), across * degree_m))
