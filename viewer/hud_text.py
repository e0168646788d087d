# SPDX-License-Identifier: Apache-2.0
"""Numbers as a person reads them."""

import math
from datetime import datetime

import numpy as np
from pyproj import Geod

from tiles.frames import Ecef, Floats
from tiles.geodesy import to_geodetic
from viewer.camera import Pose

MIB = 2**20
COMPASS = "N", "NE", "E", "SE", "S", "SW", "W", "NW"
GEOD = Geod(ellps="WGS84")


def place_text(lon_rad: float, lat_rad: float) -> str:
    """Return latitude and longitude in degrees, as accurate as a metre."""
    lat, lon = math.degrees(lat_rad), math.degrees(lon_rad)
    north, east = "N" if lat >= 0 else "S", "E" if lon >= 0 else "W"
    return f"{abs(lat):.5f}° {north}   {abs(lon):.5f}° {east}"


def length_text(metres: float) -> str:
    """Return a length with a unit that suits it."""
    size = abs(metres)
    if size < 10:
        return f"{metres:.2f} m"
    if size < 1000:
        return f"{metres:.1f} m"
    if size < 1e5:
        return f"{metres / 1000:.2f} km"
    return f"{metres / 1000:,.0f} km"


def way_text(pose: Pose) -> str:
    """Return where the eye looks."""
    heading = round(math.degrees(pose.heading_rad)) % 360
    named = COMPASS[round(heading / 45) % 8]
    pitch = round(math.degrees(pose.pitch_rad))
    tilt = (
        "straight down"
        if pitch <= -89
        else f"{abs(pitch)}° {'up' if pitch > 0 else 'down'}"
    )
    return f"{heading}° {named}, {tilt if pitch else 'level'}"


def measured(a: Ecef, b: Ecef) -> dict[str, float]:
    """Return distance_m (straight), ground_m (on the ellipsoid), rise_m between points."""
    lon, lat, height_m = to_geodetic(Ecef(np.stack((a, b))))
    _, _, ground_m = GEOD.inv(lon[0], lat[0], lon[1], lat[1], radians=True)
    straight: Floats = b - a
    return {
        "distance_m": math.sqrt(float(straight @ straight)),
        "ground_m": float(ground_m),
        "rise_m": float(height_m[1] - height_m[0]),
    }


def measured_lines(points: list[Ecef]) -> list[str]:
    """Return a measurement in words, or what to do for one."""
    if len(points) < 2:
        return [f"click the {'second' if points else 'first'} point"]
    found = measured(points[0], points[1])
    return [
        f"distance  {length_text(found['distance_m'])}",
        f"horizontally  {length_text(found['ground_m'])}",
        f"height difference  {length_text(found['rise_m'])}",
    ]


def sun_text(utc: datetime) -> str:
    """Return a time as it is shown."""
    return f"{utc:%d %b  %H:%M} UTC"
