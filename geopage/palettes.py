# SPDX-License-Identifier: Apache-2.0
"""Colours for values: ramps for numbers, and a set for categories.

Viridis, cividis and magma are matplotlib's (CC0), oranges and blues ColorBrewer's
(Apache-2.0), the categories Paul Tol's discrete rainbow; all but the plain ramps of one
hue were made to be told apart by the colour-blind as well.
"""

import numpy as np
from numpy.typing import NDArray

Colour = tuple[int, int, int]

RAMPS = {
    "viridis": "440154 472d7b 3b528b 2c728e 21918c 28ae80 5ec962 addc30 fde725",
    "cividis": "00224e 123570 3b496c 575d6d 707173 8a8678 a59c74 c3b369 e1cc55 fee838",
    "magma": "000004 1d1147 51127c 832681 b73779 e75263 fc8961 fec488 fcfdbf",
    "oranges": "fff7ec fee8c8 fdd49e fdbb84 fc8d59 ef6548 d7301f b30000 7f0000",
    "blues": "f7fbff deebf7 c6dbef 9ecae1 6baed6 4292c6 2171b5 08519c 08306b",
}
CATEGORIES = "1965b0 f4a736 4eb265 dc050c d1bbd7 882e72 f7f056 7bafde cae0ab e8601c ae76a3"
MISSING: Colour = (140, 140, 140)
OTHER: Colour = (222, 222, 222)


def colour_of(text: str) -> Colour:
    """Read #rrggbb or #rgb.

    Raises
    ------
    ValueError
    """
    digits = text.strip().removeprefix("#")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    if len(digits) != 6 or not set(digits.lower()) <= set("0123456789abcdef"):
        raise ValueError(f"{text!r} is no colour like #e0b0a0")
    red, green, blue = (int(digits[k : k + 2], 16) for k in (0, 2, 4))
    return red, green, blue


def text_of(colour: Colour) -> str:
    """Write a colour as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def category_colours() -> list[Colour]:
    """Return the colours of categories, the commonest first."""
    return [colour_of(one) for one in CATEGORIES.split()]


def ramp(name: str, count: int) -> NDArray[np.uint8]:
    """Return `count` colours of a ramp, (count, 3) uint8 sRGB, low to high."""
    stops = np.array([colour_of(one) for one in RAMPS[name].split()], np.float64)
    at = np.linspace(0, len(stops) - 1, count)
    channels = [np.interp(at, np.arange(len(stops)), channel) for channel in stops.T]
    return np.asarray(np.rint(np.stack(channels, axis=1)), np.uint8)
