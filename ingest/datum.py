# SPDX-License-Identifier: Apache-2.0
"""From elevations above a geoid to heights above the ellipsoid."""

from functools import cache
from pathlib import Path

import numpy as np
import pyproj
from pyproj.exceptions import ProjError

from tiles.errors import InputError
from tiles.frames import Floats
from tiles.samples import SAMPLES

GRIDS = {"egm96": SAMPLES / "egm96_15.tif"}
EPSG = {5773: "egm96", 5171: "egm96", 3855: "egm2008", 4979: "ellipsoid", 4326: "ellipsoid"}
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
        reason = f"unknown vertical datum {stated!r}" if stated else "vertical datum not known"
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


@cache
def _shift(datum: str) -> pyproj.Transformer:
    grid = GRIDS[datum]
    return pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
        f" +step +proj=vgridshift +grids={grid} +multiplier=1"
        " +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )


def undulation_m(datum: str, lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Height of the datum's zero surface above the ellipsoid, in metres.

    Parameters
    ----------
    lon_rad, lat_rad : float64 of one shape
    """
    if datum == "ellipsoid":
        return np.zeros(np.broadcast(lon_rad, lat_rad).shape)
    lon_deg = (np.degrees(lon_rad) + 180.0) % 360.0 - 180.0
    lat_deg = np.clip(np.degrees(lat_rad), -90.0, 90.0)
    try:
        shifted = _shift(datum).transform(lon_deg, lat_deg, np.zeros_like(lon_deg))
    except ProjError as error:
        raise InputError(GRIDS[datum], f"geoid grid can't be used ({error})", ADVICE) from error
    return np.asarray(shifted[2])
