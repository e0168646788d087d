# SPDX-License-Identifier: Apache-2.0
"""How well buildings stand on the terrain of every level that may be drawn with them.

Looked at with places of its own, finer than those that the buildings were grounded by.
What a level is off by counts in pixels from the nearest distance at which it may be
drawn, for each pixel of threshold: a tile with error E is drawn while E takes at most
the threshold, so m metres take m / E of it. Leaves are drawn at any distance and have no
such number.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ingest.footprints import Geometries
from ingest.ground_places import places_of
from ingest.grounding import THRESHOLD_RATIO, TOLERANCE_M, ground_objects
from tiles.frames import Floats, Ints
from tiles.kernels import kernel
from tiles.store import Store
from tiles.surface import Surface

LOOK_M = 5.0
WORST = 5
NAMES = ("name", "addr:housename", "id", "@id", "osm_id", "gml_id", "gmlid")
"""Attributes that may name a building, best first."""


@dataclass(frozen=True, slots=True)
class Standing:
    """n buildings to look at, best sorted by cell."""

    id: Ints
    polygon: Geometries
    """(n,) degrees"""
    raised_m: Floats
    height_m: Floats


@dataclass(slots=True)
class Fault:
    """One way to stand badly on one level: how many, and the worst."""

    count: int = 0
    worst: list[tuple[float, float, int]] = field(default_factory=list)
    """at most WORST of metres, share of the threshold (NaN for leaves) and id"""

    def add(self, metres: Floats, share: Floats, number: Ints) -> None:
        """Count those over the tolerance."""
        bad = np.flatnonzero(metres > TOLERANCE_M)
        self.count += len(bad)
        bad = bad[np.argsort(-metres[bad], kind="stable")][:WORST]
        rows = zip(metres[bad], share[bad], number[bad], strict=True)
        self.worst += [(float(m), float(part), int(one)) for m, part, one in rows]
        self.worst = sorted(self.worst, key=lambda row: (-row[0], row[2]))[:WORST]

    def __add__(self, other: "Fault") -> "Fault":
        both = sorted(self.worst + other.worst, key=lambda row: (-row[0], row[2]))
        return Fault(self.count + other.count, both[:WORST])


@dataclass(slots=True)
class Level:
    """What one terrain level does to the buildings that may be drawn with it."""

    buildings: int = 0
    floating: Fault = field(default_factory=Fault)
    sunk: Fault = field(default_factory=Fault)
    """roofs under the ground"""
    hidden: Fault = field(default_factory=Fault)
    """walls that this level covers and the finest does not"""

    def __add__(self, other: "Level") -> "Level":
        return Level(
            self.buildings + other.buildings,
            self.floating + other.floating,
            self.sunk + other.sunk,
            self.hidden + other.hidden,
        )


@dataclass(slots=True)
class Levels:
    """All levels, of some of the buildings; those of other buildings can be added."""

    level: dict[int, Level] = field(default_factory=dict)
    floating: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    sunk: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    """ids, against the finest terrain"""
    looked_at: int = 0

    def __add__(self, other: "Levels") -> "Levels":
        level = dict(self.level)
        for number, one in other.level.items():
            level[number] = level.get(number, Level()) + one
        return Levels(
            level,
            np.concatenate((self.floating, other.floating)),
            np.concatenate((self.sunk, other.sunk)),
            self.looked_at + other.looked_at,
        )


def look(surface: Surface, standing: Standing) -> Levels:
    """Look at some buildings on all levels, in memory for all of them at once."""
    return _Look(surface, standing).all_levels() if len(standing.id) else Levels()


class _Look:
    """Buildings, and the tile under each of their places, level by level upwards."""

    def __init__(self, surface: Surface, standing: Standing) -> None:
        self._surface, self._standing = surface, standing
        top_m = standing.raised_m + standing.height_m
        ground = ground_objects(standing.polygon, surface.heights, top_m, surface.lowest)
        self._foot_m = np.where(
            standing.raised_m > 0, -np.inf, ground.foot_m(standing.raised_m)
        )
        self._roof_m = ground.low_m + top_m
        places = places_of(standing.polygon, LOOK_M)
        self._start, (self._lon, self._lat) = places.start, places.radians
        self._within_m = THRESHOLD_RATIO * np.maximum(places.size_m, top_m)
        self._leaf = surface.rows(self._lon, self._lat)
        self._fine_m = surface.heights_in(self._leaf, self._lon, self._lat)
        self._leaf_m = np.where(self._leaf >= 0, 0.0, np.inf)

    def all_levels(self) -> Levels:
        """Go up from the deepest level until nothing may be drawn any more."""
        found = Levels(looked_at=len(self._standing.id))
        off_m = self._off(self._fine_m)
        number = self._standing.id
        found.floating = number[off_m[:, 0] > TOLERANCE_M]
        found.sunk = number[off_m[:, 1] > TOLERANCE_M]
        deepest = int(self._surface.level[self._leaf].max())
        rows, height_m = self._leaf.copy(), self._fine_m.copy()
        for level in range(deepest, -1, -1):
            above = self._surface.up_to(rows, level)
            moved = np.flatnonzero(above != rows)
            rows = above
            height_m[moved] = self._surface.heights_in(
                rows[moved], self._lon[moved], self._lat[moved]
            )
            found.level[level] = self._level(level, rows, height_m)
        found.level = {k: one for k, one in found.level.items() if one.buildings}
        return found

    def _level(self, level: int, rows: Ints, height_m: Floats) -> Level:
        """Look at the buildings that stand on tiles of this level and are drawn with it."""
        error_m = np.where(rows == self._leaf, self._leaf_m, self._surface.selected_m[rows])
        first = self._start[:-1]
        error_m = np.maximum.reduceat(error_m, first)
        here = np.logical_or.reduceat(self._surface.level[rows] == level, first)
        shown = np.flatnonzero(here & (error_m <= self._within_m))
        off_m = self._off(height_m)[shown]
        share = np.full(len(shown), np.nan)
        coarse = error_m[shown] > 0
        found = Level(len(shown))
        for k, fault in enumerate((found.floating, found.sunk, found.hidden)):
            share[coarse] = off_m[coarse, k] / error_m[shown[coarse]]
            fault.add(off_m[:, k], share, self._standing.id[shown])
        return found

    def _off(self, height_m: Floats) -> Floats:
        return _off_m(self._start, height_m, self._fine_m, self._foot_m, self._roof_m)


@kernel
def _off_m(
    start: Ints, height_m: Floats, fine_m: Floats, foot_m: Floats, roof_m: Floats
) -> Floats:
    """Return by how much each building floats, is sunk and is hidden, (n, 3) m."""
    off = np.empty((len(foot_m), 3))
    for n in range(len(foot_m)):
        low, high, over = np.inf, -np.inf, -np.inf
        for k in range(start[n] + 1, start[n + 1]):  # the first one is the middle
            low, high = min(low, height_m[k]), max(high, height_m[k])
            over = max(over, height_m[k] - fine_m[k])
        off[n, 0], off[n, 1], off[n, 2] = foot_m[n] - low, high - roof_m[n], over
    return off


def described(store: Store, found: Levels) -> dict[str, Any]:
    """Return the report as JSON has it, the worst with their names, finest level first."""
    levels = [
        {
            "level": number,
            "buildings": one.buildings,
            "floating": _described(store, one.floating),
            "sunk": _described(store, one.sunk),
            "hidden": _described(store, one.hidden),
        }
        for number, one in sorted(found.level.items(), reverse=True)
    ]
    return {
        "looked_at": found.looked_at,
        "floating": len(found.floating),
        "sunk": len(found.sunk),
        "levels": levels,
    }


def _described(store: Store, fault: Fault) -> dict[str, Any]:
    objects = {one["id"]: one for one in store.objects([row[2] for row in fault.worst])}
    worst = [
        {
            **_named(objects.get(number, {"id": number})),
            "m": round(metres, 2),
            "px_per_threshold_px": None if np.isnan(share) else round(share, 3),
        }
        for metres, share, number in fault.worst
    ]
    return {"count": fault.count, "worst": worst}


def _named(one: dict[str, Any]) -> dict[str, Any]:
    attributes = one.get("attributes", {})
    names = [str(attributes[key]) for key in NAMES if attributes.get(key)]
    known = {key: one[key] for key in ("id", "source", "lon_deg", "lat_deg") if key in one}
    return known | ({"name": names[0]} if names else {})


def lines(report: dict[str, Any]) -> list[str]:
    """Return the report as lines of text, one for each level and fault that occurs."""
    words = {"floating": "float", "sunk": "are sunk", "hidden": "are partly hidden"}
    found = []
    for level in report["levels"]:
        for fault, verb in words.items():
            if level[fault]["count"]:
                worst = level[fault]["worst"][0]
                share = worst["px_per_threshold_px"]
                seen = "" if share is None else f" = {share:.2g} px at a threshold of 1 px"
                found.append(
                    f"level {level['level']}: {level[fault]['count']} of"
                    f" {level['buildings']} {verb} by > {TOLERANCE_M} m, worst"
                    f" {worst['m']:.1f} m{seen} ({worst.get('name', worst['id'])})"
                )
    return found
