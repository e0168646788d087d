# SPDX-License-Identifier: Apache-2.0
"""Light of sun and sky at the eye, as `air.glsl` has it at each pixel seen from above.

Near the ground the sun is equally high all over the picture, so these are made once for
a frame. The light of the sky is a parabola in `near`, which is 1 towards the sun and 0
away from it, and changes evenly from thin air overhead to thick air at the horizon.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats

HORIZON = np.array((0.60, 0.71, 0.86))
ZENITH = np.array((0.50, 0.70, 1.02))
DUSK = np.array((0.20, 0.30, 0.55))
AFTERGLOW = np.array((0.90, 0.42, 0.16))
SCALE_HEIGHT_M = 8000.0
MOON = np.array((0.75, 0.95, 1.30))


def smoothstep(low: float, high: float, x: float) -> float:
    """Return GLSL's `smoothstep`."""
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


def moonlight(night: float) -> Floats:
    """Return the light that reaches the night side, (3,) linear red, green, blue."""
    return night * (MOON + night * (1.0 - MOON))


def through_air(day: float) -> Floats:
    """Return the sun's colour where a share of its green arrives, (3,)."""
    return np.array((day**0.5, day, day * day))


def sunlight(rise: float, night: float) -> Floats:
    """Return the light on level ground, (3,), 1 by day.

    Parameters
    ----------
    rise : sine of the sun's height
    night : `Look.night_light`
    """
    dark = moonlight(night)
    return np.asarray(dark + (1.0 - dark) * through_air(smoothstep(-0.12, 0.40, rise)))


def skylight(rise: float, night: float) -> NDArray[np.float64]:
    """Return the light of the sky.

    Returns
    -------
    terms : (2, 3, 3) of thin air and of thick; factors of near**0, near**1, near**2;
        linear red, green, blue
    """
    day = smoothstep(-0.12, 0.40, rise)
    late = max(smoothstep(-0.30, 0.20, rise) - day, 0.0)
    terms = np.zeros((2, 3, 3))
    for thick, colour in enumerate((ZENITH, HORIZON)):
        lit = colour * through_air(day)
        red = thick * (AFTERGLOW - DUSK)
        terms[thick, 0] = 1.14 * lit + late * 0.3 * DUSK + 0.05 * moonlight(night) * HORIZON
        terms[thick, 1] = -1.12 * lit + late * (DUSK + 0.3 * red)
        terms[thick, 2] = 1.12 * lit + late * red
    return terms


def densities(height_m: float) -> tuple[float, float]:
    """Return how dense air and mist are at a height, 1 at sea level."""
    air = math.exp(-height_m / SCALE_HEIGHT_M)
    return air, air**6
