# SPDX-License-Identifier: Apache-2.0
"""From elevations above a geoid to heights above the ellipsoid."""

from functools import cache
from pathlib import Path

import numpy as np
import pyproj
import rasterio
from rasterio.errors import RasterioError

from tiles.errors import InputError
from tiles.frames import Floats
from tiles.kernels import kernel
from tiles.samples import SAMPLES

GRIDS = {"egm96": SAMPLES / "egm96_15.tif"}
EPSG = {5773: "egm96", 5171: "egm96", 3855: "egm2008", 4979: "ellipsoid", 4326: "ellipsoid"}
UNITS_M = {
    "ft": 0.3048,
    "foot": 0.3048,
    "us-ft": 1200 / 3937,
    "us survey foot": 1200 / 3937,
}
UNITS_M |= {"cm": 0.01, "centimetre": 0.01, "dm": 0.1, "mm": 0.001, "km": 1000.0}
"""Units that a band may state; metres otherwise."""
ADVICE = "state one with --datum egm96 or --datum ellipsoid"


def datum_of(path: str | Path, stated: str | None, file_crs: str | None) -> str:
    """Return the vertical datum of a source: as stated, else as its file says.

    Returns
    -------
    "egm96" or "ellipsoid"

    Raises
    ------
    InputError
        When neither knows it, or the datum's grid is not installed.
    """
    found = _stated(stated) if stated else _of_crs(file_crs)
    if found is None:
        reason = (
            f"unknown vertical datum {stated!r}" if stated else "vertical datum not known"
        )
        raise InputError(path, reason, ADVICE)
    if found not in {"ellipsoid", *GRIDS}:
        raise InputError(path, f"no grid for vertical datum {found}", ADVICE)
    return found


def _stated(text: str) -> str | None:
    name = text.lower()
    if name.startswith("epsg:") and name[5:].isdigit():
        return EPSG.get(int(name[5:]), name)
    return name if name in {"egm96", "egm2008", "ellipsoid"} else None


def _of_crs(wkt: str | None) -> str | None:
    crs = pyproj.CRS.from_user_input(wkt) if wkt else None
    if crs is None:
        return None
    if crs.is_compound:
        code = crs.sub_crs_list[1].to_epsg()
        return EPSG.get(code, f"epsg:{code}") if code else crs.sub_crs_list[1].name
    return "ellipsoid" if len(crs.axis_info) == 3 else None


def unit_m(stated: str | None, file_crs: str | None, band_unit: str | None) -> float:
    """Return the metres of a source's unit of height.

    A stated datum is metres, unless the file itself says what its band holds.
    """
    if band_unit:
        return UNITS_M.get(band_unit.lower(), 1.0)
    crs = pyproj.CRS.from_user_input(file_crs) if file_crs and not stated else None
    vertical = crs.sub_crs_list[1] if crs is not None and crs.is_compound else None
    return float(vertical.axis_info[0].unit_conversion_factor) if vertical else 1.0


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
    found = _bilinear(_grid(datum), lon.ravel() + 0.0, lat.ravel() + 0.0)
    return np.asarray(found.reshape(lon.shape))


@kernel
def _bilinear(grid: Floats, lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Interpolate a grid of the globe as PROJ's `vgridshift` does, (n,) m."""
    height, width = grid.shape
    out = np.empty(len(lon_rad))
    for i in range(len(lon_rad)):
        x = (lon_rad[i] / (2.0 * np.pi) + 0.5) % 1.0 * width
        y = min(max(0.5 - lat_rad[i] / np.pi, 0.0), 1.0) * (height - 1)
        c, r = int(x), min(int(y), height - 2)
        fx, fy = x - c, y - r
        c, east = c % width, (c + 1) % width
        north = grid[r, c] * (1.0 - fx) + grid[r, east] * fx
        south = grid[r + 1, c] * (1.0 - fx) + grid[r + 1, east] * fx
        out[i] = north * (1.0 - fy) + south * fy
    return out
