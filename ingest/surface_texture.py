# SPDX-License-Identifier: Apache-2.0
"""What a terrain tile looks like: picture or height tint, with relief shading baked in."""

import numpy as np
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.terrain_mesh import lattice_places
from tiles import cells, geodesy
from tiles.frames import WGS84_A_M, Floats
from tiles.kernels import kernel
from tiles.terrain import TEXTURE_SIDE

TINT_M = np.array(
    [-8000.0, -4000, -200, 0.2, 1.5, 150, 600, 1500, 2600, 3800, 5000, 5600, 8900]
)
"""The sea's colours reach up to where an elevation model that knows no sea says 0."""
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
COARSE_M, COARSE_SHARE = 1000.0, 0.75
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
    steeper = 1.0 + 1.5 * float(np.clip(np.log10(max(texel_m, 1.0) / 100.0), 0.0, 2.5))
    picture = np.zeros((TEXTURE_SIDE, TEXTURE_SIDE, 3), np.float32)
    share = np.zeros((TEXTURE_SIDE, TEXTURE_SIDE), np.float32)
    for layer in pictures:
        found = layer.colours(lon.ravel(), lat.ravel(), texel_m).reshape(*lon.shape, 3)
        there = np.isfinite(found[..., 0])
        picture[there] = found[there]
        share[there] = COARSE_SHARE if layer.spacing_m > COARSE_M else 1.0
    inner = np.ascontiguousarray(elevation_m[1:-1, 1:-1])
    return _shade(_normals(cell, height_m), inner, picture, share, steeper)


def _texel_places(cell: int) -> tuple[Floats, Floats]:
    west, south, east, north = cells.bounds_rad(cell)
    middle = (np.arange(TEXTURE_SIDE) + 0.5) / TEXTURE_SIDE
    lon, lat = np.meshgrid(west + middle * (east - west), south + middle * (north - south))
    return lon, lat


def _normals(cell: int, height_m: Floats) -> Floats:
    """Return unit normals in east-north-up of the inner posts, (n + 1, n + 1, 3)."""
    side = height_m.shape[0] - 3
    lon, lat = lattice_places(cell, side)
    step = np.ptp(lon[0]) / side
    metres = step * WGS84_A_M
    width = metres * np.maximum(np.cos(lat), 1e-3)
    east = (height_m[1:-1, 2:] - height_m[1:-1, :-2]) / (2 * width)
    north = (height_m[2:, 1:-1] - height_m[:-2, 1:-1]) / (2 * metres)
    normal = np.stack([-east, -north, np.ones_like(east)], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


@kernel
def _shade(
    normal: Floats,
    elevation_m: Floats,
    picture: NDArray[np.float32],
    share: NDArray[np.float32],
    steeper: float,
) -> NDArray[np.float32]:
    """Paint every texel: height tint, rock where it is steep, picture, relief.

    Parameters
    ----------
    normal, elevation_m : (m, m, 3) and (m, m) at the posts, row 0 south
    picture, share : (256, 256, 3) and (256, 256), how much of the picture counts
    steeper : exaggeration of slopes in the relief, for coarse tiles
    """
    side = elevation_m.shape[0] - 1
    size = picture.shape[0]
    out = np.empty_like(picture)
    bent = np.empty(3)
    for y in range(size):
        v = (y + 0.5) / size * side
        r = min(int(v), side - 1)
        fy = v - r
        for x in range(size):
            u = (x + 0.5) / size * side
            c = min(int(u), side - 1)
            fx = u - c
            w00, w01 = (1 - fx) * (1 - fy), fx * (1 - fy)
            w10, w11 = (1 - fx) * fy, fx * fy
            for k in range(3):
                south = w00 * normal[r, c, k] + w01 * normal[r, c + 1, k]
                bent[k] = south + w10 * normal[r + 1, c, k] + w11 * normal[r + 1, c + 1, k]
            height = w00 * elevation_m[r, c] + w01 * elevation_m[r, c + 1]
            height += w10 * elevation_m[r + 1, c] + w11 * elevation_m[r + 1, c + 1]
            rock = min(max((0.86 - bent[2]) / 0.25, 0.0), 0.8) if height > 0 else 0.0
            light = _light(bent, steeper)
            step = 1
            while step < len(TINT_M) - 1 and height > TINT_M[step]:
                step += 1
            part = (height - TINT_M[step - 1]) / (TINT_M[step] - TINT_M[step - 1])
            part = min(max(part, 0.0), 1.0)
            for k in range(3):
                tint = TINT_RGB[step - 1, k] + part * (
                    TINT_RGB[step, k] - TINT_RGB[step - 1, k]
                )
                tint += rock * (ROCK_RGB[k] - tint)
                colour = tint + share[y, x] * (picture[y, x, k] - tint)
                out[y, x, k] = min(max(colour * light, 0.0), 255.0)
    return out


@kernel
def _light(normal: Floats, steeper: float) -> float:
    """Brightness of a slope: 1 on the flat."""
    east, north = normal[0] * steeper, normal[1] * steeper
    length = np.sqrt(east * east + north * north + normal[2] * normal[2])
    along = east * LIGHT[0] + north * LIGHT[1] + normal[2] * LIGHT[2]
    return float(0.42 + 0.58 * max(along / length, 0.0) / LIGHT[2])
