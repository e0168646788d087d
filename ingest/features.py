# SPDX-License-Identifier: Apache-2.0
"""What becomes of the features of a part of a file: rows to store, or a reason."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.footprints import Footprints, Geometries
from ingest.heights import HeightRules, Heights, heights_of
from ingest.object_table import NewObjects, attributes_json
from ingest.outlines import outlines_of
from ingest.repair import repair
from ingest.shapes import centres_deg, dimensions_m, turned_home
from ingest.solids import widths_m
from tiles.frames import Floats, Ints

_STEP = np.uint64(0x9E3779B97F4A7C15)
DEFAULT, FROM_GEOMETRY = 1 << 2, 1 << 7
"""Bits of `Features.how`: the former is one of `heights.HOW`, the latter no bit of it."""


@dataclass(frozen=True, slots=True)
class Features:
    """All n features of a part, also those that can't be stored."""

    path: Path
    layer: str
    crs: str
    warnings: tuple[str, ...]
    used: dict[str, Any]
    """the fields that heights come from"""
    feature: Ints
    """(n,) number in the file"""
    was_repaired: NDArray[np.bool_]
    reason: NDArray[np.object_]
    """(n,) why it can't be stored; empty where it can"""
    how: NDArray[np.uint8]
    """(n,) where its height comes from, bits of `heights.HOW`, and FROM_GEOMETRY"""
    rows: NewObjects
    """what can be stored, k of them, in the same order"""
    top_m: Floats
    """(k,) roof above the ground"""
    digest: NDArray[np.uint64]
    """(k, 2) the same for the same footprint with the same lower edge"""
    odd: list[bytes]
    """WKB of what is to be looked at, in the order of `is_odd`"""

    @property
    def kept(self) -> Ints:
        """Return which features can be stored, (k,)."""
        return np.flatnonzero(self.reason == "")

    @property
    def is_odd(self) -> Ints:
        """Return which features are skipped, or repaired."""
        return np.flatnonzero((self.reason != "") | self.was_repaired)


def packed(part: Footprints) -> Footprints:
    """Return a part with its geometries as WKB, which costs less to send."""
    return replace(part, geometry=shapely.to_wkb(part.geometry))


def features_of(job: tuple[Footprints, HeightRules]) -> Features:
    """Repair the polygons of a part and find their heights.

    Parameters
    ----------
    job : the part, `packed`, and which attributes say the height
    """
    part, rules = job
    geometry = np.asarray(shapely.from_wkb(part.geometry), object)
    repaired = repair(geometry)
    kept = np.flatnonzero(repaired.reason == "")
    columns = {name: values[kept] for name, values in part.columns.items()}
    found = heights_of(part.path, columns, len(kept), rules)
    solid = part.solid[kept] if part.solid is not None else np.full(len(kept), None, object)
    is_named = rules.height is not None or rules.levels is not None
    top_m, how_kept = _of_geometry(part, kept, found, solid, is_named=is_named)
    how = np.zeros(len(repaired.reason), np.uint8)
    how[kept] = how_kept
    polygon = turned_home(repaired.polygon[kept])
    odd = np.flatnonzero((repaired.reason != "") | repaired.was_repaired)
    looks = np.where(repaired.was_repaired, repaired.polygon, geometry)
    return Features(
        part.path,
        part.layer,
        part.crs,
        part.warnings,
        found.used,
        part.feature,
        repaired.was_repaired,
        repaired.reason,
        how,
        _rows(polygon, found.foot_m, top_m, solid, attributes_json(part.columns, kept)),
        top_m,
        _digests(polygon, found.foot_m),
        shapely.to_wkb(looks[odd]).tolist(),
    )


def _of_geometry(
    part: Footprints,
    kept: Ints,
    found: Heights,
    solid: NDArray[np.object_],
    *,
    is_named: bool,
) -> tuple[Floats, NDArray[np.uint8]]:
    """Let a city model's own height stand, but for prisms with a field that is named."""
    if part.height_m is None:
        return found.top_m, found.how
    height_m = part.height_m[kept]
    known = np.isfinite(height_m) & (height_m > 0)
    has_solid = np.array([one is not None for one in solid], bool)
    taken = known & (has_solid | (not is_named) | ((found.how & DEFAULT) > 0))
    how = np.where(taken, FROM_GEOMETRY | found.how & 0b111000, found.how)
    return np.where(taken, found.foot_m + height_m, found.top_m), how.astype(np.uint8)


def _rows(
    polygon: Geometries,
    raised_m: Floats,
    top_m: Floats,
    solid: NDArray[np.object_],
    attributes: list[str],
) -> NewObjects:
    height_m = top_m - raised_m
    dimension_m = dimensions_m(polygon, height_m)
    own = np.flatnonzero([one is not None for one in solid])
    # Roofs overhang footprints.
    dimension_m[own] = np.maximum(dimension_m[own], widths_m(solid[own].tolist()))
    return NewObjects(
        shapely.to_wkb(polygon).tolist(),
        *centres_deg(polygon),
        raised_m,
        height_m,
        dimension_m,
        solid.tolist(),
        attributes,
    )


def _digests(polygon: Geometries, raised_m: Floats) -> NDArray[np.uint64]:
    """Return two numbers for each footprint: sums over its edges, wherever rings begin."""
    if not len(polygon):
        return np.zeros((0, 2), np.uint64)
    xy, ring_start, part_ring, owner = outlines_of(polygon)
    word = (xy + 0.0).view(np.uint64)  # + 0.0: there is no -0.0 any more
    edge = np.column_stack((word[:-1], word[1:]))
    mixed = _mixed(edge[:, 0])
    for k in (1, 2, 3):
        mixed = _mixed(mixed ^ edge[:, k])
    both = np.column_stack((mixed, _mixed(mixed)))
    both[ring_start[1:-1] - 1] = 0  # from a ring's end to the next ring is no edge
    first = ring_start[part_ring[np.searchsorted(owner, np.arange(len(polygon)))]]
    raised = _mixed((raised_m + 0.0).view(np.uint64))
    return np.asarray(np.add.reduceat(both, first) ^ raised[:, None])


def _mixed(word: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return numbers in which every bit depends on every bit: those of splitmix64."""
    word = word + _STEP
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))
