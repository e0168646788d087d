# SPDX-License-Identifier: Apache-2.0
"""Colours of the ground at a place: tint by height, snow, rock, relief, and pictures."""

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edges_rad
from tiles.kernels import inlined

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
TINT_PER_M = 1 / np.diff(TINT_M)
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
SEA_RELIEF = np.float32(0.35)
"""How much of its relief the ground below the sea keeps: it is seen through water."""
WET, DEEP = np.float32(1.3), np.float32(0.7)
"""A picture's blue by red where it begins to look like water, and how much more it is
when it surely does."""
HAZY = np.float32(0.175)
"""Where posts know of land, a picture that is so much less blue looks like water too;
twice as much where they surely do."""
SHORE_M = np.float32(0.2), np.float32(1.5)
"""The tint is the sea's up to the first height, the land's from the second on."""
SURE_M, SURE_SHARE = (np.float32(-1.0), np.float32(60.0)), np.float32(1 / 30.0)
"""Heights between which fine posts know what is sea: land may lie lower, lakes higher."""
UNSURE = np.float32(1 / 60.0)
"""So many metres from sea level on, coarse posts surely know what is sea."""
LEVEL, STEEPER = np.float32(0.9999), np.float32(1 / 0.0002)
"""Upward part of a unit normal of ground too steep for water: from 0.8 degrees on."""
OPAQUE = np.float32(0.999)
AT_ONCE = np.float32(1000.0)
DARKER = np.float32(0.3)
"""By how much the tint is darkened where it stands for a picture: pictures are darker."""
SHADE, SUN = np.float32(0.46), np.float32(0.54 / 0.70710678)


def snow_line_m(cell: int, count: int) -> NDArray[np.float32]:
    """Return where snow begins to lie, for each row of posts, (n + 1,) m above the sea."""
    _, south, _, north = edges_rad(cell)
    lat_deg = np.degrees(np.linspace(south, north, count))
    line_m = np.interp(lat_deg, SNOW_LAT_DEG, SNOW_LINE_M)
    return np.asarray(line_m - 0.5 / SNOW_SHARE, np.float32)


@inlined
def tint_of(
    step: int, height: np.float32, up: np.float32, snow_m: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    """Return the colour of bare ground: tint by height, snow, rock where it is steep."""
    part = min(max((height - TINT_M[step]) * TINT_PER_M[step], ZERO), ONE)
    rock = snow = ZERO
    if height > ZERO:
        rock = min(max((STEEP - up) * STEEPEST, ZERO), MOST_ROCK)
        snow = min(max((height - snow_m) * SNOW_SHARE, ZERO), ONE)
    return (
        _mixed(step, 0, part, snow, rock),
        _mixed(step, 1, part, snow, rock),
        _mixed(step, 2, part, snow, rock),
    )


@inlined
def _mixed(
    step: int, k: int, part: np.float32, snow: np.float32, rock: np.float32
) -> np.float32:
    tint = TINT_RGB[step, k]
    tint += part * (TINT_RGB[step + 1, k] - tint)
    tint += snow * (SNOW_RGB[k] - tint)
    return np.float32(tint + rock * (ROCK_RGB[k] - tint))


@inlined
def kept_of(
    share: np.float32,
    red: np.float32,
    blue: np.float32,
    height: np.float32,
    up: np.float32,
    knows: np.float32,
) -> np.float32:
    """Return what to multiply a coarse picture's part of a texel by.

    Where picture and height don't agree on what is sea, one of both colours is left out,
    else their edges cross each other: the picture's where the posts know better, near
    sea level or where the ground is too steep for water; or else the tint. Near sea level
    coarse posts tell nothing: there the picture has the coast, and the tint none.

    Parameters
    ----------
    share, red, blue : of `drape`
    """
    if share <= ZERO or share >= OPAQUE:
        return ONE
    red, blue = red / share, blue / share
    low = (height - SURE_M[0]) if height < ZERO else (SURE_M[1] - height) * SURE_SHARE
    steep = (LEVEL - up) * STEEPER if height > ZERO else ZERO
    near = min(knows, ONE)
    # Towards the sea it is sure at once, or else the picture would show along the shore.
    all_known = max(knows - ONE, ZERO) * (ONE if height > ZERO else AT_ONCE)
    all_known = min(all_known, ONE)
    known = max(near * min(max(low, steep, ZERO), ONE), all_known)
    sea = min(max((SHORE_M[1] - height) / (SHORE_M[1] - SHORE_M[0]), ZERO), ONE)
    hazy = HAZY * (known + all_known) * (ONE - sea)
    wet = (blue - (WET - hazy) * red) / ((DEEP - hazy) * red + ONE)
    wet = min(max(wet, ZERO), ONE)
    agreed = ONE - abs(wet - sea)
    sure = near + (ONE - near) * min(abs(height) * UNSURE, ONE)
    alone = (ONE - (ONE - share) * agreed * sure) / share
    return np.float32(known * agreed + (ONE - known) * alone)


@inlined
def step_of(height: np.float32, step: int) -> int:
    """Return the pair of tints that a height lies between, from the last texel's pair."""
    while step < LAST and height > TINT_M[step + 1]:
        step += 1
    while step > 0 and height <= TINT_M[step]:
        step -= 1
    return step


@inlined
def light_of(
    east: np.float32, north: np.float32, up: np.float32, height: np.float32
) -> np.float32:
    """Brightness of a slope: 1 on the flat."""
    along = east * LIGHT[0] + north * LIGHT[1] + up * LIGHT[2]
    length = np.sqrt(east * east + north * north + up * up)
    light = SHADE + SUN * max(along / length, ZERO)
    return np.float32(light if height >= ZERO else ONE + SEA_RELIEF * (light - ONE))
