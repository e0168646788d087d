# SPDX-License-Identifier: Apache-2.0
"""Take a source's files in, part by part, and count what becomes of every feature.

Only a few numbers of each stored object stay in memory, to find repeats by and to say
where in its file an object came from.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.feature_report import FeatureReport
from ingest.features import FROM_GEOMETRY, Features
from ingest.heights import count_how
from ingest.object_table import delete_objects, insert_objects, read_shapes
from tiles.frames import Ints
from tiles.writer import Writer

MERGED = "merged: the same footprint again"
LISTED = 1000
"""Features not stored that a source lists; the counts are complete."""


STORED = np.dtype(
    [
        ("id", "<i8"),
        ("feature", "<i8"),  # number in the file
        ("top_m", "<f8"),
        ("digest", "<u8", 2),  # the same for the same footprint
        ("file", "<i4"),  # which of the source's files
        ("how", "u1"),
        ("was_repaired", "?"),
    ]
)
"""What is remembered of an object until all are there"""
Stored = NDArray[np.void]


@dataclass
class _Counts:
    read: int = 0
    merged: int = 0
    skipped: int = 0


class Intake:
    """One source on its way into the object table, inside a transaction."""

    def __init__(
        self, writer: Writer, name: str, first: int, look: FeatureReport | None
    ) -> None:
        """Take the source's name, the first free id, and where to list odd features."""
        self.name = name
        self._writer, self._look = writer, look
        self._next = first
        self._counts, self._reasons = _Counts(), Counter[str]()
        self._files: list[str] = []
        self._layer = self._crs = ""
        self._used: list[dict[str, Any]] = []
        self._warnings: dict[str, None] = {}
        self._not_stored: list[tuple[str, int, str]] = []
        self._stored = [np.zeros(0, STORED)]

    @property
    def next_id(self) -> int:
        """Return the first id that is still free."""
        return self._next

    def take(self, part: Features, unreadable: Iterable[tuple[int, str]] = ()) -> None:
        """Store what can be stored of a part of a file, and count the rest."""
        if part.path.name not in self._files:
            self._files.append(part.path.name)
            self._layer, self._crs = self._layer or part.layer, self._crs or part.crs
        self._warnings |= dict.fromkeys(part.warnings)
        self._used.append(part.used)
        bad = np.flatnonzero(part.reason != "")
        skipped = [(int(part.feature[k]), str(part.reason[k])) for k in bad.tolist()]
        lost = list(unreadable)
        self._skip(part.path.name, [*skipped, *lost])
        self._counts.read += len(part.reason) + len(lost)
        self._store(part)
        self._list_odd(part, lost)

    def _list_odd(self, part: Features, lost: list[tuple[int, str]]) -> None:
        if self._look is None:
            return
        odd, file = part.is_odd, part.path.name
        remark = [str(part.reason[k]) or "repaired" for k in odd.tolist()]
        self._look.add(self.name, file, part.feature[odd].tolist(), remark, part.odd)
        numbers, reasons = [one[0] for one in lost], [one[1] for one in lost]
        self._look.add(self.name, file, numbers, reasons, [None] * len(lost))

    def _skip(self, file: str, found: list[tuple[int, str]]) -> None:
        self._counts.skipped += len(found)
        self._reasons.update(reason for _, reason in found)
        room = LISTED - len(self._not_stored)
        self._not_stored += [(file, *one) for one in found[: max(room, 0)]]

    def _store(self, part: Features) -> None:
        kept = part.kept
        ids = insert_objects(self._writer, self.name, self._next, part.rows)
        self._next += len(ids)
        stored = np.zeros(len(ids), STORED)
        stored["id"], stored["file"] = ids, len(self._files) - 1
        stored["feature"], stored["how"] = part.feature[kept], part.how[kept]
        stored["was_repaired"] = part.was_repaired[kept]
        stored["top_m"], stored["digest"] = part.top_m, part.digest
        self._stored.append(stored)

    def finish(self) -> None:
        """Keep one of the objects that are the same: the tallest, of these the first."""
        stored = np.concatenate(self._stored)
        words = stored["digest"].T
        order = np.lexsort((stored["id"], -stored["top_m"], *words))
        digest = stored["digest"][order]
        again = np.zeros(len(order), bool)
        again[order[1:]] = (digest[1:] == digest[:-1]).all(axis=1)
        self._list_merged(stored[again])
        delete_objects(self._writer, stored["id"][again])
        self._stored = [stored[~again]]

    def _list_merged(self, lost: Stored) -> None:
        self._counts.merged = len(lost)
        room = max(LISTED - len(self._not_stored), 0)
        pairs = lost[["file", "feature"]][:room].tolist()
        self._not_stored += [(self._files[file], one, MERGED) for file, one in pairs]
        self._look_at(lost, MERGED)

    def _look_at(self, objects: Stored, remark: str) -> None:
        """List stored objects in the report of features to look at."""
        if self._look is None:
            return
        for k, file in enumerate(self._files):
            mine = objects[objects["file"] == k]
            shapes = read_shapes(self._writer, mine["id"]).footprint
            numbers = mine["feature"].tolist()
            self._look.add(self.name, file, numbers, [remark] * len(shapes), shapes)

    def note(self, ids: Ints, remark: str) -> None:
        """List the objects of this source among `ids` as features to look at."""
        stored = self._stored[0]
        self._look_at(stored[np.isin(stored["id"], ids)], remark)

    def report(self) -> dict[str, Any]:
        """Count what became of the features; read = stored + merged + skipped."""
        how = self._stored[0]["how"]
        by_geometry = int(np.count_nonzero(how & FROM_GEOMETRY))
        heights = {**count_how(how), "from_geometry": by_geometry}
        return {
            "read": self._counts.read,
            "stored": len(how),
            "merged": self._counts.merged,
            "skipped": self._counts.skipped,
            "repaired": int(self._stored[0]["was_repaired"].sum()),
            "skipped_by_reason": dict(self._reasons),
            "heights": {**heights, **joined_reports(self._used)},
            "warnings": list(self._warnings),
        }

    def details(self) -> dict[str, Any]:
        """Return what the store remembers about the source."""
        return {
            "files": self._files,
            "layer": self._layer,
            "crs": self._crs,
            "report": self.report(),
            "not_stored": [list(one) for one in self._not_stored],
        }


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
