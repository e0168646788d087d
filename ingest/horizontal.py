# SPDX-License-Identifier: Apache-2.0
"""How far off a file's places may be: by the way from its map's datum to WGS84.

PROJ takes the best way whose grids are installed, and says nothing of better ones.
"""

from pathlib import Path

import numpy as np
import pyproj
from pyproj.transformer import TransformerGroup

from tiles.errors import InputError
from tiles.frames import WGS84_A_M
from tiles.placement import Box, area_of, is_lon_lat, way_to_degrees, ways_between

SHIFT_M = 1000.0
"""About as far as most datums are from WGS84, where no way between them is known"""
GOOD_M = 5.0
"""For buildings: WGS84 itself, NAD83 and ETRS89 are as close"""


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
    taken = way_to_degrees(crs, bounds_deg)
    way = _name(crs, taken.description)
    is_left_out = "Ballpark" in way
    ways = ways_between(crs, pyproj.CRS(4326), area_of(bounds_deg))
    way += "" if ways.transformers else ", which is made for elsewhere"
    is_known = taken.accuracy >= 0.0 and bool(ways.transformers)
    known_m = taken.accuracy if is_known else np.inf
    off_m = SHIFT_M if is_left_out else known_m
    if off_m <= good_m:
        return ""
    # Degrees on WGS84's ellipsoid are taken as they are: a grid would change nothing.
    grids, better_m = ("", np.inf) if is_lon_lat(crs) else _best(ways, bounds_deg)
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


def _name(crs: pyproj.CRS, description: str) -> str:
    """Return what changes the datum, without the map and the order of axes."""
    how = crs.coordinate_operation
    map_ = f"Inverse of {how.name}" if how and crs.is_projected else None
    steps = description.split(" + ")
    steps = [one for one in steps if one != map_ and not one.startswith("axis order")]
    return " + ".join(steps)


def _best(ways: TransformerGroup, bounds_deg: Box) -> tuple[str, float]:
    """Return the files that the best way needs that lacks some, and how far off it is, m.

    Ways that are made for all of the area come first.
    """
    west, south, east, north = bounds_deg
    found = [(True, np.inf, "")]
    for way in ways.unavailable_operations:
        names = [grid.short_name for grid in way.grids if not grid.available]
        if names and way.accuracy >= 0.0 and (use := way.area_of_use):
            ends = (use.west - west) % 360.0, (use.east - west) % 360.0
            whole = ends[1] >= east - west and (ends[0] >= ends[1] or not ends[0])
            whole &= use.south <= south and use.north >= north
            found.append((not whole, float(way.accuracy), " and ".join(names)))
    _, best_m, files = min(found)
    return files, best_m
