# SPDX-License-Identifier: Apache-2.0
"""Small rasters for the tests, and what they say, computed without `ingest`."""

import sqlite3
from dataclasses import replace
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

from ingest.deviation import Gaps, Window
from ingest.mosaic import Mosaic
from ingest.terrain import RasterOptions, editing, ingest_rasters, plan
from ingest.terrain import copy as copy_source
from ingest.terrain_mesh import CORNERS, Meshing, Places, Surface
from ingest.truth import Truth
from tiles import cells, geodesy
from tiles.mesh import UV_ONE
from tiles.samples import SAMPLES

Floats = NDArray[np.float64]

WEST, NORTH, STEP = 10.6, 46.7, 0.02
"""North-west corner and spacing of the coarse raster, degrees"""
SIDE = 60
UTM = "EPSG:32632"
INSET_STEP_M = 200.0
EGM96 = RasterOptions(datum="egm96")
ELLIPSOID = RasterOptions(datum="ellipsoid")


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
        middle = c + a * dataset.width / 2 + b * dataset.height / 2
        turns = dataset.crs.is_geographic * np.round((middle - lon_deg) / 360)
    x, y = to_file.transform(lon_deg + 360 * turns, lat_deg)
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
    east = box[2] + 360 if box[2] < box[0] else box[2]
    lon, lat = (
        rng.uniform(box[0], east, 4 * count),
        rng.uniform(box[1], box[3], 4 * count),
    )
    known = np.flatnonzero(np.isfinite(source_height_m(path, lon, lat)))[:count]
    assert len(known) == count
    return lon[known], lat[known]


def post_places_deg(path: Path) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes of a file's posts, (h, w) each."""
    with rasterio.open(path) as dataset:
        back = pyproj.Transformer.from_crs(dataset.crs, 4326, always_xy=True)
        col, row = np.meshgrid(np.arange(dataset.width), np.arange(dataset.height))
        a, b, c, d, e, f = tuple(dataset.transform)[:6]
        col, row = col + 0.5, row + 0.5
        x, y = a * col + b * row + c, d * col + e * row + f
    lon, lat = back.transform(x.ravel(), y.ravel())
    return lon.reshape(col.shape), lat.reshape(col.shape)


def posts_m(path: Path, *, egm96: bool) -> Floats:
    """Return heights of a file's posts above the ellipsoid, NaN at no data, (h, w)."""
    with rasterio.open(path) as dataset:
        posts = dataset.read(1).astype(np.float64)
        posts[dataset.read_masks(1) == 0] = np.nan
    return posts + geoid_m(*post_places_deg(path)) if egm96 else posts


def ecef(lon_deg: Floats, lat_deg: Floats, height_m: Floats) -> Floats:
    """Return (n, 3) m by PROJ."""
    to_ecef = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    return np.stack(to_ecef.transform(lon_deg, lat_deg, height_m), axis=-1)


def own_surface_m(path: Path, lon_deg: Floats, lat_deg: Floats, *, egm96: bool) -> Floats:
    """Return heights above the ellipsoid of a file's triangles, the datum at its posts.

    NaN outside and at no data; a file that goes round the globe has no outside there.
    """
    posts = posts_m(path, egm96=egm96)
    col, row = pixels(path, lon_deg, lat_deg)
    with rasterio.open(path) as dataset:
        if dataset.crs.is_geographic and abs(dataset.transform.a) * dataset.width == 360:
            posts = np.concatenate([posts, posts[:, :1]], axis=1)
            col = col % dataset.width
    return between(posts, col, row)


def between(posts: Floats, col: Floats, row: Floats) -> Floats:
    """Interpolate posts in triangles, diagonals to larger row and column."""
    last = np.array(posts.shape) - 1
    inside = (col >= 0) & (row >= 0) & (col <= last[1]) & (row <= last[0])
    c = np.where(inside, np.minimum(np.floor(col), last[1] - 1), 0).astype(int)
    r = np.where(inside, np.minimum(np.floor(row), last[0] - 1), 0).astype(int)
    fx, fy = col - c, row - r
    nw, ne, sw, se = posts[r, c], posts[r, c + 1], posts[r + 1, c], posts[r + 1, c + 1]
    upper, lower = (1 - fx) * nw + (fx - fy) * ne, (1 - fy) * nw + (fy - fx) * sw
    found = np.where(fx > fy, upper + fy * se, lower + fx * se)
    return np.asarray(np.where(inside, found, np.nan))


