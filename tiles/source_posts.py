# SPDX-License-Identifier: Apache-2.0
"""The finest source surface, straight from the posts that the sources brought.

The surface of a source is its own posts, joined by flat triangles in ECEF; the diagonal
of each square of posts runs from (row, column) to (row + 1, column + 1). Where sources
overlap, the finest that has data wins. Nothing here is shared with the ingest, so what
is measured against these posts is measured against the sources, not against ourselves.

A raster that goes round the globe up to half a post from a pole is closed there by one
more row: the pole, at the mean height of the row beside it.
"""

import tempfile
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pyproj
from numpy.typing import NDArray

from tiles.frames import WGS84_A_M, WGS84_E2, Floats, Ints
from tiles.geodesy import to_ecef
from tiles.placement import is_lon_lat, way_to_degrees
from tiles.raster_blocks import BLOCK, Blocks
from tiles.store import Store

MEMORY_BYTES = 2 << 30
"""More posts than fit into this lie in a temporary file."""
POLAR_DEG = 89.9999
SMOOTH_M = 16e3
"""Between places this far apart, a cubic is within 1e-5 m of a projection."""
STEPS = (64, 32, 16, 8)
"""Posts between known places, a multiple of a chunk's side."""
FIRST, ROWS, COLS, WRAPS, STEP, TABLE, PLACE_COLS, PLACE_ROWS = range(8)
Source = dict[str, Any]
Progress = Callable[[int], None]


class Rasters(NamedTuple):
    """Posts of all sources, finest source first, as kernels want them."""

    height_m: NDArray[np.float32]
    """(n,) above the ellipsoid, source by source, row by row, NaN no data"""
    shape: Ints
    """(sources, 8) first post, rows, columns, goes round, posts between places (0: the
    table holds rows and columns), first line of the table, columns and rows of places"""
    table: Floats
    """(m, 4) per row: x/cos(lon), cos(lat), z, sin(lat); per column: cos(lon), sin(lon);
    or places on the ellipsoid in ECEF m"""
    reach_m: Floats
    """(sources,) how far outside its posts a source bends the coarser surface"""


def terrain_sources(store: Store) -> list[Source]:
    """Return the sources of heights, finest first; of two alike the later one first."""
    latest_first = store.sources("terrain")[::-1]
    return sorted(latest_first, key=lambda source: float(source["spacing_m"]))


def read_rasters(store: Store, progress: Progress = lambda done: None) -> Rasters:
    """Read all posts of a store.

    Parameters
    ----------
    progress : takes the number of posts read so far
    """
    sources = terrain_sources(store)
    caps = [_caps(source) for source in sources]
    rows = [int(s["height"]) + sum(cap) for s, cap in zip(sources, caps, strict=True)]
    counts = [n * int(s["width"]) for s, n in zip(sources, rows, strict=True)]
    firsts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    heights = _room(int(firsts[-1]))
    shape, tables, lines = np.zeros((len(sources), 8), np.int64), [], 0
    for k, source in enumerate(sources):
        table, about = _table(source, caps[k], rows[k])
        wraps = int(source["wraps"])
        shape[k] = firsts[k], rows[k], source["width"], wraps, about[0], lines, *about[1:]
        tables.append(table)
        lines += len(table)
        part = heights[firsts[k] : firsts[k + 1]].reshape(rows[k], -1)
        for done in _fill(store, source, caps[k], part):
            progress(int(firsts[k]) + done)
    reach = np.array([float(source.get("reach_m", 0.0)) for source in sources])
    return Rasters(heights, shape, np.concatenate([np.zeros((0, 4)), *tables]), reach)


def _room(count: int) -> NDArray[np.float32]:
    if count * 4 <= MEMORY_BYTES:
        return np.empty(count, np.float32)
    with tempfile.TemporaryFile() as file:
        return np.asarray(np.memmap(file, np.float32, "w+", shape=(count,)))


