# SPDX-License-Identifier: Apache-2.0
"""Where a raster lies on the earth; what can't be placed is refused in one line."""

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pyproj
import rasterio

from ingest.map_edge import MOST_STEPS, bounds_beyond, known_places, reaches_beyond
from tiles.errors import InputError
from tiles.frames import WGS84_A_M
from tiles.geodesy import to_ecef
from tiles.placement import Box, Placement, is_lon_lat, way_to_degrees

SEAM_POSTS = 0.1
"""By so much a raster that goes round the globe may miss its start"""
MOST_LOST = 0.75
"""On a map of the whole globe as much, near the corners, may lie beyond its edge."""
LARGEST_DEG = 0.25
"""Steps of a raster in degrees are mostly smaller."""
PLACED = "write one with gdal_translate -a_ullr, or a world file beside it"


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
    is_beyond: bool = False
    """It reaches beyond the edge of its map: posts there have no place"""


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
    refuse_points(path, dataset)
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
    if is_lon_lat(horizontal):
        turns = _turns(bounds)
        transform = (*transform[:2], transform[2] - 360 * turns, *transform[3:])
        bounds = bounds[0] - 360 * turns, bounds[1], bounds[2] - 360 * turns, bounds[3]
    wraps = is_lon_lat(horizontal) and _goes_round(transform, dataset.width)
    if wraps:
        # Few digits of a pixel's size would leave a gap where the ends meet.
        transform = (math.copysign(360 / dataset.width, transform[0]), *transform[1:])
    info = RasterInfo(
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
    return _found(info)


def _found(info: RasterInfo) -> RasterInfo:
    """Look for posts where they are said to be, and for the edge of the map.

    Raises
    ------
    InputError
        When most are not there, or the map ends inside the raster's bounds.
    """
    place, shape = Placement(asdict(info)), (info.height, info.width)
    col, row = np.meshgrid(*(np.linspace(0, n - 1, 5) for n in shape[::-1]))
    columns = info.width * info.wraps
    lon, _ = known_places(place, col.ravel(), row.ravel(), columns)
    advice = "warp it to EPSG:4326 with gdalwarp"
    if np.isnan(lon).mean() > MOST_LOST:
        reason = "its CRS has no such places as its georeference gives its posts"
        raise InputError(info.path, reason, advice)
    if not place.is_projected or not reaches_beyond(place, shape):
        return info
    info = replace(info, bounds_deg=bounds_beyond(place, shape), is_beyond=True)
    west, south, east, north = np.radians(info.bounds_deg)
    around = np.meshgrid(np.linspace(west, east, 33), np.linspace(south, north, 33))
    if not np.isfinite(place.pixels(*(one.ravel() for one in around))).all():
        raise InputError(info.path, "the edge of its map crosses it", advice)
    return info


def _turns(bounds_deg: tuple[float, float, float, float]) -> int:
    """Return how often round the globe longitudes are beyond what any raster needs."""
    middle = (bounds_deg[0] + bounds_deg[2]) / 2
    return max(math.ceil((middle - 360) / 360), 0) - max(
        math.ceil((-180 - middle) / 360), 0
    )


def _goes_round(transform: tuple[float, ...], width: int) -> bool:
    """Say whether a raster's columns, in degrees, go once round the globe."""
    off = abs(abs(transform[0]) * width - 360)
    return off < SEAM_POSTS * abs(transform[0]) and not transform[3]


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
        raise InputError(path, "has no georeference", PLACED)
    if not np.isfinite(transform).all() or abs(a * e - b * d) < 1e-30:
        reason = "has a georeference that spans no area"
        raise InputError(path, reason, PLACED)
    if min(dataset.width, dataset.height) < 2:
        size = f"{dataset.width} x {dataset.height} posts"
        raise InputError(path, f"holds {size}, no surface", "give at least 2 x 2 posts")
    if not (crs.is_geographic or crs.is_projected):
        advice = "name another with --crs, for example --crs EPSG:4326"
        raise InputError(path, f"its CRS ({crs.name[:60]}) is no map's", advice)
    # A CRS of the registry has an origin where no such fine survey is.
    if crs.is_projected and _like_degrees(dataset) and crs.to_authority():
        reason = f"its CRS ({crs.name[:60]}) has no degrees, its numbers look like degrees"
        raise InputError(path, reason, "name the right one, such as --crs EPSG:4326")


def _like_degrees(dataset: rasterio.DatasetReader) -> bool:
    """Say whether a raster of small steps lies within 360 of 0, and 90 to the north."""
    turned = np.reshape(tuple(dataset.transform)[:6], (2, 3))
    col, row = np.meshgrid([0, dataset.width], [0, dataset.height])
    x, y = np.abs(turned @ np.stack([col.ravel(), row.ravel(), np.ones(4)]))
    small = np.abs(turned[:, :2]).max() <= LARGEST_DEG
    return bool(small and x.max() <= 360.0 and y.max() <= 90.0)


def refuse_points(path: str | Path, dataset: rasterio.DatasetReader) -> None:
    """Refuse a raster that only single points place, with what makes a map of it.

    Raises
    ------
    InputError
    """
    ways = {
        "ground control points": ("", dataset.gcps[0]),
        "a camera's coefficients (RPC)": ("-rpc ", dataset.rpcs),
        "a list of the places of its posts": ("-geoloc ", dataset.tags(ns="GEOLOCATION")),
    }
    for what, (option, found) in ways.items():
        if found and dataset.transform.is_identity:
            made = (
                f"gdalwarp {option}-r bilinear -t_srs EPSG:4326 {Path(path).name} new.tif"
            )
            advice = f"warp it with `{made}` and ingest that"
            raise InputError(path, f"has no georeference but {what}", advice)


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
    try:
        roughly = _bounds_by(pyproj.Transformer.from_crs(crs, 4326, always_xy=True), box)
        # Parallels are curved: between few places along a side they reach further.
        most = min(max(dataset.width, dataset.height), MOST_STEPS)
        found = _bounds_by(way_to_degrees(crs, roughly), box, most)
    except pyproj.exceptions.ProjError:
        found = (np.inf,) * 4
    if not np.isfinite(found).all():
        raise InputError(path, "reaches beyond its map projection", advice)
    return found


def _bounds_by(way: pyproj.Transformer, box: Box, places: int = 21) -> Box:
    west, south, east, north = way.transform_bounds(*box, densify_pts=places)
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
