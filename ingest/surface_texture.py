# SPDX-License-Identifier: Apache-2.0
"""What a terrain tile looks like: picture or height tint, with relief shading baked in."""

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edge_m, edges_rad, overlap
from ingest.drape import SHARE, drape
from ingest.layer import Layer
from tiles.frames import Floats
from tiles.kernels import inlined, kernel, summing
from tiles.terrain import TEXTURE_SIDE

Rows = NDArray[np.float32]
TINT_M = np.array(
    [-8000.0, -4000, -200, 0.2, 1.5, 150, 600, 1500, 2600, 3800, 5000], np.float32
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
    ],
    np.float32,
)
LAST = len(TINT_M) - 2
LIGHT = np.array([-0.5, 0.5, 0.70710678], np.float32)
"""Towards the light, east-north-up: north-west, 45 degrees high, as maps are lit."""
ROCK_RGB = np.array([122, 112, 102], np.float32)
SNOW_RGB = np.array([222, 228, 236], np.float32)
SNOW_LAT_DEG = np.array([-66.0, -60, -45, -28, 0, 28, 45, 62, 72, 80, 90])
SNOW_LINE_M = np.array([-500.0, 400, 2300, 5300, 4900, 5300, 2900, 1400, 800, 250, 100])
"""Height above which half the ground is white all year; all of Antarctica is."""
SNOW_SHARE = np.float32(1 / 700.0)
"""How much more of the ground is white a metre higher up."""
ZERO, ONE, WHITE = np.float32(0.0), np.float32(1.0), np.float32(255.0)
STEEP, STEEPEST = np.float32(0.86), np.float32(1 / 0.25)
"""Upward part of a unit normal where rock begins to show, and how fast it does below."""
MOST_ROCK = np.float32(0.8)
FINER, RELIEF_TEXELS = 0.7, 1.998
FLAT_M = 0.5
"""Ground whose posts differ by less shows no relief at any level."""
SEA_RELIEF = np.float32(0.35)
"""How much of its relief the ground below the sea keeps: it is seen through water."""
WET, DEEP = np.float32(1.3), np.float32(0.7)
"""A picture's blue by red where it begins to look like water, and how much more it is
when it surely does."""
SHORE_M = np.float32(0.2), np.float32(1.5)
"""The tint is the sea's up to the first height, the land's from the second on."""
SURE_M, SURE_SHARE = (np.float32(-1.0), np.float32(60.0)), np.float32(1 / 30.0)
"""Heights between which fine posts know what is sea: land may lie lower, lakes higher."""
UNSURE = np.float32(1 / 60.0)
"""So many metres from sea level on, coarse posts surely know what is sea."""
KNOWN = np.float32(1.001)
"""Posts say that all is sea where more is known."""
LEVEL, STEEPER = np.float32(0.9999), np.float32(1 / 0.0002)
"""Upward part of a unit normal of ground too steep for water: from 0.8 degrees on."""
OPAQUE = np.float32(0.999)
DARKER = np.float32(0.3)
"""By how much the tint is darkened where it stands for a picture: pictures are darker."""
SHADE, SUN = np.float32(0.46), np.float32(0.54 / 0.70710678)


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
    posts, picture = _posts(slopes, elevation_m, knows), drape(cell, pictures)
    return _painted(posts, picture, _snow_line_m(cell))


def _snow_line_m(cell: int) -> NDArray[np.float32]:
    """Return where snow begins to lie, for each row of texels, (256,) m above the sea."""
    _, south, _, north = edges_rad(cell)
    lat = south + (np.arange(TEXTURE_SIDE) + 0.5) / TEXTURE_SIDE * (north - south)
    line_m = np.interp(np.degrees(lat), SNOW_LAT_DEG, SNOW_LINE_M)
    return np.asarray(line_m - 0.5 / SNOW_SHARE, np.float32)


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
    shown = [p for p in pictures if overlap(cell, p.bounds_deg)]
    finer = any(p.spacing_m < FINER * texel_m for p in shown)
    if np.ptp(elevation_m) > FLAT_M:
        finer |= any(one.spacing_m < RELIEF_TEXELS * texel_m for one in terrain)
    return texel_m if finer else 0.0


@kernel
def _posts(slopes: Floats, elevation_m: Floats, knows: Rows) -> Rows:
    """Return the posts' unit normals, east-north-up, elevations, exaggerations, `knows`.

    Returns
    -------
    (n + 1, n + 1, 6) float32
    """
    side = len(slopes)
    out = np.empty((side, side, 6), np.float32)
    for r in range(side):
        for c in range(side):
            east, north = slopes[r, c, 0], slopes[r, c, 1]
            up = 1.0 / np.sqrt(east * east + north * north + 1.0)
            out[r, c, 0], out[r, c, 1], out[r, c, 2] = east * up, north * up, up
            out[r, c, 3], out[r, c, 4] = elevation_m[r, c], slopes[r, c, 2]
            out[r, c, 5] = knows[r, c]
    return out


