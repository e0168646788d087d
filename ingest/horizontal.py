# SPDX-License-Identifier: Apache-2.0
"""How far off a file's places may be: by the way from its map's datum to WGS84.

PROJ takes the best way whose grids are installed, and says nothing of better ones.
"""

from pathlib import Path

import numpy as np
import pyproj
from pyproj.transformer import AreaOfInterest

from ingest.datum import ways_between
from tiles.errors import InputError
from tiles.frames import WGS84_A_M
from tiles.placement import is_lon_lat, transformer

SHIFT_M = 1000.0
"""About as far as most datums are from WGS84, where no way between them is known"""
GOOD_M = 5.0
"""For buildings: WGS84 itself, NAD83 and ETRS89 are as close"""
SIDE = 5
"""Places that are looked at, each way"""
Box = tuple[float, float, float, float]


def doubt(path: str | Path, crs: pyproj.CRS, bounds_deg: Box, good_m: float) -> str:
    """Say in one line how far off a file's places may be; empty where that is good.

    Parameters
    ----------
    good_m : so far off is good enough

    Raises
    ------
    InputError
        Where no way is known here from an ellipsoid of the past.
    """
    off_m, way = _worst(crs, bounds_deg)
    is_left_out = "Ballpark" in way
    off_m = SHIFT_M if is_left_out else off_m
    if off_m <= good_m:
        return ""
    # Degrees on WGS84's ellipsoid are taken as they are: a grid would change nothing.
    grids, better_m = ("", np.inf) if is_lon_lat(crs) else _better(crs, bounds_deg)
    advice = f"install {grids} with `pyproj sync --file NAME`" if better_m < off_m else ""
    datum = crs.datum.name if crs.datum else crs.name
    if is_left_out:
        reason = f"no way known from its datum ({datum[:60]}) to WGS84"
        if not _is_plain(crs):
            raise InputError(path, reason, advice or "name its CRS with --crs EPSG:n")
        text = f"{reason}: its degrees are taken as WGS84's"
    elif np.isfinite(off_m):
        text = f"places may be {off_m:g} m off (by {way})"
    else:
        text = f"nobody says how far off its places may be (by {way})"
    if advice:
        advice = f"; for {better_m:g} m {advice}, and ingest it again"
    return f"{Path(path).name}: {text}{advice}"


def _is_plain(crs: pyproj.CRS) -> bool:
    """Say whether a system is a sphere's, or on an ellipsoid like WGS84's."""
    shape = crs.ellipsoid
    if shape is None:
        return False
    alike = abs(shape.semi_major_metre - WGS84_A_M) < 5.0
    return alike or shape.semi_major_metre == shape.semi_minor_metre


def _worst(crs: pyproj.CRS, bounds_deg: Box) -> tuple[float, str]:
    """Return how far off the ways that are taken may be (m, inf if unknown), and which."""
    turn = transformer(crs, 4326)
    west, south, east, north = bounds_deg
    found = []
    for lon in np.linspace(west, east, SIDE):
        for lat in np.linspace(south, north, SIDE):
            turn.transform(lon, lat, direction="INVERSE")
            try:
                used = turn.get_last_used_operation()
            except pyproj.exceptions.ProjError:  # there is nothing to do
                used = turn
            off_m = used.accuracy if used.accuracy >= 0.0 else np.inf
            found.append((float(off_m), _name(crs, used.description)))
    return max(found)


def _name(crs: pyproj.CRS, description: str) -> str:
    """Return what changes the datum, without the map and the order of axes."""
    how = crs.coordinate_operation
    map_ = f"Inverse of {how.name}" if how and crs.is_projected else None
    steps = description.split(" + ")
    steps = [one for one in steps if one != map_ and not one.startswith("axis order")]
    return " + ".join(steps)


def _better(crs: pyproj.CRS, bounds_deg: Box) -> tuple[str, float]:
    """Return the files that the best way needs, and how far off that is, m.

    Ways that are made for all of the area come first.
    """
    west, south, east, north = bounds_deg
    west = (west + 180.0) % 360.0 - 180.0
    east = west + min(bounds_deg[2] - bounds_deg[0], 359.999)
    area = AreaOfInterest(west, south, (east + 180.0) % 360.0 - 180.0, north)
    found = [(True, np.inf, "")]
    for way in ways_between(crs, pyproj.CRS(4326), area).unavailable_operations:
        names = [grid.short_name for grid in way.grids if not grid.available]
        if names and way.accuracy >= 0.0 and (use := way.area_of_use):
            ends = (use.west - west) % 360.0, (use.east - west) % 360.0
            whole = ends[1] >= east - west and (ends[0] >= ends[1] or not ends[0])
            whole &= use.south <= south and use.north >= north
            found.append((not whole, float(way.accuracy), " and ".join(names)))
    _, best_m, files = min(found)
    return files, best_m
