# SPDX-License-Identifier: Apache-2.0
"""One surface out of nested sources: the finest wins, the coarser bends to meet it.

Around each finer source the coarser surface is bent by a delta surface: along the
source's rim the difference is known; it is carried outwards by inverse-distance
weighting and faded to nothing over the feather distance, which is one post spacing of
the coarser source: what that source can't know anyway.

References
----------
Grohman, Kroenung and Strebeck 2006, Filling SRTM Voids: The Delta Surface Fill Method,
Photogrammetric Engineering & Remote Sensing 72(3).
"""

import sqlite3
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.datum import undulation_m
from ingest.layer import Layer
from tiles.frames import WGS84_A_M, Floats
from tiles.kernels import kernel

RIM_POSTS = 4000
RIM_SEARCH = 2_000_000


@dataclass(frozen=True, slots=True)
class Rim:
    """What bends the coarser surface around one finer source."""

    feather_m: float
    lon_rad: Floats
    """(n,) places on the rim"""
    lat_rad: Floats
    delta_m: Floats
    """(n,) finer minus coarser surface there"""


class Mosaic:
    """The terrain of a store as a function of longitude and latitude."""

    def __init__(
        self, connection: sqlite3.Connection, sources: list[dict[str, Any]]
    ) -> None:
        terrain = [Layer(connection, s) for s in sources if s["kind"] == "terrain"]
        self.layers = sorted(terrain, key=lambda layer: -layer.spacing_m)
        """coarsest first"""
        self._rims: list[Rim | None] = []
        for layer in self.layers:
            self._rims.append(None if layer.wraps else self._rim_of(layer))

    def heights(self, lon_rad: Floats, lat_rad: Floats, step_m: float) -> Floats:
        """Return heights above the ellipsoid, (n,) float64; sea level where no source is."""
        return self._fold(lon_rad, lat_rad, step_m, len(self._rims))

    def _fold(self, lon_rad: Floats, lat_rad: Floats, step_m: float, count: int) -> Floats:
        surface = undulation_m("egm96", lon_rad, lat_rad)
        for layer, rim in zip(self.layers[:count], self._rims[:count], strict=True):
            own = layer.heights(lon_rad, lat_rad, step_m)
            outside = np.isnan(own)
            if rim:
                near = layer.near(lon_rad, lat_rad, rim.feather_m)
                at = np.flatnonzero(outside & near)
                surface[at] += bend(rim, lon_rad[at], lat_rad[at])
            surface = np.where(outside, surface, own)
        return surface

    def spacing_m(self, lon_rad: Floats, lat_rad: Floats) -> Floats:
        """Return the post spacing of the source that wins at each place, inf at none."""
        found = np.full(lon_rad.shape, np.inf)
        for layer in self.layers:
            known = np.isfinite(layer.heights(lon_rad, lat_rad, 0.0))
            found[known] = layer.spacing_m
        return found

    def reach_m(self, layer: Layer) -> float:
        """Return how far outside its own posts a source changes the surface."""
        rim = self._rims[self.layers.index(layer)]
        return rim.feather_m if rim else 0.0

    def _rim_of(self, layer: Layer) -> Rim | None:
        """Find the posts next to no data or to the raster's edge, and the difference there."""
        count = len(self._rims)
        lon, lat, fine = layer.rim(RIM_SEARCH, RIM_POSTS)
        if not len(lon):
            return None
        coarse = self._fold(lon, lat, layer.spacing_m, count)
        coarser = [c.spacing_m for c in self.layers[:count] if c.near(lon, lat).any()]
        feather_m = min(coarser) if coarser else 10 * layer.spacing_m
        return Rim(feather_m, lon, lat, fine - coarse)


def bend(rim: Rim, lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Return what the delta surface adds to the coarser surface, (n,) m."""
    if not len(lon_rad):
        return np.zeros(0)
    lat0 = float(rim.lat_rad.mean())
    scale = np.array([WGS84_A_M * np.cos(lat0), WGS84_A_M])
    lon0 = float(rim.lon_rad[0])
    turn = 2 * np.pi

    def plane(lon: Floats, lat: Floats) -> NDArray[np.float64]:
        east = (lon - lon0 + np.pi) % turn - np.pi
        return np.ascontiguousarray(np.stack([east, lat - lat0], axis=1) * scale)

    rim_xy, xy = plane(rim.lon_rad, rim.lat_rad), plane(lon_rad, lat_rad)
    return _weighted(rim_xy, rim.delta_m, xy, rim.feather_m)


@kernel
def _weighted(rim: Floats, delta: Floats, places: Floats, feather_m: float) -> Floats:
    """Inverse-cube-distance mean of the rim's deltas, faded by a smooth step."""
    out = np.zeros(len(places))
    for i in range(len(places)):
        total, weights, nearest = 0.0, 0.0, np.inf
        for j in range(len(rim)):
            dx, dy = places[i, 0] - rim[j, 0], places[i, 1] - rim[j, 1]
            squared = dx * dx + dy * dy + 1e-6
            weight = 1.0 / (squared * np.sqrt(squared))
            total += weight * delta[j]
            weights += weight
            nearest = min(nearest, squared)
        t = np.sqrt(nearest) / feather_m
        if t < 1.0:
            out[i] = total / weights * (1.0 - t * t * (3.0 - 2.0 * t))
    return out