def _fill(
    store: Store, source: Source, caps: tuple[int, int], out: NDArray[np.float32]
) -> Iterator[int]:
    """Read one source's posts, strip by strip; gives the number read so far."""
    height, width = int(source["height"]), int(source["width"])
    blocks = Blocks(store.connection, str(source["blocks"]), (height, width))
    for top in range(0, height, BLOCK):
        bottom = min(top + BLOCK, height)
        out[caps[0] + top : caps[0] + bottom] = blocks.window(0, top, bottom, 0, width)
        yield bottom * width
    for row, beside in ((0, 1), (-1, -2)):
        if caps[row]:
            known = out[beside][np.isfinite(out[beside])].astype(np.float64)
            out[row] = known.mean() if len(known) else np.nan


def _caps(source: Source) -> tuple[int, int]:
    """Say if a row of pole is missing before the first row and after the last."""
    if not source["wraps"]:
        return 0, 0
    step, north = source["transform"][4], source["transform"][5]
    edges = north, north + step * int(source["height"])
    first, last = (abs(edge) > POLAR_DEG for edge in edges)
    return int(first), int(last)


def _table(
    source: Source, caps: tuple[int, int], rows: int
) -> tuple[Floats, tuple[int, int, int]]:
    """Return what places a source's posts: the table, and a line of `shape`'s end."""
    a, b, _, d, _, _ = source["transform"]
    width = int(source["width"])
    crs = pyproj.CRS.from_user_input(source["crs"])
    if is_lon_lat(crs) and b == d == 0.0 and a:
        lon, _ = _lon_lat(source, np.arange(width), np.zeros(width))
        _, lat = _lon_lat(source, np.zeros(rows), np.arange(rows) - caps[0])
        return _circles(lon, lat), (0, 0, 0)
    for step in STEPS:
        places = _places(source, step)
        if places is not None:
            return places
    cols_, rows_ = np.meshgrid(np.arange(width), np.arange(rows))
    return _feet(source, cols_, rows_), (1, width, rows)


def _circles(lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Return the parallels and then the meridians of a raster, (rows + columns, 4)."""
    sin, cos = np.sin(lat_rad), np.cos(lat_rad)
    # A post at the pole is one place, whatever its column.
    cos[np.abs(lat_rad) >= np.pi / 2 - 1e-12] = 0.0
    normal_m = WGS84_A_M / np.sqrt(1.0 - WGS84_E2 * sin**2)
    by_row = np.stack([normal_m * cos, cos, normal_m * (1.0 - WGS84_E2) * sin, sin], axis=1)
    zero = np.zeros(len(lon_rad))
    return np.concatenate(
        [by_row, np.stack([np.cos(lon_rad), np.sin(lon_rad), zero, zero], axis=1)]
    )


def _places(source: Source, step: int) -> tuple[Floats, tuple[int, int, int]] | None:
    """Return places at every `step`-th post, or None when a cubic would not do."""
    height, width = int(source["height"]), int(source["width"])
    cols, rows = (-(-(n - 1) // step) + 1 for n in (width, height))
    if step * float(source["spacing_m"]) > SMOOTH_M or min(cols, rows) < 4:
        return None
    col, row = np.meshgrid(np.arange(cols) * step, np.arange(rows) * step)
    feet = _feet(source, col, row)
    return (feet, (step, cols, rows)) if np.isfinite(feet).all() else None


def _feet(source: Source, col: NDArray[Any], row: NDArray[Any]) -> Floats:
    """Return where posts are on the ellipsoid, (n, 4) ECEF m and a zero."""
    places = _lon_lat(source, col.ravel().astype(float), row.ravel().astype(float))
    feet = to_ecef(*places, 0.0)
    return np.concatenate([feet, np.zeros((len(feet), 1))], axis=1)


def _lon_lat(source: Source, col: NDArray[Any], row: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return longitude and latitude of posts, radians; latitudes end at the poles."""
    a, b, c, d, e, f = source["transform"]
    x = a * (col + 0.5) + b * (row + 0.5) + c
    y = d * (col + 0.5) + e * (row + 0.5) + f
    crs = pyproj.CRS.from_user_input(source["crs"])
    if not is_lon_lat(crs):
        x, y = way_to_degrees(crs, tuple(source["bounds_deg"])).transform(x, y)
    return np.radians(x), np.radians(np.clip(y, -90.0, 90.0))