def mosaic_of(
    store: Path, files: list[tuple[Path, RasterOptions]]
) -> tuple[Mosaic, sqlite3.Connection]:
    """Copy files into a new store and open them as one surface; close the connection."""
    with editing(store) as writer:
        quiet = lambda done, total, what: None  # noqa: E731
        sources = [copy_source(writer, plan(*one), quiet) for one in files]
    connection = sqlite3.connect(store)
    return Mosaic(connection, sources), connection


def leaf_at(lon_deg: float, lat_deg: float, spacing_m: float, side: int = 90) -> int:
    """Return the largest cell at a place whose edge is no more than `side` posts."""
    for level in range(29):
        cell = int(cells.cell_at(np.radians(lon_deg), np.radians(lat_deg), level))
        if float(geodesy.cell_edge_m(cell)) <= side * spacing_m * 1.001:
            return cell
    raise AssertionError


def places_deg(cell: int, uv: Floats) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes of fractions (n, 2) of a cell."""
    west, south, east, north = cells.bounds_rad(cell)
    lon, lat = west + uv[:, 0] * (east - west), south + uv[:, 1] * (north - south)
    return np.degrees(lon), np.degrees(lat)


def lattice_of(cell: int, height_m: Floats) -> Places:
    """Return a square of posts over a cell, row 0 south, as places of a mesh."""
    steps = np.linspace(0, 1, len(height_m))
    uv = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    points = geodesy.to_ecef(*np.radians(places_deg(cell, uv)), height_m.ravel())
    first = np.abs(uv[:, None] - CORNERS).sum(axis=-1).argmin(axis=0)
    order = np.concatenate([first, np.setdiff1d(np.arange(len(uv)), first)])
    return Places.of(np.rint(uv[order] * UV_ONE).astype(np.int64), points[order])


def whole_surface(cell: int, places: Places) -> Surface:
    """Mesh a cell with all places as vertices."""
    meshing = Meshing(cell, places)
    meshing.refine_wholly()
    return meshing.surface()


def drawn(surface: Surface, uv: Floats) -> Floats:
    """Return points of a surface's triangles at fractions of its cell, by brute force.

    ECEF; NaN where no triangle lies.
    """
    out = np.full((len(uv), 3), np.nan)
    corner = surface.uv[surface.triangles]
    low, high = corner.min(axis=1) - 1e-9, corner.max(axis=1) + 1e-9
    a, b, c = np.moveaxis(corner, 1, 0)
    for first in range(0, len(uv), 500):
        at = uv[first : first + 500, None]
        near = (at[..., 0] >= low[:, 0]) & (at[..., 0] <= high[:, 0])
        near &= (at[..., 1] >= low[:, 1]) & (at[..., 1] <= high[:, 1])
        i, t = np.nonzero(near)
        sides = np.stack([b[t] - a[t], c[t] - a[t]], axis=-1)
        weights = np.linalg.solve(sides, (at[i, 0] - a[t])[..., None])[..., 0]
        weights = np.column_stack([1 - weights.sum(axis=1), weights])
        inside = (weights >= -1e-9).all(axis=1)
        i, t, weights = i[inside], t[inside], weights[inside]
        points = surface.points[surface.triangles[t]]
        out[first + i] = (weights[..., None] * points).sum(axis=1)
    return out + surface.mesh.centre


@cache
def nested(base: Path) -> Path:
    """Return a folder with coarse.tif, inset.tif and the bare store of both; read only."""
    folder = base / "nested"
    folder.mkdir()
    files = [coarse(folder / "coarse.tif"), inset(folder / "inset.tif")]
    ingest_rasters(folder / "world.geopage", [(f, EGM96) for f in files], workers=1)
    return folder


def build_surface(cell: int, places: Places, bound_m: float) -> Surface:
    """Triangulate a cell within a bound and add the skirt.

    Parameters
    ----------
    bound_m : largest distance of a place from its triangle, rounding included
    """
    meshing = Meshing(cell, places)
    meshing.refine(bound_m)
    return meshing.surface()


def deviation_of(
    surface: Surface, window: Window, truth: Truth, *, upright: bool = False
) -> Gaps:
    """Measure all of a surface against the truth of a leaf in its cell.

    Parameters
    ----------
    upright : measure along the vertical instead of the shortest way
    """
    gaps = Gaps.begin(surface)
    gaps.add(
        replace(surface, fresh=np.ones_like(surface.fresh)), window, truth, upright=upright
    )
    return gaps
