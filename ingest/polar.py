# SPDX-License-Identifier: Apache-2.0
"""Where the texels of a cell lie: near the poles closer to its middle, so as to be square.

A cell near a pole is a wedge. Texels that divided its longitudes evenly would be as narrow
as it is, and a GPU, which blurs both ways by what the narrower side needs, would draw a
star around the pole. So beyond 45 degrees the share of its texture's width that a cell
takes goes down to nothing at the pole, as its own width does, and beside it lies what is
beside the cell. The share is a straight line over the latitude, so that an edge of the cell
is a straight line in the texture (`place` of `terrain.vert` is the same).
"""

import numpy as np

from ingest.boxes import edges_rad
from tiles.frames import Floats
from tiles.terrain import TEXTURE_SIDE

FROM_RAD = np.radians(45.0)
"""Latitude that narrowing begins at: an edge of cells of all levels"""
BESIDE = 8.0
"""Cells' widths from the middle within which texels show what is there"""
MOST_RAD = 0.75 * np.pi
"""The same for large cells: from one side to the other less than once round"""


def is_polar(cell: int) -> bool:
    """Say whether a cell's texels do not divide its longitudes evenly."""
    _, south, _, north = edges_rad(cell)
    return bool(max(north, -south) > FROM_RAD + 1e-9)


def lon_at(cell: int, u: Floats, lat_rad: Floats) -> Floats:
    """Return longitudes of places in a cell's texture, u from 0 at its left edge to 1."""
    west, south, east, north = edges_rad(cell)
    if not is_polar(cell):
        return np.asarray(west + u * (east - west))
    # The last texels at a pole are as wide as at their middle.
    least = (north - south) / (2 * TEXTURE_SIDE)
    to_pole = np.maximum(np.pi / 2 - np.abs(lat_rad), least)
    share = np.minimum(to_pole / (np.pi / 2 - FROM_RAD), 1.0)
    most = min(BESIDE * (east - west), MOST_RAD)
    away = np.clip((u - 0.5) * (east - west) / share, -most, most)
    return np.asarray((west + east) / 2 + away)


def texel_lattice(cell: int, side: int) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes of a lattice over a cell's texture.

    Returns
    -------
    (side + 3, side + 3) each, row 0 south: one more all round; clamped at poles
    """
    _, south, _, north = edges_rad(cell)
    steps = np.arange(-1, side + 2) / side
    u, lat = np.meshgrid(steps, south + steps * (north - south))
    lat = np.clip(lat, -np.pi / 2, np.pi / 2)
    return lon_at(cell, u, lat), lat
