# SPDX-License-Identifier: Apache-2.0
"""What becomes of the features of a source: stored, merged or skipped, all counted."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.footprints import Footprints, Geometries, read_footprints
from ingest.heights import HeightRules, count_how, heights_of
from ingest.object_table import attributes_json
from ingest.repair import repair
from tiles.frames import Floats, Ints

MERGED = "merged: the same footprint again"
LISTED = 1000
"""Skipped features that a report lists; the counts are complete."""


@dataclass(frozen=True, slots=True)
class Features:
    """All n features of a source, also those that are not stored."""

    files: tuple[Footprints, ...]
    file: Ints
    """(n,) which of the files"""
    feature: Ints
    """(n,) number in the file"""
    original: Geometries
    polygon: Geometries
    """(n,) as read, and as repaired (None where skipped), degrees"""
    top_m: Floats
    raised_m: Floats
    """(n,) roof and walls' lower edge above the ground"""
    was_repaired: NDArray[np.bool_]
    reason: NDArray[np.object_]
    """(n,) why it is not stored; empty where it is"""
    how: NDArray[np.uint8]
    """(n,) where its height comes from, bits of `heights.HOW`"""
    used: tuple[dict[str, Any], ...]
    """for each file, the fields that heights come from"""

    def __add__(self, other: "Features") -> "Features":
        return Features(
            self.files + other.files,
            np.concatenate((self.file, other.file + len(self.files))),
            np.concatenate((self.feature, other.feature)),
            np.concatenate((self.original, other.original)),
            np.concatenate((self.polygon, other.polygon)),
            np.concatenate((self.top_m, other.top_m)),
            np.concatenate((self.raised_m, other.raised_m)),
            np.concatenate((self.was_repaired, other.was_repaired)),
            np.concatenate((self.reason, other.reason)),
            np.concatenate((self.how, other.how)),
            self.used + other.used,
        )

    @property
    def kept(self) -> Ints:
        """Return which features are stored."""
        return np.flatnonzero(self.reason == "")

    def merged(self) -> "Features":
        """Keep one of features that are the same: the tallest, of these the first."""
        first: dict[tuple[bytes, float], int] = {}
        usable = self.kept
        usable = usable[np.argsort(-self.top_m[usable], kind="stable")]
        shape = shapely.to_wkb(shapely.normalize(self.polygon[usable]))
        keys = zip(shape.tolist(), self.raised_m[usable].tolist(), strict=True)
        for row, key in zip(usable.tolist(), keys, strict=True):
            if first.setdefault(key, row) != row:
                self.reason[row] = MERGED
        return self

    def attributes(self) -> list[str]:
        """Return the stored features' attributes, as JSON, in the order of `kept`."""
        kept, texts = self.kept, []
        start = np.searchsorted(self.file, np.arange(len(self.files) + 1))
        for k, file in enumerate(self.files):
            rows = kept[(kept >= start[k]) & (kept < start[k + 1])] - start[k]
            texts += attributes_json(file.columns, rows)
        return texts

    def report(self) -> dict[str, Any]:
        """Count what became of the features; read = stored + merged + skipped."""
        merged = self.reason == MERGED
        skipped = (self.reason != "") & ~merged
        return {
            "read": len(self.reason),
            "stored": len(self.kept),
            "merged": int(merged.sum()),
            "skipped": int(skipped.sum()),
            "repaired": int((self.was_repaired & (self.reason == "")).sum()),
            "skipped_by_reason": dict(Counter(self.reason[skipped].tolist())),
            "heights": {**count_how(self.how[self.kept]), **joined_reports(self.used)},
            "warnings": [text for file in self.files for text in file.warnings],
        }

    def details(self) -> dict[str, Any]:
        """Return what the store remembers about the source."""
        listed = np.flatnonzero(self.reason != "")[:LISTED]
        return {
            "files": [file.path.name for file in self.files],
            "layer": self.files[0].layer,
            "crs": self.files[0].crs,
            "report": self.report(),
            "not_stored": [
                [self.files[self.file[k]].path.name, int(self.feature[k]), self.reason[k]]
                for k in listed.tolist()
            ],
        }


def read_features(
    path: str | Path, layer: str | None, crs: str | None, rules: HeightRules
) -> Features:
    """Read one file, repair its polygons and find their heights."""
    read = read_footprints(path, layer, crs)
    repaired = repair(read.geometry)
    usable = repaired.reason == ""
    columns = {name: values[usable] for name, values in read.columns.items()}
    found = heights_of(path, columns, int(usable.sum()), rules)
    top_m, raised_m = np.zeros(len(usable)), np.zeros(len(usable))
    how = np.zeros(len(usable), np.uint8)
    top_m[usable], raised_m[usable], how[usable] = found.top_m, found.foot_m, found.how
    return Features(
        (read,),
        np.zeros(len(usable), np.int64),
        read.feature,
        read.geometry,
        repaired.polygon,
        top_m,
        raised_m,
        repaired.was_repaired,
        repaired.reason,
        how,
        (found.used,),
    )


def joined_reports(reports: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Add counts, join lists without repeats; of other values the first one stays."""
    return reduce(_joined, reports)


def _joined(a: dict[str, Any], b: dict[str, Any]) -> dict[str, Any]:
    total = {**b, **a}
    for key in a.keys() & b.keys():
        x, y = a[key], b[key]
        if isinstance(x, dict):
            total[key] = _joined(x, y)
        elif isinstance(x, int):
            total[key] = x + y
        elif isinstance(x, list):
            total[key] = list(dict.fromkeys([*x, *y]))
    return total
