# SPDX-License-Identifier: Apache-2.0
"""Sources of about the same post spacing, such as the tiles of one survey, as one.

Where two of them overlap the later one wins, and bends the earlier one for one post.
Together they have one rim towards coarser sources: what lies between two tiles is no rim.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.rim import Rim
from ingest.rim_lines import MOST_LINES, rim_lines
from tiles.frames import Floats

ALIKE = 1.25
"""Spacings of one group differ by less than this factor."""
Coarse = Callable[[Floats, Floats], Floats]
Rims = list[Rim | None]


@dataclass
class SourceGroup:
    """Layers of about the same spacing, in the order in which they cover each other."""

    layers: list[Layer]
    inner: Rims = field(default_factory=list)
    """of each layer, where it covers an earlier one"""
    outer: Rim | None = None
    """of all, towards coarser sources"""

    def heights(
        self, lon_rad: Floats, lat_rad: Floats, step_m: float, count: int | None = None
    ) -> Floats:
        """Return heights of the first `count` layers, (n,) m, NaN where they have none."""
        if len(self.layers) == 1:
            return self.layers[0].heights(lon_rad, lat_rad, step_m)
        found = np.full(lon_rad.shape, np.nan)
        for layer, rim in zip(self.layers[:count], self.inner, strict=False):
            around = layer.near(lon_rad, lat_rad, rim.feather_m if rim else 0.0)
            if not around.any():
                continue
            own = layer.heights(lon_rad, lat_rad, step_m)
            outside = np.isnan(own)
            at = np.flatnonzero(outside & around & np.isfinite(found))
            if rim and len(at):
                found[at] = rim.met(found[at], lon_rad[at], lat_rad[at])
            found = np.where(outside, found, own)
        return found

    def near(self, lon_rad: Floats, lat_rad: Floats, margin_m: float) -> NDArray[np.bool_]:
        """Say which places are within a margin of a layer's bounding box."""
        boxes = [layer.near(lon_rad, lat_rad, margin_m) for layer in self.layers]
        return np.asarray(np.logical_or.reduce(boxes))

    def find_inner_rims(self) -> None:
        """Find where each layer covers an earlier one, and the difference there."""
        for count, layer in enumerate(self.layers):
            earlier = [one for one in self.layers[:count] if _may_meet(one, layer)]
            self.inner.append(self._inner_rim(layer, count, earlier) if earlier else None)

    def _inner_rim(self, layer: Layer, count: int, earlier: list[Layer]) -> Rim | None:
        def under(lon_rad: Floats, lat_rad: Floats) -> Floats:
            return self.heights(lon_rad, lat_rad, 0.0, count)

        def covers(lon_rad: Floats, lat_rad: Floats) -> NDArray[np.bool_]:
            return _covered(earlier, lon_rad, lat_rad)

        ends, delta_m = rim_lines(layer, under, covers)
        if not np.abs(delta_m).max(initial=0.0):
            return None
        return Rim.of(ends, delta_m, layer.spacing_m, layer.spacing_m)

    def outer_lines(self, coarse: Coarse) -> tuple[Floats, NDArray[np.float32]]:
        """Return the group's lines towards coarser sources, as `rim_lines` does."""
        found = []
        for layer in self.layers:
            others = [one for one in self.layers if one is not layer]
            others = [one for one in others if _may_meet(one, layer)]

            def free(
                lon_rad: Floats, lat_rad: Floats, others: list[Layer] = others
            ) -> NDArray[np.bool_]:
                return ~_covered(others, lon_rad, lat_rad)

            most = MOST_LINES // len(self.layers)
            found.append(rim_lines(layer, coarse, free, most))
        ends, deltas = zip(*found, strict=True)
        return np.concatenate(ends), np.concatenate(deltas)


def grouped(layers: list[Layer]) -> list[SourceGroup]:
    """Sort layers into groups, coarsest first."""
    groups: list[SourceGroup] = []
    for layer in sorted(layers, key=lambda one: -one.spacing_m):
        if groups and layer.spacing_m * ALIKE > groups[-1].layers[0].spacing_m:
            groups[-1].layers.append(layer)
        else:
            groups.append(SourceGroup([layer]))
    return groups


def _may_meet(one: Layer, other: Layer) -> bool:
    """Say whether two layers' bounding boxes may have a part in common."""
    west, south, east, north = np.radians(other.bounds_deg)
    return one.holds((west, south, east, north))


def _covered(layers: list[Layer], lon_rad: Floats, lat_rad: Floats) -> NDArray[np.bool_]:
    covered = np.zeros(len(lon_rad), np.bool_)
    for layer in layers:
        at = np.flatnonzero(~covered & layer.near(lon_rad, lat_rad))
        covered[at] = np.isfinite(layer.heights(lon_rad[at], lat_rad[at], 0.0))
    return covered
