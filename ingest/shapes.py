# SPDX-License-Identifier: Apache-2.0
"""What is drawn, before it is a mesh: footprints with heights above the ellipsoid."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.extrude import Prisms, extrude
from ingest.footprints import Geometries
from ingest.proxies import Boxes, leaning
from ingest.proxy_solids import Solids, low_roofs_m, solids_of
from ingest.repair import size_m
from ingest.solids import mixed, solid_prisms
from tiles.frames import Floats, Ints


@dataclass(frozen=True, slots=True)
class Shapes:
    """n buildings, or boxes that stand for some; heights above the ellipsoid, m."""

    polygon: Geometries
    """(n,) degrees"""
    foot_m: Floats
    """(n,) where walls begin, the plinth included"""
    ground_m: Floats
    top_m: Floats
    solid: NDArray[np.object_]
    """(n,) bodies of city models, None for prisms"""
    lean: Floats
    """(n, 2) rise to the east and to the north, m/m: boxes lean as their ground does"""

    def take(self, order: Ints | slice) -> "Shapes":
        """Return some of them, or all in another order."""
        return Shapes(
            self.polygon[order],
            self.foot_m[order],
            self.ground_m[order],
            self.top_m[order],
            self.solid[order],
            self.lean[order],
        )

    @classmethod
    def joined(cls, parts: Sequence["Shapes"]) -> Self:
        """Return all of them, one part after the other."""
        return cls(
            np.concatenate([np.zeros(0, object), *(one.polygon for one in parts)]),
            np.concatenate([np.zeros(0), *(one.foot_m for one in parts)]),
            np.concatenate([np.zeros(0), *(one.ground_m for one in parts)]),
            np.concatenate([np.zeros(0), *(one.top_m for one in parts)]),
            np.concatenate([np.zeros(0, object), *(one.solid for one in parts)]),
            np.concatenate([np.zeros((0, 2)), *(one.lean for one in parts)]),
        )

    @classmethod
    def of_boxes(cls, boxes: Boxes) -> Self:
        """Return boxes as shapes."""
        none = np.full(len(boxes.group), None, object)
        heights = boxes.foot_m, boxes.ground_m, boxes.top_m
        return cls(boxes.polygon, *heights, none, boxes.lean)

    def prisms(self) -> Prisms:
        """Return their meshes."""
        has_solid = np.array([one is not None for one in self.solid], bool)
        if not has_solid.any():
            return self._plain()
        solid, plain = np.flatnonzero(has_solid), np.flatnonzero(~has_solid)
        low_m = np.maximum(self.foot_m, self.ground_m)[solid]
        bodies = solid_prisms(
            self.solid[solid].tolist(),
            *centres_deg(self.polygon[solid]),
            low_m,
            low_m - self.foot_m[solid],
        )
        return mixed(self.take(plain)._plain(), plain, bodies, solid)

    def _plain(self) -> Prisms:
        prisms = extrude(self.polygon, self.foot_m, self.top_m, self.ground_m)
        if not self.lean.any():
            return prisms
        return leaning(prisms, np.column_stack(centres_deg(self.polygon)), self.lean)

    def solids(self, prisms: Prisms) -> Solids:
        """Return what proxies need to know about them; `prisms` are their meshes."""
        has_solid = np.array([one is not None for one in self.solid], bool)
        low_top_m = np.where(has_solid, low_roofs_m(prisms), self.top_m)
        heights = self.foot_m, self.ground_m, self.top_m
        return solids_of(self.polygon, *heights, low_top_m, self.lean)


def dimensions_m(polygon: Geometries, height_m: Floats) -> Floats:
    """Return bounding dimensions, (n,) m: the largest of width, length and height."""
    return np.maximum(np.maximum(*size_m(polygon)), height_m)


def centres_deg(polygon: Geometries) -> tuple[Floats, Floats]:
    """Return longitude and latitude of the middle of each polygon's box, degrees."""
    west, south, east, north = shapely.bounds(polygon).reshape(-1, 4).T
    return (west + east) / 2, (south + north) / 2


def turned_home(polygon: Geometries) -> Geometries:
    """Turn footprints whose middle is beyond longitude +-180 once round the earth.

    One across the antimeridian then goes on beyond 180 by less than half its width, and
    buildings of one cell have longitudes next to each other.
    """
    lon, _ = centres_deg(polygon)
    if ((lon >= -180) & (lon < 180)).all():
        return polygon
    polygon, round_deg = polygon.copy(), np.array((360.0, 0.0))
    for beyond, turn in ((lon < -180, round_deg), (lon >= 180, -round_deg)):
        polygon[beyond] = _moved(polygon[beyond], turn)
    return polygon


def _moved(polygon: Geometries, by: Floats) -> Geometries:
    return np.asarray(shapely.transform(polygon, lambda xy: xy + by), object)
