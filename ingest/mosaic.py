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
from tiles.frames import Floats
from tiles.geodesy import to_ecef
from tiles.kernels import summing

CHUNK = 32
RIM_POSTS = 4000
"""A longer rim is thinned to this many posts."""


@dataclass(frozen=True, slots=True)
class Rim:
    """What bends the coarser surface around one finer source."""

    feather_m: float
    middle: NDArray[np.float64]
    """(3,) ECEF m"""
    foot: NDArray[np.float32]
    """(3, n) places on the rim around `middle`, ECEF axes, at height 0"""
    balls: NDArray[np.float32]
    """(4, n / CHUNK) centres and radii of balls around the posts, CHUNK by CHUNK"""
    delta_m: NDArray[np.float32]
    """(n,) finer minus coarser surface there"""


class Mosaic:
    """The terrain of a store as a function of longitude and latitude."""

    def __init__(
        self,
        connection: sqlite3.Connection,
        sources: list[dict[str, Any]],
        rims: "list[Rim | None] | None" = None,
    ) -> None:
        terrain = [Layer(connection, s) for s in sources if s["kind"] == "terrain"]
        self.layers = sorted(terrain, key=lambda layer: -layer.spacing_m)
        """coarsest first"""
        self.rims: list[Rim | None] = []
        """of each layer; found once an ingest and handed to its workers"""
        for layer in [] if rims else self.layers:
            self.rims.append(self._rim_of(layer))
        self.rims = rims or self.rims

    def heights(self, lon_rad: Floats, lat_rad: Floats, step_m: float) -> Floats:
        """Return heights above the ellipsoid, (n,) m; sea level where no source is."""
        return self.heights_and_sea(lon_rad, lat_rad, step_m)[0]

    def heights_and_sea(
        self, lon_rad: Floats, lat_rad: Floats, step_m: float
    ) -> tuple[Floats, Floats]:
        """Return heights above the ellipsoid, and those of sea level (EGM96) there."""
        sea = undulation_m("egm96", lon_rad, lat_rad)
        return self._fold(lon_rad, lat_rad, step_m, len(self.rims), sea), sea

    def _fold(
        self, lon_rad: Floats, lat_rad: Floats, step_m: float, count: int, sea: Floats
    ) -> Floats:
        surface = sea.copy()
        for layer, rim in zip(self.layers[:count], self.rims[:count], strict=True):
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
        rim = self.rims[self.layers.index(layer)]
        return rim.feather_m if rim else 0.0

    def _rim_of(self, layer: Layer) -> Rim | None:
        """Find the posts beside no data or the raster's edge, and the difference there."""
        count = len(self.rims)
        lon, lat, fine = layer.rim(RIM_POSTS)
        if not len(lon):
            return None
        sea = undulation_m("egm96", lon, lat)
        coarse = self._fold(lon, lat, layer.spacing_m, count, sea)
        coarser = [c.spacing_m for c in self.layers[:count] if c.near(lon, lat).any()]
        feather_m = min(coarser) if coarser else 10 * layer.spacing_m
        foot = to_ecef(lon, lat, 0.0)
        middle = foot.mean(axis=0)
        near = np.ascontiguousarray((foot - middle).T, np.float32)
        delta_m = (fine - coarse).astype(np.float32)
        return Rim(feather_m, middle, near, balls_of(near), delta_m)


def balls_of(foot: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return balls, (4, m), that hold CHUNK places each; neighbours lie side by side."""
    chunks = [foot[:, k : k + CHUNK] for k in range(0, foot.shape[1], CHUNK)]
    centre = np.stack([chunk.mean(axis=1) for chunk in chunks], axis=1)
    reach = [
        np.linalg.norm(chunk - centre[:, [k]], axis=0).max()
        for k, chunk in enumerate(chunks)
    ]
    return np.concatenate([centre, [reach]]).astype(np.float32)


def bend(rim: Rim, lon_rad: Floats, lat_rad: Floats) -> Floats:
    """Return what the delta surface adds to the coarser surface, (n,) m."""
    out = np.zeros(len(lon_rad), np.float32)
    places = (to_ecef(lon_rad, lat_rad, 0.0) - rim.middle).astype(np.float32)
    feather_m = np.float32(rim.feather_m)
    _weighted(rim.foot, rim.balls, rim.delta_m, places, feather_m, out)
    return out.astype(np.float64)


@summing
def _weighted(
    rim: NDArray[np.float32],
    balls: NDArray[np.float32],
    delta: NDArray[np.float32],
    places: NDArray[np.float32],
    feather_m: np.float32,
    out: NDArray[np.float32],
) -> None:
    """Inverse-cube-distance mean of the rim's deltas, faded by a smooth step."""
    one, tiny = np.float32(1.0), np.float32(1e-6)
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        nearest = _nearest(rim, balls, x, y, z)
        t = np.sqrt(nearest) / feather_m
        if t >= one:
            continue
        total, weights = np.float32(0.0), np.float32(0.0)
        for j in range(len(delta)):
            dx, dy, dz = x - rim[0, j], y - rim[1, j], z - rim[2, j]
            ratio = (nearest + tiny) / (dx * dx + dy * dy + dz * dz + tiny)
            weight = ratio * np.sqrt(ratio)
            total += weight * delta[j]
            weights += weight
        out[i] = total / weights * (1.0 - t * t * (3.0 - 2.0 * t))


@summing
def _nearest(
    rim: NDArray[np.float32],
    balls: NDArray[np.float32],
    x: np.float32,
    y: np.float32,
    z: np.float32,
) -> np.float32:
    """Squared distance to the nearest post; balls that can't hold it are passed over."""
    best = np.float32(1e30)
    reach = np.float32(1e15)
    for k in range(balls.shape[1]):
        dx, dy, dz = x - balls[0, k], y - balls[1, k], z - balls[2, k]
        limit = reach + balls[3, k]
        if dx * dx + dy * dy + dz * dz > limit * limit:
            continue
        for j in range(k * CHUNK, min((k + 1) * CHUNK, rim.shape[1])):
            dx, dy, dz = x - rim[0, j], y - rim[1, j], z - rim[2, j]
            best = min(best, dx * dx + dy * dy + dz * dz)
        reach = np.sqrt(best)
    return best
