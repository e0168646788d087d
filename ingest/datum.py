# SPDX-License-Identifier: Apache-2.0
"""From elevations above a geoid to heights above the ellipsoid."""

from functools import cache
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from pyproj.transformer import TransformerGroup
from rasterio.errors import RasterioError

from tiles.errors import InputError
from tiles.frames import Floats
from tiles.kernels import kernel
from tiles.placement import Box, area_of, ways_between
from tiles.samples import SAMPLES

GRIDS = {"egm96": SAMPLES / "egm96_15.tif"}
"""Grids that come with the package; others are PROJ's, where they are installed."""
EPSG = {5773: "egm96", 5171: "egm96", 3855: "egm2008", 4979: "ellipsoid"}
CODES = {"egm2008": 3855}
_NAMES = {"egm96", "egm2008", "ellipsoid"}
UNITS_M = {
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "us-ft": 1200 / 3937,
    "us survey foot": 1200 / 3937,
    "us_survey_foot": 1200 / 3937,
}
UNITS_M |= {"cm": 0.01, "centimetre": 0.01, "dm": 0.1, "mm": 0.001, "km": 1000.0}
UNITS_M |= dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0)
"""Units that a band may state; metres where nothing states any."""
GLOBE: Box = (-180.0, -90.0, 180.0, 90.0)
ADVICE = "state one with --datum egm96, ellipsoid or EPSG:n"


def datum_of(
    path: str | Path, stated: str | None, file_crs: str | None, bounds_deg: Box = GLOBE
) -> str:
    """Return the vertical datum of a source: as stated, else as its file says.

    Parameters
    ----------
    bounds_deg : of the source; a grid that is not installed is named for there

    Returns
    -------
    "egm96", "egm2008", "ellipsoid" or "epsg:n"

    Raises
    ------
    InputError
        When neither knows it, or the datum's grid is not installed.
    """
    found = _stated(stated) if stated else datum_in(file_crs)
    if found is None:
        reason = (
            f"unknown vertical datum {stated!r}" if stated else "vertical datum not known"
        )
        raise InputError(path, reason, ADVICE)
    if found not in {"ellipsoid", *GRIDS}:
        require_way(path, found, bounds_deg)
    return found


def _stated(text: str) -> str | None:
    name = text.lower()
    if name.startswith("epsg:") and name[5:].isdigit():
        return _of_epsg(int(name[5:])) or name
    return name if name in _NAMES else None


def _of_epsg(code: int) -> str | None:
    """Name the datum of a code, which may be a compound system's."""
    if code in EPSG:
        return EPSG[code]
    try:
        return datum_in(f"EPSG:{code}")
    except pyproj.exceptions.CRSError:
        return None


def datum_in(wkt: str | None) -> str | None:
    """Return the vertical datum that a coordinate system says, None if none."""
    crs = pyproj.CRS.from_user_input(wkt) if wkt else None
    if crs is None:
        return None
    if crs.is_compound:
        code = crs.sub_crs_list[1].to_epsg()
        return EPSG.get(code, f"epsg:{code}") if code else crs.sub_crs_list[1].name
    return "ellipsoid" if len(crs.axis_info) == 3 else None


def unit_m(
    path: str | Path,
    stated: str | None,
    crs: str | None,
    band: str | None,
    units: str | None = None,
) -> float:
    """Return the metres of a source's unit of height.

    What the user says counts first, then the band's own unit, then that of the vertical
    system: the stated one, else the file's; then metres.

    Parameters
    ----------
    stated : the datum, if the user names one
    units : what the user says

    Raises
    ------
    InputError
        When the band states a unit that is no length, or the map is in feet and nothing
        says what heights are in.
    """
    if units:
        return UNITS_M[units]
    if band:
        if band.lower() not in UNITS_M:
            advice = "state it with --units m, ft or us-ft"
            raise InputError(path, f"heights in an unknown unit {band[:40]!r}", advice)
        return UNITS_M[band.lower()]
    systems = [name for name in (stated, crs) if name and name.lower() not in _NAMES]
    for system in map(_vertical, systems):
        if system:
            return float(system.axis_info[0].unit_conversion_factor)
    if crs and "foot" in pyproj.CRS.from_user_input(crs).axis_info[0].unit_name:
        reason = "its map is in feet, and nothing says what its heights are in"
        raise InputError(path, reason, "add --units ft, us-ft or m")
    return 1.0


def _vertical(text: str) -> pyproj.CRS | None:
    crs = pyproj.CRS.from_user_input(text)
    parts = crs.sub_crs_list if crs.is_compound else [crs]
    return next((part for part in parts if part.is_vertical), None)


