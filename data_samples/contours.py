# SPDX-License-Identifier: Apache-2.0
"""A smooth surface through contour lines: thin plate, fitted block by block.

The surface minimises (misfit at points along the contours)^2 + bending, so a contour
need not pass through a cell's centre, and hilltops and valley floors curve on instead
of ending in a terrace. It's then held inside the band of its two contours.
"""

from dataclasses import dataclass

import numpy as np
import rasterio.features
import shapely
from mvt import TileSet
from numpy.typing import NDArray
from pyproj import Transformer
from rasterio.transform import Affine
from scipy import ndimage, sparse
from scipy.sparse.linalg import spsolve

Array = NDArray[np.float64]
BENDING = 0.03
STRETCH = 1e-4
BLOCK, OVERLAP = 200, 24


@dataclass(frozen=True)
class Lines:
    """Points along the contours: grid columns and rows (cell centres whole), metres."""

    column: Array
    row: Array
    height: Array


def contour_lines(tiles: TileSet) -> list[tuple[shapely.Geometry, float]]:
    """Contours as lines in world pixels: the areas' edges inside each tile's square."""
    lines = []
    for feature in tiles.features("contour", cut=False):
        square = tiles.square(feature.tile)
        line = feature.geometry.boundary.intersection(square)
        if not line.is_empty:
            lines.append((line, float(feature.properties["ele"])))
    return lines


def sample_lines(tiles: TileSet, crs: str, transform: Affine, every_px: float) -> Lines:
    """Points along all contours in grid coordinates."""
    points, heights = [], []
    for line, height in contour_lines(tiles):
        dense = shapely.get_coordinates(shapely.segmentize(line, every_px))
        points.append(dense)
        heights.append(np.full(len(dense), height))
    lon_lat = tiles.to_lon_lat(np.concatenate(points))
    to_grid = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    x, y = to_grid.transform(lon_lat[:, 0], lon_lat[:, 1])
    column, row = ~transform * (np.asarray(x), np.asarray(y))
    return Lines(column - 0.5, row - 0.5, np.concatenate(heights))


def bands(
    tiles: TileSet, crs: str, transform: Affine, size: tuple[int, int]
) -> tuple[Array, NDArray[np.bool_]]:
    """Height of the highest contour at or below each cell (0 for none), and coverage."""
    to_grid = Transformer.from_crs("EPSG:4326", crs, always_xy=True)

    def project(xy: Array) -> Array:
        lon_lat = tiles.to_lon_lat(xy)
        return np.column_stack(to_grid.transform(lon_lat[:, 0], lon_lat[:, 1]))

    found = sorted(tiles.features("contour"), key=lambda f: float(f.properties["ele"]))
    shapes = [
        (shapely.transform(f.geometry, project), float(f.properties["ele"])) for f in found
    ]
    band = rasterio.features.rasterize(
        shapes, size, 0.0, transform=transform, dtype="float64"
    )
    squares = [
        shapely.transform(shapely.segmentize(tiles.square(t), 512.0), project)
        for t in tiles.layers
    ]
    # one area, a little grown, so that no cell falls between two tiles
    whole = shapely.union_all(
        [s.buffer(1e-6 * max(1.0, abs(transform.e))) for s in squares]
    )
    covered = rasterio.features.rasterize([whole], size, 0, transform=transform)
    return np.asarray(band), covered.astype(bool)


def differences(rows: int, columns: int) -> sparse.csr_matrix:
    """Roughness matrix: u' R u = bending + a little stretching of the grid u."""

    def along(n: int, taps: tuple[float, ...]) -> sparse.csr_matrix:
        count = n - len(taps) + 1
        return sparse.diags(taps, range(len(taps)), shape=(count, n)).tocsr()

    row_1, row_2 = along(rows, (-1.0, 1.0)), along(rows, (1.0, -2.0, 1.0))
    col_1, col_2 = along(columns, (-1.0, 1.0)), along(columns, (1.0, -2.0, 1.0))
    eye_r, eye_c = sparse.identity(rows), sparse.identity(columns)
    total = None
    for matrix, weight in (
        (sparse.kron(row_2, eye_c), BENDING),
        (sparse.kron(eye_r, col_2), BENDING),
        (sparse.kron(row_1, col_1), 2.0 * BENDING),
        (sparse.kron(row_1, eye_c), STRETCH),
        (sparse.kron(eye_r, col_1), STRETCH),
    ):
        part = weight * (matrix.T @ matrix)
        total = part if total is None else total + part
    return total


