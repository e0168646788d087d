# SPDX-License-Identifier: Apache-2.0
"""Where the coordinates of a city model are: its CRS, the order of its axes, its units.

Only the horizontal part places a building; heights are used from the building's own
lowest point, so that no vertical datum is needed, only the unit.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyproj

from ingest.horizontal import GOOD_M, doubt
from tiles.errors import InputError
from tiles.frames import Floats

_CODE = re.compile(r"epsg(?:\.xml#|[:/]{1,2}(?:[\d.]+[:/]{1,2})?)(\d+)", re.IGNORECASE)
_GERMAN_UTM = re.compile(r"ETRS89_UTM(3[123])")
_GERMAN_GAUSS_KRUEGER = re.compile(r"DE_DHDN_3GK([2345])")
_MARGIN_DEG = 2.0
_LEADS_BACK = 1.0
_LONGEST_NAME = 10_000


@dataclass(frozen=True, slots=True)
class Placement:
    """How to turn a city model's coordinates to degrees and metres."""

    system: pyproj.CRS
    """the horizontal CRS"""
    turn: pyproj.Transformer
    """from easting and northing to longitude and latitude"""
    swapped: bool
    """the first coordinate is the northing or the latitude"""
    unit_m: float
    """metres per unit of height"""
    notes: tuple[str, ...]

    def degrees(self, xy: Floats) -> tuple[Floats, Floats]:
        """Return longitude and latitude of (n, 2) coordinates, as the file orders them.

        What the CRS can't place becomes infinite or NaN.
        """
        return _degrees(self.turn, xy, swapped=self.swapped)


def place_model(
    path: Path, named: str | None, crs: str | None, xy: Floats, *, by_authority: bool
) -> Placement:
    """Find the CRS of a city model and the order of its axes.

    Parameters
    ----------
    named : what the file says, a code, URN or URL
    crs : what the user says; overrides the file
    xy : (n, 2) some of the coordinates, to tell a wrong order of axes by
    by_authority : the order of axes is the CRS's own, as in CityGML; in CityJSON x is
        east whatever the CRS

    Raises
    ------
    InputError
        Where there is no CRS, or the coordinates can't be in it.
    """
    if crs is None and not named:
        advice = "name its own with --crs, as in --crs EPSG:25832"
        raise InputError(path, "says no CRS", advice)
    full = _system(path, crs or named or "")
    flat = full.to_2d()
    if not (flat.is_geographic or flat.is_projected):
        raise InputError(
            path, f"no map or geographic CRS ({flat.name})", "name it with --crs"
        )
    north_first = flat.axis_info[0].direction in {"north", "south"}
    usual = by_authority and north_first
    turn = pyproj.Transformer.from_crs(flat, "EPSG:4326", always_xy=True)
    swapped, notes = _order(path, turn, flat, xy, usual=usual)
    unit_m, unit_notes = _height_unit(path, full, named if crs else None)
    there = np.stack(_degrees(turn, xy, swapped=swapped))
    there = there[:, np.isfinite(there).all(axis=0)]
    (west, south), (east, north) = there.min(axis=1), there.max(axis=1)
    found = doubt(path, flat, (west, south, east, north), GOOD_M)
    notes = (*notes, *unit_notes, *([found] if found else []))
    return Placement(flat, turn, swapped, unit_m, notes)


def _system(path: Path, text: str) -> pyproj.CRS:
    for candidate in _spellings(text[:_LONGEST_NAME].strip()):
        try:
            return pyproj.CRS.from_user_input(candidate)
        except pyproj.exceptions.CRSError:
            continue
    raise InputError(
        path, f"unknown CRS {text[:100]!r}", "use a code such as --crs EPSG:25832"
    )


def _spellings(text: str) -> list[str]:
    """Return what a CRS may be called, the most complete name first."""
    found, codes = [text], _CODE.findall(text)
    if codes:
        found += [f"EPSG:{'+'.join(codes[:2])}", f"EPSG:{codes[0]}"]
    utm, strip = _GERMAN_UTM.search(text), _GERMAN_GAUSS_KRUEGER.search(text)
    if utm:
        found.append(f"EPSG:258{utm[1]}")
    if strip:
        found.append(f"EPSG:{31464 + int(strip[1])}")
    return found


def _height_unit(
    path: Path, full: pyproj.CRS, named: str | None
) -> tuple[float, tuple[str, ...]]:
    """Return metres per unit of height; a map without heights lends its own unit."""
    axes = full.axis_info
    if len(axes) < 3 and named:
        try:
            own = _system(path, named).axis_info
        except InputError:
            own = []
        axes = own if len(own) > 2 else axes
    if len(axes) > 2:
        return float(axes[2].unit_conversion_factor), ()
    if full.is_geographic:
        return 1.0, ()
    unit_m = float(axes[0].unit_conversion_factor)
    if unit_m == 1.0:
        return 1.0, ()
    return unit_m, (f"{path.name}: heights taken to be in {axes[0].unit_name}, as x and y",)


def _order(
    path: Path, turn: pyproj.Transformer, flat: pyproj.CRS, xy: Floats, *, usual: bool
) -> tuple[bool, tuple[str, ...]]:
    """Tell whether northing comes first: as it should, unless that is elsewhere."""
    middle = np.median(xy[np.isfinite(xy).all(axis=1)], axis=0, keepdims=True)
    for swapped in (usual, not usual):
        if _is_at_home(flat, _degrees(turn, middle, swapped=swapped)):
            words = "latitude or northing" if swapped else "longitude or easting"
            note = f"{path.name}: axes swapped; {words} taken as the first coordinate"
            return swapped, () if swapped == usual else (note,)
    place, name = _degrees(turn, middle, swapped=usual), flat.to_string()
    lon, lat = float(place[0][0]), float(place[1][0])
    if not (abs(lon) <= 180 and abs(lat) <= 90 and _leads_back(turn, middle, place)):
        raise InputError(
            path,
            f"coordinates that can't be in {name} (such as {middle[0, 0]:.6g}, "
            f"{middle[0, 1]:.6g})",
            "name the right CRS with --crs",
        )
    where = f"longitude {lon:.3f}, latitude {lat:.3f}"
    return usual, (f"{path.name}: {where} is outside the area that {name} is made for",)


def _degrees(
    turn: pyproj.Transformer, xy: Floats, *, swapped: bool
) -> tuple[Floats, Floats]:
    east, north = xy[:, ::-1].T if swapped else xy.T
    lon, lat = turn.transform(east, north)
    return np.asarray(lon, np.float64), np.asarray(lat, np.float64)


def _leads_back(turn: pyproj.Transformer, xy: Floats, place: tuple[Floats, Floats]) -> bool:
    """Tell whether coordinates are a place; far outside a map any number comes out."""
    back = np.sort(np.ravel(turn.transform(place[0], place[1], direction="INVERSE")))
    return bool((np.abs(back - np.sort(xy[0])) < _LEADS_BACK).all())


def _is_at_home(flat: pyproj.CRS, place: tuple[Floats, Floats]) -> bool:
    """Tell whether a place is in the area of use of a CRS, or near it."""
    lon, lat = float(place[0][0]), float(place[1][0])
    area = flat.area_of_use
    if area is None:
        return abs(lon) <= 180 and abs(lat) <= 90
    width = (area.east - area.west) % 360 or 360.0
    beyond = (lon - area.west + _MARGIN_DEG) % 360
    in_lon = beyond <= width + 2 * _MARGIN_DEG
    in_lat = area.south - _MARGIN_DEG <= lat <= area.north + _MARGIN_DEG
    return bool(np.isfinite(lon) and in_lon and in_lat)
