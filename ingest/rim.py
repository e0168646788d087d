# SPDX-License-Identifier: Apache-2.0
"""The delta surface around one source: its rim as a tree of balls.

At a place outside, the differences along the rim's lines are averaged, weighted by the
inverse cube of the distance, integrated along each line: so the bent surface meets
*every point* of the rim, not only its posts. Lines further away than a few times the
nearest one count nothing, and far groups of lines count as one; both fade in smoothly,
so that the surface has no steps.
"""

import shutil
import tempfile
import weakref
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.rim_kernels import STACK, Lines, Rows, deltas, nearest
from tiles.frames import Ecef, Floats
from tiles.geodesy import to_ecef, to_geodetic

BUCKET, BRANCHES = 8, 4
"""Lines in the smallest balls, and balls in a ball"""
WET_M = 10.0
"""The coarser surface is fully dry this much above the sea."""
SEA_M = 0.2
BEACH = 3.0
"""Over the sea a rim that stands higher slopes down over this many times its height."""


class Rim:
    """What bends the coarser surface around one finer source."""

    def __init__(
        self,
        feather_m: float,
        spacing_m: float,
        lines: Lines,
        balls: Floats,
        below: Rows,
    ) -> None:
        self.feather_m, self.spacing_m = feather_m, spacing_m
        self.lines, self.balls, self.below = lines, balls, below
        """as in `rim_kernels`"""
        self.missed_m = 0.0
        """how far from most of the source's edges the bent surface ends, if it does"""
        self._folder: str | None = None

    @classmethod
    def of(
        cls,
        ends: Floats,
        delta_m: NDArray[np.float32],
        feather_m: float,
        spacing_m: float,
    ) -> "Rim":
        """Build the tree over lines as `rim_lines` returns them."""
        order = _order(ends.mean(axis=1).astype(np.float32))
        ends, delta_m = ends[order], delta_m[order]
        balls, below = _tree(ends, delta_m)
        centre = balls[np.arange(len(ends)) // BUCKET, :3]
        local = (ends - centre[:, None]).reshape(-1, 6)
        lines = np.concatenate([local, delta_m], axis=1, dtype=np.float32)
        return cls(feather_m, spacing_m, lines, balls, below)

    def bent(
        self,
        coarse: Floats,
        sea: Floats,
        lon_rad: Floats,
        lat_rad: Floats,
        most_m: Floats | float = np.inf,
    ) -> tuple[Floats, Floats]:
        """Return the coarser surface as it is around the source.

        Parameters
        ----------
        coarse, sea : (n,) m, heights of the coarser surface and of sea level
        lon_rad, lat_rad : (n,) places outside the source
        most_m : over how much it may be bent, (n,), of `room_m`

        Returns
        -------
        bent : (n,) m
        near : (n,) m, distance of the rim, as of `deltas`
        """
        delta, near = self.deltas(lon_rad, lat_rad)
        bent = coarse + delta * _fade(near / np.minimum(self.feather_m, most_m))
        # Sea stays sea: a coast slopes down at once, not over a coarse post.
        rise = np.maximum(coarse + delta - sea, 0.0)
        beach_m = np.minimum(np.maximum(self.spacing_m, BEACH * rise), self.feather_m)
        top = sea + rise * _fade(near / beach_m)
        wet = np.clip(1.0 - (coarse - sea - SEA_M) / WET_M, 0.0, 1.0)
        return bent + wet * np.minimum(np.maximum(top, coarse) - bent, 0.0), near

    def room_m(self, near_m: Floats) -> Floats:
        """Return over how much finer sources may bend places so far from the rim, (n,) m.

        Not at all at the rim, about as far as it is away, and freely beyond the feather.
        """
        with np.errstate(divide="ignore"):
            return np.asarray(near_m / (1.0 - near_m / self.feather_m))

    def met(self, height_m: Floats, lon_rad: Floats, lat_rad: Floats) -> Floats:
        """Return a surface as it is bent to meet the source, (n,) m."""
        delta, near = self.deltas(lon_rad, lat_rad)
        return height_m + delta * _fade(near / self.feather_m)

    def deltas(self, lon_rad: Floats, lat_rad: Floats) -> tuple[Floats, Floats]:
        """Return the delta surface and the distance of the rim, (n,) m each.

        Where the rim is further away than the feather: 0, and the feather.
        """
        places = np.ascontiguousarray(to_ecef(lon_rad, lat_rad, 0.0))
        delta, near = np.zeros(len(places)), np.full(len(places), self.feather_m)
        deltas(self.lines, self.balls, self.below, places, self.feather_m, delta, near)
        return delta, near

    def distance_m(self, place: Ecef, limit_m: float) -> float:
        """Return how far a place, (3,), is from the rim; the limit where that is less."""
        stack = np.empty(STACK, np.int64)
        return float(nearest(self.lines, self.balls, self.below, place, limit_m, stack))

    def most_m(self, away_m: float) -> float:
        """Return the most that the rim may bend a place at a distance, m."""
        return self._largest_m * float(_fade(np.array(away_m / self.feather_m)))

    @cached_property
    def _largest_m(self) -> float:
        return float(np.abs(self.lines[:, 6:]).max(initial=0.0))

    def middles(self) -> tuple[Floats, Floats]:
        """Return longitudes and latitudes of the middles of all lines, (n,) rad."""
        centre = self.balls[np.arange(len(self.lines)) // BUCKET, :3]
        middle = (self.lines[:, :3] + self.lines[:, 3:6]) / 2 + centre
        lon, lat, _ = to_geodetic(Ecef(middle))
        return lon, lat

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave the arrays in files that all worker processes share."""
        if self._folder is None:
            self._folder = tempfile.mkdtemp(prefix="geopage-rim-")
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
            for name in ("lines", "balls", "below"):
                np.save(Path(self._folder, name), getattr(self, name))
        return _shared, (self.feather_m, self.spacing_m, self._folder)


def _shared(feather_m: float, spacing_m: float, folder: str) -> Rim:
    names = ("lines", "balls", "below")
    # Copy on write: kernels are compiled for arrays that may be written.
    parts = [np.load(Path(folder, f"{name}.npy"), mmap_mode="c") for name in names]
    return Rim(feather_m, spacing_m, *map(np.asarray, parts))


def _fade(part: Floats) -> Floats:
    t = np.clip(part, 0.0, 1.0)
    return np.asarray(1.0 - t * t * (3.0 - 2.0 * t))


def _order(middle: Floats) -> NDArray[np.int64]:
    """Sort places so that runs of BUCKET, and of BRANCHES such runs, lie close together.

    Every run is cut in two across its widest side, again and again.
    """
    order = np.arange(len(middle))
    size = BUCKET
    while size < len(middle):
        size *= BRANCHES
    while size > BUCKET:
        whole = len(middle) // size * size
        for part in (order[:whole].reshape(-1, size), order[whole:].reshape(1, -1)):
            if part.size and part.shape[1] > size // 2:
                at = middle[part]
                wide = np.ptp(at, axis=1).argmax(axis=1)[:, None, None]
                along = np.take_along_axis(at, wide, axis=2)[..., 0]
                half = np.argpartition(along, size // 2 - 1, axis=1)
                part[:] = np.take_along_axis(part, half, axis=1)
        size //= 2
    return order


def _tree(ends: Floats, delta_m: Lines) -> tuple[Floats, Rows]:
    """Return balls around runs of lines, around runs of those, ... around all."""
    levels: list[Floats] = []
    size = BUCKET
    while not levels or len(levels[-1]) > 1:
        levels.append(_balls(ends, delta_m, size))
        size *= BRANCHES
    below, start = [], 0
    for above, inside in enumerate([len(ends), *map(len, levels[:-1])]):
        step = BRANCHES if above else BUCKET
        first = np.arange(0, inside, step)
        below.append(np.stack([first, np.minimum(first + step, inside)], axis=1) + start)
        start += inside if above else 0
    return np.concatenate(levels), np.concatenate(below).astype(np.int32)


def _balls(ends: Floats, delta_m: Lines, size: int) -> Floats:
    """Return a ball around each run of `size` lines, as `rim_kernels` wants them."""
    length = np.maximum(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 1e-6)
    mean_m = delta_m.mean(axis=1, dtype=np.float64)
    begin = np.arange(0, len(ends), size)
    total = np.add.reduceat(length, begin)
    weighted = np.column_stack([ends.mean(axis=1), mean_m]) * length[:, None]
    mean = np.add.reduceat(weighted, begin) / total[:, None]
    centre = mean[np.arange(len(ends)) // size, :3]
    far = np.linalg.norm(ends - centre[:, None], axis=2).max(axis=1)
    radius = np.maximum.reduceat(far, begin) + 1e-3
    return np.column_stack([mean[:, :3], radius, total, mean[:, 3]])
