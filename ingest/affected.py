# SPDX-License-Identifier: Apache-2.0
"""Which cells' tiles a change of sources changes; all others stay as they are."""

from functools import lru_cache

import numpy as np

from ingest.boxes import Box, edge_m, edges_rad, grown, overlap
from ingest.changed import Change
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.rim import Rim
from ingest.source_group import SourceGroup
from ingest.terrain_tile import LEAF_SIDE, LEAST_RELIEF_SIDE, RELIEF_SIDE
from tiles.frames import Ecef, Floats
from tiles.geodesy import to_ecef

POSTS, MOST_APART = 4.0, 3.0 / LEAF_SIDE
"""Posts around a cell that count for it, too, where they are no further apart than so
many of its edges"""
STEPS = 8
"""Along a cell's edge, between places where it is asked what shows there"""


class Affected:
    """Says of cells whether a change reaches them."""

    def __init__(self, mosaic: Mosaic, change: Change) -> None:
        self._mosaic, self._change = mosaic, change
        rims: list[tuple[Rim | None, SourceGroup | Layer]] = []
        for group in mosaic.groups:
            rims += [(group.outer, group), *zip(group.inner, group.layers, strict=True)]
        self._bent = [(rim, owner) for rim, owner in (rims[k] for k in change.rims) if rim]
        self._widest_m = max((layer.spacing_m for layer in mosaic.layers), default=0.0)
        self._share = lru_cache(65536)(self._share_around)
        self.touches = lru_cache(65536)(self._touches)
        """whether a cell's tile may change: never no where it does"""

    def _touches(self, cell: int) -> bool:
        share = self._share(cell)
        if _meet(cell, self._change.pictures, share) or self._reaches(cell, 0.0):
            return True
        if not self._reaches(cell, self._widest_m):
            return False
        # Relief is shaded over as much as the spacing of the source that shows.
        lon, lat = _places(cell)
        spacing_m = self._mosaic.spacing_m(lon, lat)
        wide_m = float(spacing_m[np.isfinite(spacing_m)].max(initial=0.0))
        return bool(wide_m) and self._reaches(cell, wide_m)

    def _reaches(self, cell: int, margin_m: float) -> bool:
        """Say whether changed ground lies within a margin of a cell."""
        share = self._share(cell)
        boxes = [grown(box, margin_m) for box in self._change.ground]
        if _meet(cell, boxes, share):
            return True
        return any(_is_bent(cell, share, *one, margin_m) for one in self._bent)

    def _share_around(self, cell: int) -> float:
        """Return how much around a cell counts for its mesh and relief, of its edge."""
        there = [one for one in self._mosaic.layers if overlap(cell, one.bounds_deg)]
        posts = [one.spacing_m / edge_m(cell) for one in there]
        relief = min(max(posts, default=0.0), 1.0 / LEAST_RELIEF_SIDE)
        mesh = [POSTS * one for one in posts if one < MOST_APART]
        return max(relief, 1.0 / RELIEF_SIDE, *mesh)


def _is_bent(
    cell: int, share: float, rim: Rim, owner: SourceGroup | Layer, margin_m: float
) -> bool:
    """Say whether a rim may bend places within a margin of a cell."""
    layers = owner.layers if isinstance(owner, SourceGroup) else [owner]
    reach_m = rim.feather_m + margin_m
    if not _meet(cell, [grown(one.bounds_deg, reach_m) for one in layers], share):
        return False
    centre, radius_m = _ball(cell)
    radius_m *= 1.0 + 2.0 * share
    limit_m = radius_m + reach_m
    near_m = rim.distance_m(centre, limit_m)
    if near_m >= limit_m:
        return False
    if near_m <= radius_m + rim.spacing_m:
        return True
    # No rim in the cell: it lies on posts wholly, or not at all.
    lon, lat = (one[[len(one) // 2]] for one in _places(cell))
    return bool(np.isnan(owner.heights(lon, lat, 0.0)).any())


@lru_cache(4096)
def _places(cell: int) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes of a lattice over a cell, rad."""
    west, south, east, north = edges_rad(cell)
    lon, lat = np.meshgrid(
        np.linspace(west, east, STEPS + 1), np.linspace(south, north, STEPS + 1)
    )
    return lon.ravel(), lat.ravel()


@lru_cache(4096)
def _ball(cell: int) -> tuple[Ecef, float]:
    """Return a ball on the ellipsoid around a cell, centre and radius."""
    points = to_ecef(*_places(cell), 0.0)
    centre = points[len(points) // 2]
    far_m = float(np.linalg.norm(points - centre, axis=1).max())
    return Ecef(centre), far_m


def _meet(cell: int, boxes: list[Box], share: float) -> bool:
    """Say whether boxes have a part in common with a cell and a share of it around it."""
    if not boxes:
        return False
    w, s, e, n = np.radians(boxes).T
    for west, south, east, north in _around(cell, share):
        high = np.maximum(s, south) < np.minimum(n, north)
        turns = [
            np.maximum(w + off, west) < np.minimum(e + off, east)
            for off in (-2 * np.pi, 0.0, 2 * np.pi)
        ]
        if (high & np.logical_or.reduce(turns)).any():
            return True
    return False


def _around(cell: int, share: float) -> list[Box]:
    """Return a cell and what is around it as boxes, rad; a pole's has all longitudes."""
    west, south, east, north = edges_rad(cell)
    wide, high = share * (east - west), share * (north - south)
    boxes = [(west - wide, south - high, east + wide, north + high)]
    if north + high > np.pi / 2:
        boxes.append((-np.pi, np.pi / 2 - high, np.pi, np.pi))
    if south - high < -np.pi / 2:
        boxes.append((-np.pi, -np.pi, np.pi, high - np.pi / 2))
    return boxes
