# SPDX-License-Identifier: Apache-2.0
"""Rings of coordinates, as JSON gives them, to shapely polygons, many at once."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
import shapely

from ingest.raw_features import Geometries
from tiles.frames import Ints

Ring = Sequence[Sequence[float]]


class Rings:
    """Collects the polygons of features and makes them in one go.

    A ring that does not end where it begins is closed. A ring of too few corners is
    filled up with its last one: it has no area, and the repair sees to it.
    """

    def __init__(self) -> None:
        self._numbers: list[float] = []
        self._corners: list[int] = []
        self._rings: list[int] = []
        self._parts: list[int] = []
        self._open = self._high = False

    def add(self, polygons: Sequence[Sequence[Ring]]) -> bool:
        """Append a feature; False (and nothing appended) where a position is too short."""
        full = [rings for rings in polygons if rings and rings[0]]
        kept = [[ring for ring in rings if ring] for rings in full]
        sizes = [set(map(len, ring)) for rings in kept for ring in rings]
        if any(min(size) < 2 for size in sizes):
            return False
        self._parts.append(len(kept))
        for rings in kept:
            self._rings.append(len(rings))
            for ring in rings:
                self._add_ring(ring)
        return True

    def _add_ring(self, ring: Ring) -> None:
        if max(map(len, ring)) > 2:
            self._high = True
            ring = [position[:2] for position in ring]
        if len(ring) < 4 or ring[0] != ring[-1]:
            self._open |= ring[0] != ring[-1]
            ring = [*ring, *[ring[-1]] * (3 - len(ring)), ring[0]]
        self._corners.append(len(ring))
        self._numbers.extend(chain.from_iterable(ring))

    def notes(self) -> tuple[str, ...]:
        """Return what was unusual about the rings."""
        notes = []
        if self._open:
            notes.append(RINGS_CLOSED)
        if self._high:
            notes.append(HEIGHTS_DROPPED)
        return tuple(notes)

    def geometries(self) -> Geometries:
        """Return a Polygon or MultiPolygon for every feature, None for one without."""
        made = np.full(len(self._parts), None, object)
        if not self._corners:
            return made
        polygons = shapely.from_ragged_array(
            shapely.GeometryType.POLYGON,
            np.array(self._numbers, np.float64).reshape(-1, 2),
            (_offsets(self._corners), _offsets(self._rings)),
        )
        parts = np.array(self._parts, np.int64)
        first = _offsets(self._parts)[:-1]
        single = parts == 1
        made[single] = polygons[first[single]]
        many = np.flatnonzero(parts > 1)
        if len(many):
            place = np.repeat(np.arange(len(parts)), parts)
            of_many = parts[place] > 1
            where = np.searchsorted(many, place[of_many])
            made[many] = shapely.multipolygons(polygons[of_many], indices=where)
        return made


RINGS_CLOSED = "rings that did not end where they begin were closed"
HEIGHTS_DROPPED = "heights in the coordinates are not used, only the outline is"


def _offsets(counts: Sequence[int]) -> Ints:
    return np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))
