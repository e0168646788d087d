# SPDX-License-Identifier: Apache-2.0
"""One surface out of nested sources: the finest wins, the coarser bends to meet it.

Around each finer source the coarser surface is bent by a delta surface: along the
source's rim the difference is known; it is carried outwards by inverse-distance
weighting and faded to nothing over the feather distance, which is one post spacing of
the coarser source: what that source can't know anyway. Over the sea it fades at once.
Where a third source lies beside, it fades on the way to that: real posts stay.

References
----------
Grohman, Kroenung and Strebeck 2006, Filling SRTM Voids: The Delta Surface Fill Method,
Photogrammetric Engineering & Remote Sensing 72(3).
"""

import sqlite3
from typing import Any

import numpy as np

from ingest.boxes import meet
from ingest.datum import undulation_m
from ingest.layer import Layer
from ingest.rim import Rim
from ingest.rim_lines import missed_m, rim_lines
from ingest.source_group import FREE_POSTS, SourceGroup, grouped
from tiles.frames import Floats
from tiles.raster_blocks import BlockCache

__all__ = ["Mosaic", "Rim"]


class Mosaic:
    """The terrain of a store as a function of longitude and latitude."""

    def __init__(
        self,
        connection: sqlite3.Connection,
        sources: list[dict[str, Any]],
        rims: list[Rim | None] | None = None,
    ) -> None:
        """Open the sources; their rims are found once an ingest and handed to workers."""
        self.connection = connection
        cache, terrain = BlockCache(), [s for s in sources if s["kind"] == "terrain"]
        self.groups = grouped([Layer(connection, one, cache) for one in terrain])
        """coarsest first"""
        self.layers = [layer for group in self.groups for layer in group.layers]
        """coarsest first"""
        given = list(rims or [])
        for count, group in enumerate(self.groups):
            if rims:
                group.outer = given.pop(0)
                group.inner = [given.pop(0) for _ in group.layers]
            else:
                group.find_inner_rims()
                group.outer = self._outer_rim(group, count)

    @property
    def rims(self) -> list[Rim | None]:
        """All rims, for another mosaic of the same sources."""
        return [rim for group in self.groups for rim in (group.outer, *group.inner)]

    def heights(self, lon_rad: Floats, lat_rad: Floats, step_m: float) -> Floats:
        """Return heights above the ellipsoid, (n,) m; sea level where no source is."""
        return self.heights_and_sea(lon_rad, lat_rad, step_m)[0]

    def heights_and_sea(
        self, lon_rad: Floats, lat_rad: Floats, step_m: float
    ) -> tuple[Floats, Floats]:
        """Return heights above the ellipsoid, and those of sea level (EGM96) there."""
        sea = undulation_m("egm96", lon_rad, lat_rad)
        return self._fold(lon_rad, lat_rad, step_m, len(self.groups), sea), sea

    def bend_m(self, lon_rad: Floats, lat_rad: Floats) -> Floats:
        """Return how far sources bend what is around them, (n,) m."""
        sea = undulation_m("egm96", lon_rad, lat_rad)
        bent, unbent = (
            self._fold(lon_rad, lat_rad, 0.0, len(self.groups), sea, bends=bends)
            for bends in (True, False)
        )
        return bent - unbent

    def spacing_m(self, lon_rad: Floats, lat_rad: Floats) -> Floats:
        """Return the post spacing of the source that shows, (n,) m; inf where none is."""
        found = np.full(lon_rad.shape, np.inf)
        for group in self.groups:
            if group.near(lon_rad, lat_rad, 0.0).any():
                here = np.isfinite(group.heights(lon_rad, lat_rad, 0.0))
                found[here] = group.layers[-1].spacing_m
        return found

    def beside(self, layer: Layer, lon_rad: Floats, lat_rad: Floats) -> Floats:
        """Return what other sources show as they are, (n,) m; NaN where none does.

        That is where a source has no data and does not bend them either.
        """
        count = next(k for k, one in enumerate(self.groups) if layer in one.layers)
        sea = undulation_m("egm96", lon_rad, lat_rad)
        below, shown = (
            self._fold(lon_rad, lat_rad, 0.0, k, sea) for k in (count, count + 1)
        )
        known = np.zeros(lon_rad.shape, np.bool_)
        for group in self.groups[:count]:
            known |= np.isfinite(group.heights(lon_rad, lat_rad, 0.0))
        known &= below == shown
        known |= self.groups[count].without(layer, lon_rad, lat_rad) == shown
        return np.where(known, shown, np.nan)

    def _fold(
        self,
        lon_rad: Floats,
        lat_rad: Floats,
        step_m: float,
        count: int,
        sea: Floats,
        *,
        bends: bool = True,
    ) -> Floats:
        surface, most_m = sea.copy(), np.full(lon_rad.shape, np.inf)
        for group in self.groups[:count]:
            feather_m = group.outer.feather_m if group.outer else 0.0
            near = group.near(lon_rad, lat_rad, feather_m)
            if not near.any():
                continue
            own = group.heights(lon_rad, lat_rad, step_m, bends=bends)
            outside = np.isnan(own)
            room_m = np.where(outside, np.inf, 0.0)
            if group.outer and bends:
                at = np.flatnonzero(outside & near)
                if len(at):
                    rim, places = group.outer, (lon_rad[at], lat_rad[at])
                    bent = rim.bent(surface[at], sea[at], *places, most_m[at])
                    surface[at], room_m[at] = bent[0], rim.room_m(bent[1])
            surface = np.where(outside, surface, own)
            most_m = np.minimum(most_m, group.layers[0].spacing_m + room_m)
        return surface

    def reach_m(self, layer: Layer) -> float:
        """Return how far outside its own posts a source changes the surface."""
        return max((rim.feather_m for rim in self._rims(layer)), default=0.0)

    def missed_m(self, layer: Layer) -> float:
        """Return how far from its own edges the surface ends that meets a source."""
        return max((rim.missed_m for rim in self._rims(layer)), default=0.0)

    def _rims(self, layer: Layer) -> list[Rim]:
        group = next(one for one in self.groups if layer in one.layers)
        rims = group.outer, group.inner[group.layers.index(layer)]
        return [rim for rim in rims if rim]

    def meets(self, layer: Layer) -> str:
        """Return the source that bends to meet one; empty where it is the sea level."""
        at = next(k for k, one in enumerate(self.groups) if layer in one.layers)
        if (rim := self.groups[at].outer) is None:
            return "its neighbours"
        coarser = [one.layers[0] for one in self.groups[:at]]
        like = [one for one in coarser if one.spacing_m == rim.feather_m]
        return next((o.name for o in like if meet(o.bounds_deg, layer.bounds_deg)), "")

    def _outer_rim(self, group: SourceGroup, count: int) -> Rim | None:
        """Find where a group meets the `count` coarser ones, and the difference there."""
        touched: set[float] = set()
        spacing_m = group.layers[-1].spacing_m

        def coarse(lon_rad: Floats, lat_rad: Floats) -> Floats:
            for other in self.groups[:count]:
                if other.near(lon_rad, lat_rad, 0.0).any():
                    touched.add(other.layers[0].spacing_m)
            sea = undulation_m("egm96", lon_rad, lat_rad)
            return self._fold(lon_rad, lat_rad, 0.0, count, sea)

        parts = group.outer_parts()
        ends, delta_m, stride = rim_lines(parts, coarse)
        if not len(ends):
            return None
        feather_m = min(touched, default=FREE_POSTS * spacing_m)
        rim = Rim.of(ends, delta_m, feather_m, spacing_m)
        if stride > 1:
            rim.missed_m = missed_m(rim, parts, coarse)
        return rim
