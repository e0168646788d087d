# SPDX-License-Identifier: Apache-2.0
"""What is stored of a terrain tile: the surface that is drawn, and its error."""

import sqlite3

import numpy as np
from numpy.typing import NDArray

from ingest.terrain_mesh import CORNERS, Surface
from tiles import terrain


def stored_surface(connection: sqlite3.Connection, record: NDArray[np.void]) -> Surface:
    """Read the surface of the tile that an index record names."""
    ask = "SELECT body FROM tile WHERE row=?"
    body = connection.execute(ask, (int(record["row"]),)).fetchone()[0]
    tile = terrain.decode(body)
    triangles = tile.surface()
    # A corner at a pole may be of no triangle that is stored.
    count = max(int(triangles.max()) + 1, len(CORNERS))
    at = tile.mesh.vertices["detail"][:count].astype(np.int64)
    steps = tile.mesh.vertices["position"][:count]
    return Surface(
        cell=tile.cell,
        centre=tile.mesh.centre,
        steps=steps,
        scale_m=tile.mesh.scale_m,
        at=at,
        triangles=triangles.astype(np.int64),
        border=np.zeros((0, 2), np.int64),
        used=np.arange(count),
        weight_m=np.full(count, np.inf),
        across=np.full(triangles.shape, -1),
        fresh=np.ones(len(triangles), np.bool_),
    )


def rounded_up(error_m: float) -> float:
    """Return the next float32, as which it is stored: an error never gets smaller."""
    stored = np.float32(error_m)
    above = np.nextafter(stored, np.float32(np.inf))
    return float(stored if stored >= error_m else above)