def fit_block(lines: Lines, row0: int, col0: int, rows: int, columns: int) -> Array:
    """Heights (rows, columns) of the block whose first cell is (row0, col0)."""
    row, column = lines.row - row0, lines.column - col0
    inside = (row >= 0) & (row <= rows - 1) & (column >= 0) & (column <= columns - 1)
    row, column, height = row[inside], column[inside], lines.height[inside]
    if len(height) == 0:
        return np.full((rows, columns), np.nan)
    r = np.minimum(row.astype(int), rows - 2)
    c = np.minimum(column.astype(int), columns - 2)
    fr, fc = row - r, column - c
    index = np.arange(len(height))
    entries = [
        ((1 - fr) * (1 - fc), r * columns + c),
        ((1 - fr) * fc, r * columns + c + 1),
        (fr * (1 - fc), (r + 1) * columns + c),
        (fr * fc, (r + 1) * columns + c + 1),
    ]
    fit = sparse.csr_matrix(
        (
            np.concatenate([w for w, _ in entries]),
            (np.tile(index, 4), np.concatenate([k for _, k in entries])),
        ),
        shape=(len(height), rows * columns),
    )
    normal = (fit.T @ fit + differences(rows, columns)).tocsc()
    mean = float(height.mean())
    solved = spsolve(normal, fit.T @ (height - mean), permc_spec="MMD_AT_PLUS_A")
    return np.asarray(solved).reshape(rows, columns) + mean


def surface(lines: Lines, size: tuple[int, int]) -> Array:
    """Return the whole surface: overlapping blocks joined with smooth weights."""
    total, weight = np.zeros(size), np.zeros(size)
    for row0 in range(0, size[0], BLOCK):
        for col0 in range(0, size[1], BLOCK):
            top, left = max(row0 - OVERLAP, 0), max(col0 - OVERLAP, 0)
            bottom = min(row0 + BLOCK + OVERLAP, size[0])
            right = min(col0 + BLOCK + OVERLAP, size[1])
            part = fit_block(lines, top, left, bottom - top, right - left)
            ramp = np.outer(ramp_of(bottom - top), ramp_of(right - left))
            ramp = np.where(np.isnan(part), 0.0, ramp)
            total[top:bottom, left:right] += np.nan_to_num(part) * ramp
            weight[top:bottom, left:right] += ramp
    return np.asarray(np.where(weight > 0, total / np.maximum(weight, 1e-12), np.nan))


def ramp_of(count: int) -> Array:
    """Weights along a block's side: small at its ends, one inside."""
    to_end = np.minimum(np.arange(count), np.arange(count)[::-1]) + 0.5
    return np.clip(to_end / (2.0 * OVERLAP), 0.01, 1.0) ** 2


def contour_dem(
    tiles: TileSet, crs: str, transform: Affine, size: tuple[int, int], interval_m: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Elevations (rows, columns) in metres and the cells inside the tiles."""
    lines = sample_lines(tiles, crs, transform, 12.0)
    heights = surface(lines, size)
    band, covered = bands(tiles, crs, transform, size)
    # a cell's centre may lie a cell off its band where lines crowd, so bands are widened
    low = ndimage.minimum_filter(band, 3)
    high = ndimage.maximum_filter(band, 3) + interval_m
    held = np.clip(heights, np.where(low > 0, low, -5.0), high)
    return held, covered & ~np.isnan(heights)
