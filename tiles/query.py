# SPDX-License-Identifier: Apache-2.0
"""Which objects stand at a place: linked cells instead of a search.

An object lives once, in the cell of its centre, and is smaller than that cell; so at
each level only the place's own cell and the three nearest to its quadrant can hold an
object that covers it (VGIS 1999, section 3). Objects that fit no cell live at their
zone's root; near a pole all eight roots of the polar row are asked.
"""

from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from tiles import cells, links, objects, zones
from tiles.errors import TileFault
from tiles.footprints import Footprints, covering, read_footprints
from tiles.forest import Forest, build_forest
from tiles.frames import Floats, Ints
from tiles.lanes import Lane
from tiles.store import Store

NEAR_POLE_RAD = np.radians(80.0)
CACHE_CELLS = 256
PLACES_AT_ONCE = 1 << 16
_ROWS = 1 << 32
"""More than a forest has rows."""


class Standing:
    """Finds the objects at places of one store. Thread: the one that made it."""

    def __init__(self, store: Store, forest: Forest | None = None) -> None:
        self._store = store
        self.forest = forest or build_forest(store.index(Lane.OBJECTS))
        self._homes = homes_of(self.forest)
        self._cache: OrderedDict[int, Footprints] = OrderedDict()

    def linked(self, lon_rad: Floats, lat_rad: Floats) -> tuple[Ints, Ints]:
        """Return every pair of a place and one of its linked cells that holds objects.

        Parameters
        ----------
        lon_rad, lat_rad : (p,) float64

        Returns
        -------
        place, row : (k,) int64 numbers of places and rows of `forest`, by place, then row
        """
        pairs = []
        for first in range(0, len(lon_rad), PLACES_AT_ONCE):
            part = slice(first, first + PLACES_AT_ONCE)
            found = self._homes.around(lon_rad[part], lat_rad[part])
            pairs.append(found + np.array([[first], [0]]))
        place, row = np.concatenate(pairs, axis=1) if pairs else np.zeros((2, 0), np.int64)
        return place, row

    def at(self, lon_rad: Floats, lat_rad: Floats) -> tuple[Ints, Ints]:
        """Return every pair of a place and an object whose footprint covers it.

        Parameters
        ----------
        lon_rad, lat_rad : (p,) float64

        Returns
        -------
        place, id : (k,) int64, by place, then id

        Raises
        ------
        TileFault
        """
        place, row = self.linked(lon_rad, lat_rad)
        lon_deg, lat_deg = np.degrees(lon_rad), np.degrees(lat_rad)
        by_row = np.argsort(row, kind="stable")
        place, row = place[by_row], row[by_row]
        first = np.flatnonzero(np.diff(row, prepend=-1))
        pairs = [np.zeros((2, 0), np.int64)]
        for k, there in zip(first, np.split(place, first[1:]), strict=False):
            footprints = self.footprints(int(row[k]))
            at, which = covering(footprints, lon_deg[there], lat_deg[there])
            pairs.append(np.stack((there[at], footprints.id[which])))
        found = np.concatenate(pairs, axis=1)
        place, number = found[:, np.lexsort(found[::-1])]
        return place, number

    def nearest(self, lon_rad: float, lat_rad: float) -> int | None:
        """Return the object of the linked cells whose box is nearest to a place.

        Raises
        ------
        TileFault
        """
        place = np.array([lon_rad]), np.array([lat_rad])
        near = [self.footprints(row) for row in self.linked(*place)[1].tolist()]
        if not near:
            return None
        number = np.concatenate([one.id for one in near])
        west, south, east, north = np.concatenate([one.bounds_deg for one in near]).T
        lon, lat = np.degrees(lon_rad), np.degrees(lat_rad)
        off = (lon - (west + east) / 2 + 180) % 360 - 180
        aside = np.maximum(np.abs(off) - (east - west) / 2, 0) * np.cos(lat_rad)
        beyond = np.maximum(np.maximum(south - lat, lat - north), 0)
        return int(number[np.hypot(aside, beyond).argmin()])

    def footprints(self, row: int) -> Footprints:
        """Return the footprints of a cell's own objects, as its tile names them.

        Raises
        ------
        TileFault
        """
        if row in self._cache:
            self._cache.move_to_end(row)
            return self._cache[row]
        record = self.forest.records[row]
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        tile = objects.decode(self._store.checked_body(Lane.OBJECTS, *key))
        stored = self._store.footprints(tile.objects["id"].tolist())
        try:
            found = read_footprints(stored)
        except ValueError as error:
            raise TileFault(Lane.OBJECTS.name, cells.text(key[0]), str(error)) from error
        self._cache[row] = found
        if len(self._cache) > CACHE_CELLS:
            self._cache.popitem(last=False)
        return found


class Homes:
    """The cells that hold objects of their own, sorted by id."""

    def __init__(self, cell: Ints, row: Ints) -> None:
        self._cell, self._row = cell, row
        self._levels: list[int] = np.unique(cells.level(cell)).tolist()

    def around(self, lon_rad: Floats, lat_rad: Floats) -> Ints:
        """Return pairs of place and row of a linked cell, (2, k), by place, then row."""
        pairs = [np.zeros((2, 0), np.int64)]
        place = np.arange(len(lon_rad))
        for level in self._levels:
            linked = links.linked_cells(lon_rad, lat_rad, level)
            pairs.append(self._there(np.repeat(place, linked.shape[1]), linked.ravel()))
        if 0 in self._levels:
            polar = np.flatnonzero(np.abs(lat_rad) > NEAR_POLE_RAD)
            roots = polar_roots(lat_rad[polar])
            pairs.append(self._there(np.repeat(polar, roots.shape[1]), roots.ravel()))
        place, row = np.concatenate(pairs, axis=1)
        return np.stack(np.divmod(np.unique(place * _ROWS + row), _ROWS))

    def _there(self, place: Ints, cell: Ints) -> Ints:
        at = np.minimum(np.searchsorted(self._cell, cell), len(self._cell) - 1)
        known = self._cell[at] == cell
        return np.stack((place[known], self._row[at[known]]))


def homes_of(forest: Forest) -> Homes:
    """Return the cells of a forest that hold objects of their own."""
    row = np.flatnonzero(forest.records["own_dimension_m"] > 0)
    cell = forest.records["cell"][row]
    by_id = np.argsort(cell)
    return Homes(cell[by_id], row[by_id])


def polar_roots(lat_rad: Floats) -> NDArray[np.int64]:
    """Return the zone roots around the pole that is nearer to each place, (p, 8)."""
    roots = cells.make(
        zones.zone_of(
            np.array((0, zones.ROWS - 1))[:, np.newaxis], np.arange(zones.COLUMNS)
        ),
        0,
        0,
        0,
    )
    return np.asarray(roots[(lat_rad > 0).astype(np.int64)])
