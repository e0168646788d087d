# SPDX-License-Identifier: Apache-2.0
"""Open a raster, and refuse in one line what can't be placed on the earth."""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from tiles.errors import InputError
from tiles.frames import WGS84_A_M
from tiles.geodesy import to_ecef
from tiles.placement import is_lon_lat

CACHE_MIB = 128
"""What GDAL may keep of a file's own blocks: 256 whole rows of 130,000 posts"""
LARGEST_BLOCK_BYTES = 256 << 20
"""A file's own block is unpacked whole, however little of it is needed."""
MOST_POSTS, MOST_POSTS_A_BYTE = 1 << 30, 2000
"""A larger raster must have more bytes than that: else it is all but empty."""
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

REMOTE = re.compile(
    rb"/vsi(curl|s3|gs|az|adls|oss|swift|hdfs|webhdfs)|>\s*(https?|ftp)://", re.IGNORECASE
)
"""In a VRT: what GDAL would open over a network"""
ADVICES = {
    ".hgt": "name it by its corner, like N43E007.hgt",
    ".zip": "zip one tile as N43E007.hgt.zip, or unpack it",
    ".gz": "unpack it first",
}


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


@contextmanager
def bounded() -> Iterator[None]:
    """Read rasters with a small cache of GDAL's, and nothing over a network.

    A VRT may name another that names what is far away.
    """
    with rasterio.Env(GDAL_CACHEMAX=CACHE_MIB, CPL_VSIL_CURL_ALLOWED_EXTENSIONS=".none"):
        yield


def open_raster(path: str | Path) -> rasterio.DatasetReader:
    """Open a raster with an allow-listed driver; nothing of it is unpacked yet.

    Raises
    ------
    InputError
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "no such file", "check the path")
    driver = DRIVERS.get(path.suffix.lower(), "GTiff")
    if driver == "VRT" and REMOTE.search(path.read_bytes()):
        raise InputError(path, "names a file on a network", "download that first")
    dataset = quiet_open(path, driver)
    try:
        require_usable(path, dataset)
    except BaseException:
        dataset.close()
        raise
    return dataset


def require_usable(path: Path, dataset: rasterio.DatasetReader) -> None:
    """Refuse what holds no numbers, and what would unpack to gigabytes.

    Raises
    ------
    InputError
    """
    if not dataset.count:
        raise InputError(path, "holds several rasters", "extract one with gdal_translate")
    if np.dtype(dataset.dtypes[0]).kind == "c":
        raise InputError(path, "holds complex numbers", "give elevations in metres")
    posts = dataset.width * dataset.height
    held = path.stat().st_size
    if posts > MOST_POSTS and posts > MOST_POSTS_A_BYTE * held and dataset.driver != "VRT":
        size = f"{dataset.width} x {dataset.height} posts in {held} bytes"
        advice = "cut out what it holds with gdal_translate -projwin"
        raise InputError(path, f"all but empty ({size})", advice)
    if dataset.driver != "VRT":
        require_small_blocks(path, dataset)
        return
    for part in set(dataset.files) - {str(path)}:
        if Path(part).suffix.lower() in {".tif", ".tiff"} and Path(part).exists():
            with quiet_open(part, "GTiff") as inner:
                require_small_blocks(path, inner)


def require_small_blocks(path: Path, dataset: rasterio.DatasetReader) -> None:
    """Refuse a file whose blocks don't fit the memory that an ingest may take."""
    rows, cols = dataset.block_shapes[0]
    together = dataset.count if dataset.profile.get("interleave") == "pixel" else 1
    block_bytes = rows * cols * np.dtype(dataset.dtypes[0]).itemsize * together
    if block_bytes > LARGEST_BLOCK_BYTES:
        advice = "write it again with gdal_translate -co TILED=YES"
        raise InputError(path, f"has blocks of {block_bytes >> 20} MiB", advice)


def quiet_open(path: str | Path, driver: str) -> rasterio.DatasetReader:
    """Open a raster, or say in one line why it can't be read."""
    try:
        with warnings.catch_warnings(), bounded():
            # `describe` refuses it, in a line of its own.
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            return rasterio.open(path, driver=driver)
    except (RasterioError, OSError) as error:
        raise unreadable(path, error) from error


def unreadable(path: str | Path, error: Exception) -> InputError:
    """Say in one line why GDAL can't read a file."""
    # rasterio's own message may only point to GDAL's, which says what is wrong.
    found = error.__cause__ or error
    reason = (str(found).splitlines() or [type(found).__name__])[0]
    reason = reason.replace(f"'{path}'", "it is").replace(str(path), "it").rstrip(".")
    advice = ADVICES.get(Path(path).suffix.lower(), "give a GeoTIFF, HGT or VRT file")
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
    transform = tuple(dataset.transform)[:6]
    require_placed(path, dataset, horizontal)
    bounds = _bounds_deg(path, horizontal, dataset)
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
        _spacing_m(horizontal, transform, (dataset.height, dataset.width), bounds),
        wraps,
    )


