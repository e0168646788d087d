# SPDX-License-Identifier: Apache-2.0
"""Which objects stand at a place: linked cells instead of a search.

An object lives once, in the cell of its centre, and is smaller than that cell; so at
each level only the place's own cell and the three nearest to its quadrant can hold an
object that covers it (VGIS 1999, section 3). Objects that fit no cell live at their
zone's root; near a pole all eight roots of the polar row are asked.
"""

import numpy as np
from numpy.typing import NDArray

from tiles import cells, links, objects, zones
from tiles.forest import Forest
from tiles.frames import Floats
from tiles.geodesy import enu_axes, to_ecef
from tiles.lanes import Lane
from tiles.mesh import ROOF
from tiles.objects import PROXY_ORDINAL, ObjectTile
from tiles.store import Store

NEAR_POLE_RAD = np.radians(80.0)


def linked_rows(forest: Forest, lon_rad: float, lat_rad: float) -> NDArray[np.int32]:
    """Return forest rows of all linked cells of a place that hold objects of their own."""
    records = forest.records
    if not len(records):
        return np.zeros(0, np.int32)
    deepest = int(cells.level(records["cell"]).max())
    wanted = [links.linked_cells(lon_rad, lat_rad, level) for level in range(deepest + 1)]
    if abs(lat_rad) > NEAR_POLE_RAD:
        row = zones.ROWS - 1 if lat_rad > 0 else 0
        polar = [
            cells.make(zones.zone_of(row, col), 0, 0, 0) for col in range(zones.COLUMNS)
        ]
        wanted.append(np.array(polar))
    rows = forest.row_of(np.unique(np.concatenate(wanted)))
    rows = rows[rows >= 0]
    return np.asarray(rows[records["own_dimension_m"][rows] > 0])


def objects_at(store: Store, forest: Forest, lon_rad: float, lat_rad: float) -> list[int]:
    """Return the ids of the objects whose roof covers a place.

    Raises
    ------
    TileFault
    """
    found: list[int] = []
    for row in linked_rows(forest, lon_rad, lat_rad):
        record = forest.records[row]
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        tile = objects.decode(store.checked_body(Lane.OBJECTS, *key))
        covering = covered_by(tile, lon_rad, lat_rad)
        found += tile.objects["id"][covering].tolist()
    return found


def covered_by(tile: ObjectTile, lon_rad: float, lat_rad: float) -> NDArray[np.int64]:
    """Return the ordinals of the tile's own objects with a roof above or below a place."""
    axes = enu_axes(lon_rad, lat_rad)
    foot = to_ecef(lon_rad, lat_rad, 0.0)
    plane = (tile.mesh.local + tile.mesh.centre - foot) @ axes[:2].T
    triangles = tile.mesh.indices.reshape(-1, 3)
    kind, ordinal = tile.mesh.vertices["flags"], tile.mesh.vertices["detail"][:, 1]
    first = triangles[:, 0]
    roofs = triangles[(kind[first] == ROOF) & (ordinal[first] != PROXY_ORDINAL)]
    inside = _holds_origin(plane[roofs])
    return np.unique(ordinal[roofs[inside, 0]]).astype(np.int64)


def _holds_origin(corner: Floats) -> NDArray[np.bool_]:
    """Say which triangles, (t, 3, 2), contain the origin."""
    after = np.roll(corner, -1, axis=1)
    turn = corner[..., 0] * after[..., 1] - corner[..., 1] * after[..., 0]
    return np.asarray((turn >= 0).all(axis=1) | (turn <= 0).all(axis=1))
