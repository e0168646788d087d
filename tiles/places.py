# SPDX-License-Identifier: Apache-2.0
"""Everything that a store knows about a place."""

from typing import Any

import numpy as np

from tiles import cells
from tiles.forest import build_forest
from tiles.frames import Floats
from tiles.lanes import Lane
from tiles.query import linked_rows, objects_at
from tiles.store import Store
from tiles.surface import Surface
from tiles.winner import Winners


class Places:
    """Answers questions about places of one store. Thread: the one that made it."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._surface = Surface(store)
        self._objects = build_forest(store.index(Lane.OBJECTS))
        self._winners = Winners(store)

    def at(self, lon_deg: Floats, lat_deg: Floats) -> list[dict[str, Any]]:
        """Return height, error, level, source, linked cells and objects of each place."""
        lon_rad, lat_rad = np.radians(lon_deg), np.radians(lat_deg)
        height, error = self._surface.heights(lon_rad, lat_rad)
        rows = self._surface.rows(lon_rad, lat_rad)
        found = []
        for i in range(len(height)):
            place = float(lon_rad[i]), float(lat_rad[i])
            linked = self._objects.records["cell"][linked_rows(self._objects, *place)]
            cell = self._surface.forest.records["cell"][rows[i]] if rows[i] >= 0 else None
            winner = self._winners.at(*place)
            ids = objects_at(self._store, self._objects, *place)
            found.append(
                {
                    "lat_deg": float(lat_deg[i]),
                    "lon_deg": float(lon_deg[i]),
                    "height_m": float(height[i]),
                    "error_m": float(error[i]),
                    "level": None if cell is None else int(cells.level(cell)),
                    "source": winner.source,
                    "feathered": winner.feathered,
                    "linked_cells": [cells.text(int(one)) for one in linked],
                    "objects": self._store.objects(ids),
                }
            )
        return found