@summing
def _painted(posts: Rows, picture: Rows, snow_m: NDArray[np.float32]) -> Rows:
    """Paint every texel: height tint, snow, rock where it is steep, picture, relief.

    Parameters
    ----------
    posts : of `_posts`, row 0 south
    picture : (256, 256, 5) of `drape`
    snow_m : (256,) of `_snow_line_m`
    """
    side, size = posts.shape[0] - 1, picture.shape[0]
    out = np.empty((size, size, 3), np.float32)
    spread = np.float32(side / size)
    step, row = 0, np.empty((side + 1, 6), np.float32)
    for y in range(size):
        v = (np.float32(y) + np.float32(0.5)) * spread
        r = min(int(v), side - 1)
        fy = v - np.float32(r)
        for c in range(side + 1):
            for k in range(6):
                row[c, k] = posts[r, c, k] + fy * (posts[r + 1, c, k] - posts[r, c, k])
        for x in range(size):
            u = (np.float32(x) + np.float32(0.5)) * spread
            c = min(int(u), side - 1)
            fx = u - np.float32(c)
            east = row[c, 0] + fx * (row[c + 1, 0] - row[c, 0])
            north = row[c, 1] + fx * (row[c + 1, 1] - row[c, 1])
            up = row[c, 2] + fx * (row[c + 1, 2] - row[c, 2])
            height = row[c, 3] + fx * (row[c + 1, 3] - row[c, 3])
            steeper = row[c, 4] + fx * (row[c + 1, 4] - row[c, 4])
            knows = row[c, 5] + fx * (row[c + 1, 5] - row[c, 5])
            step = _step(height, step)
            part = (height - TINT_M[step]) / (TINT_M[step + 1] - TINT_M[step])
            part = min(max(part, ZERO), ONE)
            rock = snow = ZERO
            if height > ZERO:
                rock = min(max((STEEP - up) * STEEPEST, ZERO), MOST_ROCK)
                snow = min(max((height - snow_m[y]) * SNOW_SHARE, ZERO), ONE)
            light = _light(east * steeper, north * steeper, up)
            if height < ZERO:
                light = ONE + SEA_RELIEF * (light - ONE)
            share = picture[y, x, SHARE]
            kept = _kept(picture[y, x], height, up, knows)
            bare = ONE - kept * share
            bare -= DARKER * max(bare - (ONE - share), ZERO)
            for k in range(3):
                tint = TINT_RGB[step, k]
                tint += part * (TINT_RGB[step + 1, k] - tint)
                tint += snow * (SNOW_RGB[k] - tint)
                tint += rock * (ROCK_RGB[k] - tint)
                colour = (bare * tint + kept * picture[y, x, k]) * light
                out[y, x, k] = min(max(colour, ZERO), WHITE)
    return out


@inlined
def _kept(texel: Rows, height: np.float32, up: np.float32, knows: np.float32) -> np.float32:
    """Return what to multiply a coarse picture's part of a texel by.

    Where picture and height don't agree on what is sea, one of both colours is left out,
    else their edges cross each other: the picture's where the posts know better, near
    sea level or where the ground is too steep for water; or else the tint. Near sea level
    coarse posts tell nothing: there the picture has the coast, and the tint none.

    Parameters
    ----------
    texel : (5,) of `drape`
    """
    share = texel[SHARE]
    if share <= ZERO or share >= OPAQUE:
        return ONE
    red, blue = texel[0] / share, texel[2] / share
    wet = min(max((blue - WET * red) / (DEEP * red + ONE), ZERO), ONE)
    sea = min(max((SHORE_M[1] - height) / (SHORE_M[1] - SHORE_M[0]), ZERO), ONE)
    agreed = ONE - abs(wet - sea)
    low = (height - SURE_M[0]) if height < ZERO else (SURE_M[1] - height) * SURE_SHARE
    steep = (LEVEL - up) * STEEPER if height > ZERO else ZERO
    near = min(knows, ONE)
    known = near * min(max(low, steep, ZERO), ONE) if knows <= KNOWN else ONE
    sure = near + (ONE - near) * min(abs(height) * UNSURE, ONE)
    alone = (ONE - (ONE - share) * agreed * sure) / share
    return np.float32(known * agreed + (ONE - known) * alone)


@inlined
def _step(height: np.float32, step: int) -> int:
    """Return the pair of tints that a height lies between, from the last texel's pair."""
    while step < LAST and height > TINT_M[step + 1]:
        step += 1
    while step > 0 and height <= TINT_M[step]:
        step -= 1
    return step


@inlined
def _light(east: np.float32, north: np.float32, up: np.float32) -> np.float32:
    """Brightness of a slope: 1 on the flat."""
    along = east * LIGHT[0] + north * LIGHT[1] + up * LIGHT[2]
    length = np.sqrt(east * east + north * north + up * up)
    return np.float32(SHADE + SUN * max(along / length, ZERO))
