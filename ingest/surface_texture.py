# SPDX-License-Identifier: Apache-2.0
"""What a terrain tile looks like: picture or height tint, with relief shading baked in."""

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edge_m, overlap
from ingest.drape import FINE, SHARE, drape
from ingest.layer import Layer
from ingest.tints import (
    DARKER,
    ONE,
    SHORE_M,
    WHITE,
    ZERO,
    kept_of,
    light_of,
    snow_line_m,
    step_of,
    tint_of,
)
from tiles.frames import Floats
from tiles.kernels import inlined, kernel, summing
from tiles.terrain import TEXTURE_SIDE

Rows = NDArray[np.float32]
NO_PICTURE = np.zeros((0, 0, FINE + 4), np.float32)
FINER, RELIEF_TEXELS = 0.7, 1.998
LEAST = np.float32(1e-3)
FLAT_M = 0.5
"""Ground whose posts differ by less shows no relief at any level."""


def colours(
    cell: int,
    slopes: Floats,
    elevation_m: Floats,
    pictures: list[Layer],
    knows: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Paint a cell.

    Parameters
    ----------
    slopes : (n + 1, n + 1, 3) float64, of `slopes_of` at posts of the cell
    elevation_m : (n + 1, n + 1) float64, the same posts above sea level
    pictures : coarsest first; the finest that covers a texel wins
    knows : (n + 1, n + 1) float32, of `coast_of`

    Returns
    -------
    (256, 256, 3) float32, sRGB 0..255, row 0 south
    """
    posts, shown = _posts(slopes, elevation_m, knows), pictures_on(cell, pictures)
    picture = drape(cell, shown) if shown else NO_PICTURE
    snow_m = snow_line_m(cell, posts.shape[1])
    lit, is_shore = _lit(posts, snow_m)
    out = np.empty((TEXTURE_SIDE, TEXTURE_SIDE, 3), np.float32)
    if not shown:
        _spread(lit, out)
    if shown or is_shore.any():
        _paint(posts, is_shore | bool(shown), picture, snow_m, out)
    return out


def pictures_on(cell: int, pictures: list[Layer]) -> list[Layer]:
    """Return the pictures whose boxes meet a cell."""
    return [one for one in pictures if overlap(cell, one.bounds_deg)]


def texel_m_of(
    cell: int, elevation_m: Floats, terrain: list[Layer], pictures: list[Layer]
) -> float:
    """Return the size of a cell's texels, or 0 where the cells below it show no more.

    They do where a picture is clearly finer than the texels, or an elevation model than
    the posts that this cell's relief is made from (two texels apart), unless all is flat.

    Parameters
    ----------
    elevation_m : posts of the cell above sea level
    terrain : elevation models that hold posts in the cell
    pictures : all of them
    """
    texel_m = edge_m(cell) / TEXTURE_SIDE
    shown = pictures_on(cell, pictures)
    finer = any(p.spacing_m < FINER * texel_m for p in shown)
    if np.ptp(elevation_m) > FLAT_M:
        finer |= any(one.spacing_m < RELIEF_TEXELS * texel_m for one in terrain)
    return texel_m if finer else 0.0


@kernel
def _posts(slopes: Floats, elevation_m: Floats, knows: Rows) -> Rows:
    """Return the posts' normals, elevations, and `knows`.

    Returns
    -------
    (5, n + 1, n + 1) float32: a normal's exaggerated parts to the east and north, and its
    true part upwards; elevation; `knows`
    """
    side = len(slopes)
    out = np.empty((5, side, side), np.float32)
    for r in range(side):
        for c in range(side):
            east, north, steeper = slopes[r, c, 0], slopes[r, c, 1], slopes[r, c, 2]
            up = 1.0 / np.sqrt(east * east + north * north + 1.0)
            out[0, r, c], out[1, r, c] = east * up * steeper, north * up * steeper
            out[2, r, c], out[3, r, c], out[4, r, c] = up, elevation_m[r, c], knows[r, c]
    return out


@summing
def _lit(posts: Rows, snow_m: NDArray[np.float32]) -> tuple[Rows, NDArray[np.bool_]]:
    """Paint posts without pictures, and say where that is too coarse.

    Returns
    -------
    lit : (3, n + 1, n + 1) float32, sRGB 0..255, relief included
    is_shore : (n, n) squares of posts with a shore, where the tint makes a step
    """
    side = posts.shape[1] - 1
    lit, is_shore = (
        np.empty((3, side + 1, side + 1), np.float32),
        np.zeros((side, side), np.bool_),
    )
    step = 0
    for r in range(side + 1):
        for c in range(side + 1):
            up, height = posts[2, r, c], posts[3, r, c]
            step = step_of(height, step)
            rgb = tint_of(step, height, up, snow_m[r])
            light = light_of(posts[0, r, c], posts[1, r, c], up, height)
            lit[0, r, c] = min(rgb[0] * light, WHITE)
            lit[1, r, c] = min(rgb[1] * light, WHITE)
            lit[2, r, c] = min(rgb[2] * light, WHITE)
            if r and c:
                low = high = height
                for near in (
                    posts[3, r - 1, c - 1],
                    posts[3, r - 1, c],
                    posts[3, r, c - 1],
                ):
                    low, high = min(low, near), max(high, near)
                is_shore[r - 1, c - 1] = low < SHORE_M[1] and high > SHORE_M[0]
    return lit, is_shore


@inlined
def _squares(side: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Return the square of posts that each texel lies in, and how far along, (256,)."""
    middle = np.arange(TEXTURE_SIDE).astype(np.float32) + np.float32(0.5)
    along = middle * np.float32(side / TEXTURE_SIDE)
    square = np.minimum(along.astype(np.int32), np.int32(side - 1))
    return square, along - square.astype(np.float32)


@summing
def _spread(lit: Rows, out: Rows) -> None:
    """Interpolate colours of posts, of `_lit`, at all texels of `out`, (256, 256, 3)."""
    square, part = _squares(lit.shape[1] - 1)
    row = np.empty(lit.shape[1], np.float32)
    for y in range(TEXTURE_SIDE):
        r, fy = square[y], part[y]
        for k in range(3):
            for c in range(len(row)):
                row[c] = lit[k, r, c] + fy * (lit[k, r + 1, c] - lit[k, r, c])
            for x in range(TEXTURE_SIDE):
                c = square[x]
                out[y, x, k] = row[c] + part[x] * (row[c + 1] - row[c])


@summing
def _paint(
    posts: Rows,
    is_fine: NDArray[np.bool_],
    picture: Rows,
    snow_m: NDArray[np.float32],
    out: Rows,
) -> None:
    """Paint texels one by one: height tint, snow, rock, picture, relief.

    Parameters
    ----------
    posts : of `_posts`, row 0 south
    is_fine : (n, n) squares of posts whose texels are to be painted
    picture : of `drape`, or NO_PICTURE
    snow_m : (n + 1,) of `snow_line_m`
    out : (256, 256, 3)
    """
    square, part = _squares(posts.shape[1] - 1)
    step, has_picture = 0, len(picture) > 0
    row = np.empty((5, posts.shape[2]), np.float32)
    for y in range(TEXTURE_SIDE):
        r, fy = square[y], part[y]
        if not is_fine[r].any():
            continue
        snow_here_m = snow_m[r] + fy * (snow_m[r + 1] - snow_m[r])
        for k in range(5):
            for c in range(row.shape[1]):
                row[k, c] = posts[k, r, c] + fy * (posts[k, r + 1, c] - posts[k, r, c])
        for x in range(TEXTURE_SIDE):
            c, fx = square[x], part[x]
            if not is_fine[r, c]:
                continue
            east = row[0, c] + fx * (row[0, c + 1] - row[0, c])
            north = row[1, c] + fx * (row[1, c + 1] - row[1, c])
            up = row[2, c] + fx * (row[2, c + 1] - row[2, c])
            height = row[3, c] + fx * (row[3, c + 1] - row[3, c])
            knows = row[4, c] + fx * (row[4, c + 1] - row[4, c])
            step = step_of(height, step)
            rgb = tint_of(step, height, up, snow_here_m)
            light = light_of(east, north, up, height)
            bare, red, green, blue = ONE, ZERO, ZERO, ZERO
            if has_picture:
                bare, red, green, blue = _shown(picture[y, x], height, up, knows)
            out[y, x, 0] = min((bare * rgb[0] + red) * light, WHITE)
            out[y, x, 1] = min((bare * rgb[1] + green) * light, WHITE)
            out[y, x, 2] = min((bare * rgb[2] + blue) * light, WHITE)


@inlined
def _shown(
    picture: NDArray[np.float32], height: np.float32, up: np.float32, knows: np.float32
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Return the share of a texel that is tint, and what its pictures add to it.

    A fine picture is shown as it is; what it leaves clear, as if it was not there.
    """
    fine = picture[FINE + SHARE]
    clear = ONE - fine
    if clear < LEAST:
        return ZERO, picture[FINE], picture[FINE + 1], picture[FINE + 2]
    share = (picture[SHARE] - fine) / clear
    red, blue = picture[0] - picture[FINE], picture[2] - picture[FINE + 2]
    kept = kept_of(share, red / clear, blue / clear, height, up, knows)
    bare = ONE - kept * share
    bare -= DARKER * max(bare - (ONE - share), ZERO)
    return (
        np.float32(clear * bare),
        np.float32(picture[FINE] + kept * red),
        np.float32(picture[FINE + 1] + kept * (picture[1] - picture[FINE + 1])),
        np.float32(picture[FINE + 2] + kept * blue),
    )
