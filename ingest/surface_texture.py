# SPDX-License-Identifier: Apache-2.0
"""What a terrain tile looks like: picture or height tint, with relief shading baked in."""

import numpy as np
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.terrain_mesh import lattice_places
from tiles import cells, geodesy
from tiles.frames import Floats
from tiles.terrain import TEXTURE_SIDE

TINT_M = np.array([-8000, -4000, -200, -1, 0, 150, 600, 1500, 2600, 3800, 5000, 5600, 8900])
TINT_RGB = np.array(
    [
        (20, 42, 84),
        (30, 62, 112),
        (52, 98, 148),
        (88, 138, 172),
        (122, 140, 100),
        (110, 132, 86),
        (138, 140, 94),
        (150, 136, 104),
        (136, 122, 102),
        (132, 124, 114),
        (168, 164, 160),
        (232, 236, 242),
        (248, 250, 252),
    ],
    np.float32,
)
LIGHT = np.array([-0.5, 0.5, 0.70710678])
"""Towards the light, east-north-up: north-west, 45 degrees high, as maps are lit."""
PICTURE_SHARE = 0.75
"""A picture of the whole earth is far coarser than the relief under it: a quarter of the
height tint keeps valleys and summits apart. The same at every level, so no seam shows."""
ROCK_RGB = np.array([122, 112, 102], np.float32)


def colours(
    cell: int, height_m: Floats, elevation_m: Floats, pictures: list[Layer]
) -> NDArray[np.float32]:
    """Paint a cell.

    Parameters
    ----------
    height_m : (n + 3, n + 3) float64, posts of the cell with one more all round
    elevation_m : the same posts above sea level
    pictures : coarsest first; the finest that covers a texel wins

    Returns
    -------
    (256, 256, 3) float32, sRGB 0..255, row 0 south
    """
    lon, lat = _texel_places(cell)
    texel_m = float(geodesy.cell_edge_m(cell)) / TEXTURE_SIDE
    slope = _normals(cell, height_m)
    normal = _enlarge(slope)
    tint = _tint(_enlarge(elevation_m[1:-1, 1:-1, None])[..., 0], normal)
    paint = tint
    for layer in pictures:
        found = layer.colours(lon.ravel(), lat.ravel(), texel_m).reshape(*lon.shape, 3)
        share = np.where(np.isnan(found).any(axis=-1, keepdims=True), 0.0, PICTURE_SHARE)
        paint = paint + share * (np.nan_to_num(found) - paint)
    return np.asarray(
        np.clip(paint * _relief(normal, texel_m)[..., None], 0, 255), np.float32
    )


def _texel_places(cell: int) -> tuple[Floats, Floats]:
    west, south, east, north = cells.bounds_rad(cell)
    middle = (np.arange(TEXTURE_SIDE) + 0.5) / TEXTURE_SIDE
    lon, lat = np.meshgrid(west + middle * (east - west), south + middle * (north - south))
    return lon, lat


def _normals(cell: int, height_m: Floats) -> Floats:
    """Unit normals in east-north-up of the inner posts, (n + 1, n + 1, 3)."""
    side = height_m.shape[0] - 3
    lon, lat = lattice_places(cell, side)
    step = np.ptp(lon[0]) / side
    metres = step * geodesy.WGS84_A_M
    width = metres * np.maximum(np.cos(lat), 1e-3)
    east = (height_m[1:-1, 2:] - height_m[1:-1, :-2]) / (2 * width)
    north = (height_m[2:, 1:-1] - height_m[:-2, 1:-1]) / (2 * metres)
    normal = np.stack([-east, -north, np.ones_like(east)], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def _enlarge(values: Floats) -> Floats:
    """Interpolate post values, (m, m, k), to texel centres, (256, 256, k)."""
    if values.shape[0] % 2 == 0:
        raise ValueError(f"expected an odd number of posts, got {values.shape[0]}")
    side = values.shape[0] - 1
    at = (np.arange(TEXTURE_SIDE) + 0.5) / TEXTURE_SIDE * side
    low = np.minimum(at.astype(np.int64), side - 1)
    part = (at - low)[:, None, None]
    rows = values[low] * (1 - part) + values[low + 1] * part
    part = (at - low)[None, :, None]
    return np.asarray(rows[:, low] * (1 - part) + rows[:, low + 1] * part)


def _tint(elevation_m: Floats, normal: Floats) -> Floats:
    """Height tint; steep land turns to rock."""
    ramp = [np.interp(elevation_m, TINT_M, TINT_RGB[:, k]) for k in range(3)]
    steep = np.clip((0.86 - normal[..., 2]) / 0.25, 0, 1) * (elevation_m > 0)
    tint = np.stack(ramp, axis=-1)
    return np.asarray(tint + steep[..., None] * 0.8 * (ROCK_RGB - tint))


def _relief(normal: Floats, texel_m: float) -> Floats:
    """Brightness of a slope: 1 on the flat; slopes of coarse tiles are exaggerated."""
    steeper = 1.0 + 1.5 * np.clip(np.log10(max(texel_m, 1.0) / 100.0), 0.0, 2.5)
    tilted = normal * np.array([steeper, steeper, 1.0])
    tilted /= np.linalg.norm(tilted, axis=-1, keepdims=True)
    shade = np.clip(tilted @ LIGHT, 0.0, 1.0) / LIGHT[2]
    return np.asarray(0.42 + 0.58 * shade)