def _horizontal(crs: pyproj.CRS) -> pyproj.CRS:
    return crs.sub_crs_list[0] if crs.is_compound else crs


def require_placed(
    path: str | Path, dataset: rasterio.DatasetReader, crs: pyproj.CRS
) -> None:
    """Refuse a raster whose posts have no places, or span no surface.

    Raises
    ------
    InputError
    """
    a, b, _, d, e, _ = transform = tuple(dataset.transform)[:6]
    if dataset.transform.is_identity:
        reason = "has no georeference"
        if dataset.gcps[0] or dataset.rpcs:
            advice = "warp it to its control points with gdalwarp"
            raise InputError(path, reason, advice)
        raise InputError(path, reason, "write one with gdal_translate -a_ullr")
    if not np.isfinite(transform).all() or abs(a * e - b * d) < 1e-30:
        reason = "has a georeference that spans no area"
        raise InputError(path, reason, "write one with gdal_translate -a_ullr")
    if min(dataset.width, dataset.height) < 2:
        size = f"{dataset.width} x {dataset.height} posts"
        raise InputError(path, f"holds {size}, no surface", "give at least 2 x 2 posts")
    if not (crs.is_geographic or crs.is_projected):
        advice = "name another with --crs, for example --crs EPSG:4326"
        raise InputError(path, f"its CRS ({crs.name[:60]}) is no map's", advice)


def _bounds_deg(
    path: str | Path, crs: pyproj.CRS, dataset: rasterio.DatasetReader
) -> tuple[float, float, float, float]:
    a, b, c, d, e, f = tuple(dataset.transform)[:6]
    corners = [(i, j) for i in (0, dataset.width) for j in (0, dataset.height)]
    xs = [a * i + b * j + c for i, j in corners]
    ys = [d * i + e * j + f for i, j in corners]
    box = (min(xs), min(ys), max(xs), max(ys))
    advice = "check its georeference, or state another CRS with --crs"
    if is_lon_lat(crs):
        half = abs(e) / 2 + abs(d) / 2 + 1e-9
        beyond = box[1] < -90 - half or box[3] > 90 + half
        if beyond or box[2] - box[0] > 360 + 2 * abs(a) + 1e-6 or max(map(abs, box)) > 1e3:
            edges = ", ".join(f"{edge:g}" for edge in box)
            raise InputError(path, f"reaches beyond the earth ({edges} degrees)", advice)
        return box
    to_degrees = pyproj.Transformer.from_crs(crs, 4326, always_xy=True)
    try:
        found = to_degrees.transform_bounds(*box, densify_pts=41)
    except pyproj.exceptions.ProjError:
        found = (np.inf,) * 4
    if not np.isfinite(found).all():
        raise InputError(path, "reaches beyond its map projection", advice)
    west, south, east, north = found
    return west, south, east + 360 if east < west else east, north


def _spacing_m(
    crs: pyproj.CRS,
    transform: tuple[float, ...],
    shape: tuple[int, int],
    bounds_deg: tuple[float, float, float, float],
) -> float:
    """Spacing of the posts at the raster's middle: the wider of the two directions."""
    along = float(np.hypot(transform[0], transform[3]))
    across = float(np.hypot(transform[1], transform[4]))
    if not crs.is_geographic or crs.is_derived:
        stated_m = max(along, across) * crs.axis_info[0].unit_conversion_factor
        found_m = _measured_m(crs, transform, shape)
        # Web Mercator's metres are half as long at 60 degrees; UTM's are what they say.
        return found_m if abs(found_m / stated_m - 1) > 0.05 else stated_m
    middle = np.radians((bounds_deg[1] + bounds_deg[3]) / 2)
    degree_m = np.radians(1) * WGS84_A_M
    return float(max(along * degree_m * np.cos(middle), across * degree_m))


def _measured_m(
    crs: pyproj.CRS, transform: tuple[float, ...], shape: tuple[int, int]
) -> float:
    """Measure the spacing on the earth, between posts at the raster's middle, m."""
    a, b, c, d, e, f = transform
    col, row = np.array([0, 1, 0]) + shape[1] / 2, np.array([0, 0, 1]) + shape[0] / 2
    to_degrees = pyproj.Transformer.from_crs(crs, 4326, always_xy=True)
    lon, lat = to_degrees.transform(a * col + b * row + c, d * col + e * row + f)
    at = to_ecef(np.radians(lon), np.radians(lat), 0.0)
    return float(np.linalg.norm(at[1:] - at[0], axis=1).max())