def require_way(path: str | Path, datum: str, bounds_deg: Box) -> None:
    """Refuse a datum from which PROJ can't get to the ellipsoid here and now.

    Raises
    ------
    InputError
        It names the grid that is not installed.
    """
    try:
        vertical = _vertical(f"EPSG:{CODES[datum]}" if datum in CODES else datum)
    except pyproj.exceptions.CRSError:
        vertical = None
    if vertical is None:
        raise InputError(path, f"unknown vertical datum {datum!r}", ADVICE)
    if vertical.axis_info[0].direction != "up":
        raise InputError(path, f"{vertical.name} are depths, not heights", ADVICE)
    if ways_of(datum):
        return
    grid = _missing_grid(vertical, bounds_deg)
    reason = f"no grid for vertical datum {datum} ({vertical.name})"
    if grid is None:
        raise InputError(path, f"{reason}: PROJ has none for there", ADVICE)
    raise InputError(path, reason, f"run `pyproj sync --file {grid}`, or {ADVICE}")


@cache
def ways_of(datum: str) -> tuple[pyproj.Transformer, ...]:
    """Return PROJ's ways from a datum to the ellipsoid whose grids are installed."""
    group = _group(_vertical(f"EPSG:{CODES[datum]}" if datum in CODES else datum))
    return tuple(group.transformers)


def _group(vertical: pyproj.CRS | None, bounds_deg: Box = GLOBE) -> TransformerGroup:
    both = pyproj.crs.CompoundCRS("heights", [pyproj.CRS(4326), vertical])
    return ways_between(both, pyproj.CRS(4979), area_of(bounds_deg))


def _missing_grid(vertical: pyproj.CRS, bounds_deg: Box) -> str | None:
    """Name the file that is enough to know a datum there, of those that PROJ hands out."""
    missing = [
        [grid for grid in way.grids if not grid.available]
        for way in _group(vertical, bounds_deg).unavailable_operations
    ]
    lists = [grids for grids in missing if grids and all(grid.url for grid in grids)]
    return min(lists, key=len)[0].short_name if lists else None


@cache
def _grid(datum: str) -> Floats:
    """Read a geoid grid of the whole globe: rows from 90 N, columns from 180 W, m."""
    try:
        with rasterio.open(GRIDS[datum], driver="GTiff") as dataset:
            stored = dataset.read(1).astype(np.float64)
            return np.asarray(stored * dataset.scales[0] + dataset.offsets[0])
    except RasterioError as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            GRIDS[datum], f"geoid grid can't be read ({reason})", "install geopage again"
        ) from error


def undulation_m(datum: str, lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Height of the datum's zero surface above the ellipsoid, in metres.

    Parameters
    ----------
    lon_rad, lat_rad : float64 of one shape
    """
    if datum == "ellipsoid":
        return np.zeros(np.broadcast(lon_rad, lat_rad).shape)
    lon, lat = np.broadcast_arrays(lon_rad, lat_rad)
    if datum not in GRIDS:
        return _by_proj(datum, lon, lat)
    found = _bilinear(_grid(datum), lon.ravel() + 0.0, lat.ravel() + 0.0)
    return np.asarray(found.reshape(lon.shape))


def _by_proj(datum: str, lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Ask PROJ; NaN where no installed grid reaches."""
    found = np.full(lon_rad.shape, np.nan)
    lon, lat = np.degrees(lon_rad), np.degrees(lat_rad)
    for way in ways_of(datum):
        lost = ~np.isfinite(found)
        if lost.any():
            height = way.transform(lon[lost], lat[lost], np.zeros(int(lost.sum())))[2]
            found[lost] = np.where(np.isfinite(height), height, np.nan)
    return found


@kernel
def _bilinear(grid: Floats, lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Interpolate a grid of the globe as PROJ's `vgridshift` does, (n,) m."""
    height, width = grid.shape
    out = np.empty(len(lon_rad))
    for i in range(len(lon_rad)):
        turns = lon_rad[i] / (2.0 * np.pi) + 0.5
        x = (turns - np.floor(turns)) * width
        y = min(max(0.5 - lat_rad[i] / np.pi, 0.0), 1.0) * (height - 1)
        c, r = int(x), min(int(y), height - 2)
        fx, fy = x - c, y - r
        c = c if c < width else 0
        east = c + 1 if c + 1 < width else 0
        north = grid[r, c] * (1.0 - fx) + grid[r, east] * fx
        south = grid[r + 1, c] * (1.0 - fx) + grid[r + 1, east] * fx
        out[i] = north * (1.0 - fy) + south * fy
    return out
