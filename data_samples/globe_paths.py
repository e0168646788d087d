# SPDX-License-Identifier: Apache-2.0
"""Flights over the poles, along the antimeridian, at 45 degrees north and to Monaco.

The first four are the same flight along a great circle: 20 s, 30 degrees of arc, from
600 km down to 20 km and up again, looking ahead and down. Where the flight is lowest it
passes its place at 0.1 degree, so that the heading has no jump at a pole.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from paths import smooth, write

Array = NDArray[np.float64]
SECONDS, ARC_DEG, ASIDE_DEG = 20.0, 30.0, 0.1
HIGHEST_M, LOWEST_M = 6e5, 2e4
PITCH_DEG = -40.0
FLIGHTS = {
    "north_pole": (10.0, 90.0, 0.0),
    "south_pole": (10.0, -90.0, 0.0),
    "antimeridian": (180.0, 0.0, 0.0),
    "parallel_45": (10.0, 45.0, 90.0),
}
"""Longitude, latitude and course where the flight is lowest"""
MONACO_DEG = {"lon_deg": 7.413, "lat_deg": 43.7335}
"""12 m from the nearest footprint"""


def axes(lon_deg: float, lat_deg: float) -> tuple[Array, Array, Array]:
    """Return east, north and up on the unit sphere."""
    lon, lat = np.radians((lon_deg, lat_deg))
    up = np.array((np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)))
    east = np.array((-np.sin(lon), np.cos(lon), 0.0))
    return east, np.cross(up, east), up


def poses(middle: tuple[float, float, float], angles_deg: Array) -> Iterator[Array]:
    """Yield longitude, latitude and heading (degrees) along a great circle."""
    east, north, up = axes(*middle[:2])
    course = np.radians(middle[2])
    ahead = np.cos(course) * north + np.sin(course) * east
    aside = np.radians(ASIDE_DEG)
    start = np.cos(aside) * up + np.sin(aside) * np.cross(ahead, up)
    for angle in np.radians(angles_deg):
        place = np.cos(angle) * start + np.sin(angle) * ahead
        way = np.cos(angle) * ahead - np.sin(angle) * start
        lon = np.degrees(np.arctan2(place[1], place[0]))
        lat = np.degrees(np.arcsin(place[2]))
        here = axes(float(lon), float(lat))
        yield np.array((lon, lat, np.degrees(np.arctan2(way @ here[0], way @ here[1]))))


def build_globe_paths(folder: Path) -> None:
    """Write the four flights; keyframes are dense where the heading turns fast."""
    steps = np.linspace(-1.0, 1.0, 81)
    near = 0.8 * np.sign(steps) * np.abs(steps) ** 1.5
    times = np.unique(
        np.r_[np.arange(0.0, SECONDS + 0.1, 0.5), SECONDS / 2 + near].round(3)
    )
    share = np.abs(2.0 * times / SECONDS - 1.0)
    height = np.exp(np.log(LOWEST_M) + np.log(HIGHEST_M / LOWEST_M) * smooth(share))
    for name, middle in FLIGHTS.items():
        lon, lat, heading = np.array(
            list(poses(middle, ARC_DEG * (times / SECONDS - 0.5)))
        ).T
        rows = {"lon_deg": lon, "lat_deg": lat, "height_m": height, "heading_deg": heading}
        rows["pitch_deg"] = np.full(len(times), PITCH_DEG)
        write(folder / f"{name}.json", "ellipsoid", times, rows, "log_height")


def build_monaco(folder: Path) -> None:
    """Write the fly-in's heights and views over Monaco."""
    flight = json.loads((folder / "fly_in.json").read_text())
    frames = [{**frame, **MONACO_DEG} for frame in flight["keyframes"]]
    rows = {name: np.array([frame[name] for frame in frames]) for name in frames[0]}
    times, how = rows.pop("t_s"), flight["interpolation"]
    write(folder / "monaco.json", flight["height_reference"], times, rows, how)


if __name__ == "__main__":
    build_globe_paths(Path(__file__).resolve().parent / "paths")
    build_monaco(Path(__file__).resolve().parent / "paths")
