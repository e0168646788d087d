# SPDX-License-Identifier: Apache-2.0
"""Everything that a store knows about a place."""

from itertools import pairwise
from typing import Any

import numpy as np

from tiles import cells
from tiles.errors import InputError
from tiles.frames import Floats, Ints
from tiles.query import Standing
from tiles.store import Store
from tiles.surface import Surface
from tiles.winner import Winners


class Places:
    """Answers questions about places of one store. Thread: the one that made it."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._surface = Surface(store)
        self._standing = Standing(store)
        self._winners = Winners(store)

    def at(self, lon_deg: Floats, lat_deg: Floats) -> list[dict[str, Any]]:
        """Return height, error, level, source, linked cells and objects of each place.

        Parameters
        ----------
        lon_deg, lat_deg : (n,) float64; longitudes may be whole rounds off

        Raises
        ------
        TileFault
        InputError
            When a place is no finite number.
        """
        if not (np.isfinite(lon_deg).all() and np.isfinite(lat_deg).all()):
            raise InputError("place", "not a finite number", "check the places")
        lon_rad, lat_rad = np.radians(lon_deg), np.radians(lat_deg)
        height, error = self._surface.heights(lon_rad, lat_rad)
        linked, objects = self._linked(lon_rad, lat_rad), self.objects_at(lon_deg, lat_deg)
        winners = self._winners.at(lon_rad, lat_rad)
        columns = (
            lat_deg.tolist(), lon_deg.tolist(), height.tolist(), error.tolist(),
            self._levels(lon_rad, lat_rad), winners, linked, objects,
        )  # fmt: skip
        return [
            {
                "lat_deg": lat,
                "lon_deg": lon,
                "height_m": height_m,
                "error_m": error_m,
                "level": level,
                "source": winner.source,
                "feathered": winner.feathered,
                "linked_cells": texts,
                "objects": standing,
            }
            for lat, lon, height_m, error_m, level, winner, texts, standing in zip(
                *columns, strict=True
            )
        ]

    def objects_at(self, lon_deg: Floats, lat_deg: Floats) -> list[list[dict[str, Any]]]:
        """Return the objects at each place, (n,), with their attributes.

        Raises
        ------
        TileFault
        """
        place, number = self._standing.at(np.radians(lon_deg), np.radians(lat_deg))
        known = {one["id"]: one for one in self._store.objects(np.unique(number).tolist())}
        return [
            [known[one] for one in some if one in known]
            for some in _split(place, number.tolist(), len(lon_deg))
        ]

    def _levels(self, lon_rad: Floats, lat_rad: Floats) -> list[int | None]:
        rows = self._surface.rows(lon_rad, lat_rad)
        if not len(self._surface.forest.records):
            return [None] * len(rows)
        level = cells.level(self._surface.forest.records["cell"][rows])
        return [
            one if row >= 0 else None
            for one, row in zip(level.tolist(), rows.tolist(), strict=True)
        ]

    def _linked(self, lon_rad: Floats, lat_rad: Floats) -> list[list[str]]:
        place, row = self._standing.linked(lon_rad, lat_rad)
        cell = self._standing.forest.records["cell"]
        unique, which = np.unique(row, return_inverse=True)
        texts = [cells.text(int(one)) for one in cell[unique]]
        return _split(place, [texts[k] for k in which.tolist()], len(lon_rad))


def _split(place: Ints, values: list[Any], count: int) -> list[list[Any]]:
    """Return the values of each of `count` places; `place` is sorted."""
    start = np.searchsorted(place, np.arange(count + 1)).tolist()
    return [values[a:b] for a, b in pairwise(start)]
