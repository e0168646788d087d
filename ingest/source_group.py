# SPDX-License-Identifier: Apache-2.0
"""Sources of about the same post spacing, such as the tiles of one survey, as one.

Where two of them overlap the later one wins, and bends the earlier one for one post.
Together they have one rim towards coarser sources: what lies between two tiles is no rim.
Those too far apart to bend the same ground are groups of their own: a city that comes
changes nothing around another.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import Box, grown, meet
from ingest.layer import Layer
from ingest.rim import Rim
from ingest.rim_kernels import REACH
from ingest.rim_lines import Parts, missed_m, rim_lines
from tiles.frames import Floats

ALIKE = 1.25
"""Spacings of one group differ by less than this factor."""
FREE_POSTS = 10.0
"""Feather around a group with no coarser source under it, in its own posts"""
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
        self,
        lon_rad: Floats,
        lat_rad: Floats,
        step_m: float,
        count: int | None = None,
        *,
        bends: bool = True,
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
            if rim and bends and len(at):
                found[at] = rim.met(found[at], lon_rad[at], lat_rad[at])
            found = np.where(outside, found, own)
        return found

    def without(self, layer: Layer, lon_rad: Floats, lat_rad: Floats) -> Floats:
        """Return heights of all layers but one, bent by none, (n,) m; NaN without any."""
        found = np.full(lon_rad.shape, np.nan)
        for other in self.layers:
            if other is not layer and other.near(lon_rad, lat_rad).any():
                own = other.heights(lon_rad, lat_rad, 0.0)
                found = np.where(np.isnan(own), found, own)
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

        ends, delta_m, stride = rim_lines([(layer, covers)], under)
        if not np.abs(delta_m).max(initial=0.0):
            return None
        rim = Rim.of(ends, delta_m, layer.spacing_m, layer.spacing_m)
        if stride > 1:
            rim.missed_m = missed_m(rim, [(layer, covers)], under)
        return rim

    def outer_parts(self) -> Parts:
        """Return the layers, each with those of its edges that no other one covers."""
        found = []
        for layer in self.layers:
            others = [one for one in self.layers if one is not layer]
            others = [one for one in others if _may_meet(one, layer)]

            def free(
                lon_rad: Floats, lat_rad: Floats, others: list[Layer] = others
            ) -> NDArray[np.bool_]:
                return ~_covered(others, lon_rad, lat_rad)

            found.append((layer, free))
        return found


def grouped(layers: list[Layer]) -> list[SourceGroup]:
    """Sort layers into groups, coarsest first."""
    found = groups_of([(one.spacing_m, one.bounds_deg) for one in layers])
    return [SourceGroup([layers[k] for k in group]) for group in found]


def groups_of(placed: Sequence[tuple[float, Box]]) -> list[list[int]]:
    """Return which sources make a group, coarsest first.

    Parameters
    ----------
    placed : spacing (m) and bounds (degrees) of each
    """
    alike: list[list[int]] = []
    for k in sorted(range(len(placed)), key=lambda k: -placed[k][0]):
        if alike and placed[k][0] * ALIKE > placed[alike[-1][0]][0]:
            alike[-1].append(k)
        else:
            alike.append([k])
    found: list[list[int]] = []
    for group in alike:
        spacing_m = placed[group[0]][0]
        coarser = [one for one, _ in placed if one > spacing_m]
        # A feather is one post of a coarser source, or some of its own.
        feather_m = max(coarser, default=FREE_POSTS * spacing_m)
        found += _apart(group, placed, (1.0 + REACH) * feather_m)
    return found


def _apart(
    group: list[int], placed: Sequence[tuple[float, Box]], margin_m: float
) -> list[list[int]]:
    """Part a group into those of its sources that lie within a margin of each other."""
    parts: list[list[int]] = []
    for k in group:
        box = grown(placed[k][1], margin_m)
        near = [part for part in parts if any(meet(box, placed[one][1]) for one in part)]
        parts = [part for part in parts if part not in near]
        parts.append(sorted([k, *chain(*near)], key=group.index))
    return sorted(parts, key=lambda part: group.index(part[0]))


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
