# SPDX-License-Identifier: Apache-2.0
"""What becomes of the features of a part of a file: rows to store, or a reason."""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.footprints import Footprints, Geometries
from ingest.heights import HeightRules, Heights, heights_of
from ingest.object_table import NewObjects, attributes_json
from ingest.repair import repair
from ingest.shapes import centres_deg, dimensions_m, turned_home
from tiles.frames import Floats, Ints

DIGEST_BYTES = 16
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
    top_m, how_kept = _of_geometry(part, kept, found, solid)
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
    part: Footprints, kept: Ints, found: Heights, solid: NDArray[np.object_]
) -> tuple[Floats, NDArray[np.uint8]]:
    """Let the geometry's height stand where no attribute says one, and for solids."""
    if part.height_m is None:
        return found.top_m, found.how
    height_m = part.height_m[kept]
    known = np.isfinite(height_m) & (height_m > 0)
    has_solid = np.array([one is not None for one in solid], bool)
    taken = known & (has_solid | ((found.how & DEFAULT) > 0))
    how = np.where(taken, FROM_GEOMETRY | found.how & 0b111000, found.how)
    return np.where(taken, found.foot_m + height_m, found.top_m), how.astype(np.uint8)


def _rows(
    polygon: Geometries,
    raised_m: Floats,
    top_m: Floats,
    solid: NDArray[np.object_],
    attributes: list[bytes],
) -> NewObjects:
    height_m = top_m - raised_m
    return NewObjects(
        shapely.to_wkb(polygon).tolist(),
        *centres_deg(polygon),
        raised_m,
        height_m,
        dimensions_m(polygon, height_m),
        solid.tolist(),
        attributes,
    )


def _digests(polygon: Geometries, raised_m: Floats) -> NDArray[np.uint64]:
    """Return two numbers for each footprint, wherever its rings begin."""
    shape = shapely.to_wkb(shapely.normalize(polygon)).tolist()
    low = [one.tobytes() for one in raised_m.astype("<f8")]
    joined = b"".join(
        hashlib.blake2b(a + b, digest_size=DIGEST_BYTES).digest()
        for a, b in zip(shape, low, strict=True)
    )
    return np.frombuffer(joined, np.uint64).reshape(-1, 2)
