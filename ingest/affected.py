# SPDX-License-Identifier: Apache-2.0
"""Which cells' tiles a change of sources changes; all others stay as they are."""

from functools import lru_cache

import numpy as np

from ingest.boxes import Box, edges_rad, grown
from ingest.changed import Change
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.rim import Rim
from ingest.source_group import SourceGroup
from tiles.frames import Ecef, Floats
from tiles.geodesy import to_ecef

MARGIN = 1 / 8
"""Share of a cell's edges around it: posts and texels there count for the cell, too"""
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
        self.touches = lru_cache(65536)(self._touches)
        """whether a cell's tile may change: never no where it does"""

    def _touches(self, cell: int) -> bool:
        if _meet(cell, self._change.pictures) or self._reaches(cell, 0.0):
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
        if _meet(cell, [grown(box, margin_m) for box in self._change.ground]):
            return True
        return any(_is_bent(cell, *one, margin_m) for one in self._bent)


def _is_bent(cell: int, rim: Rim, owner: SourceGroup | Layer, margin_m: float) -> bool:
    """Say whether a rim may bend places within a margin of a cell."""
    centre, radius_m = _ball(cell)
    limit_m = radius_m + rim.feather_m + margin_m
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
    """Return a ball on the ellipsoid around a cell and its margin."""
    points = to_ecef(*_places(cell), 0.0)
    centre = points[len(points) // 2]
    far_m = float(np.linalg.norm(points - centre, axis=1).max())
    return Ecef(centre), far_m * (1.0 + 2.0 * MARGIN)


def _meet(cell: int, boxes: list[Box]) -> bool:
    """Say whether boxes have a part in common with a cell and its margin."""
    if not boxes:
        return False
    w, s, e, n = np.radians(boxes).T
    for west, south, east, north in _around(cell):
        high = np.maximum(s, south) < np.minimum(n, north)
        turns = [
            np.maximum(w + off, west) < np.minimum(e + off, east)
            for off in (-2 * np.pi, 0.0, 2 * np.pi)
        ]
        if (high & np.logical_or.reduce(turns)).any():
            return True
    return False


def _around(cell: int) -> list[Box]:
    """Return a cell and its margin as boxes, rad; a pole's has all longitudes."""
    west, south, east, north = edges_rad(cell)
    wide, high = MARGIN * (east - west), MARGIN * (north - south)
    boxes = [(west - wide, south - high, east + wide, north + high)]
    if north + high > np.pi / 2:
        boxes.append((-np.pi, np.pi / 2 - high, np.pi, np.pi))
    if south - high < -np.pi / 2:
        boxes.append((-np.pi, -np.pi, np.pi, high - np.pi / 2))
    return boxes
