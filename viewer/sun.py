# SPDX-License-Identifier: Apache-2.0
"""Where the sun is.

Low-precision formulas of the Astronomical Almanac (page C5, and B6 for sidereal time):
within 0.01 degrees from 1950 to 2050.
"""

import math
from datetime import UTC, datetime

import numpy as np

from tiles.frames import Floats

J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
DAY_S = 86_400.0


def sun_direction(utc: datetime) -> Floats:
    """Return the unit vector from the earth to the sun, (3,) float64, ECEF axes.

    Parameters
    ----------
    utc : with its time zone; without one it is taken as UTC
    """
    known = utc if utc.tzinfo else utc.replace(tzinfo=UTC)
    days = (known - J2000).total_seconds() / DAY_S
    mean = math.radians(280.460 + 0.9856474 * days)
    anomaly = math.radians(357.528 + 0.9856003 * days)
    equation = 1.915 * math.sin(anomaly) + 0.020 * math.sin(2 * anomaly)
    longitude = mean + math.radians(equation)
    tilt = math.radians(23.439 - 4e-7 * days)
    turned = math.radians(280.46062 + 360.98564737 * days)
    x, along = math.cos(longitude), math.sin(longitude)
    y, z = along * math.cos(tilt), along * math.sin(tilt)
    cos_t, sin_t = math.cos(turned), math.sin(turned)
    return np.array((x * cos_t + y * sin_t, y * cos_t - x * sin_t, z))
