# SPDX-License-Identifier: Apache-2.0
"""`geopage ingest buildings`: files are streamed in, then all tiles are made anew.

Everything is written in one transaction: whatever goes wrong, the store is as it was,
and who reads it sees the old city until the new one is whole.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from ingest.clock import Clock
from ingest.feature_report import FeatureReport
from ingest.features import Features, features_of, packed
from ingest.footprints import Footprints, read_parts
from ingest.grounding import Ground
from ingest.heights import HeightRules, heights_of
from ingest.intake import Intake, joined_reports
from ingest.names import name_of, replaced
from ingest.object_build import FEW_OBJECTS, Rebuilt, rebuild_objects
from ingest.object_table import highest_id
from ingest.progress import Progress, silent
from ingest.synthetic import replicated
from ingest.terrain import editing
from ingest.workers import Workers
from tiles.errors import InputError
from tiles.writer import Writer

__all__ = [
    "BuildingOptions",
    "Rebuilt",
    "check_buildings",
    "ingest_buildings",
    "ingest_parts",
    "ingest_synthetic",
    "rebuild_objects",
    "remove_buildings",
]
KIND = "buildings"
CACHE_KIB = 64 << 10
PART_FEATURES = 25_000
"""Features that are read, repaired and stored at once."""
Unreadable = tuple[tuple[int, str], ...]
Parts = Callable[[], Iterator[Footprints]]
"""Reads a file, or makes features, from the start"""


@dataclass(frozen=True, slots=True)
class BuildingOptions:
    """What a user can say about building files."""

    name: str | None = None
    """name of the source; by default each file's own name without its ending"""
    layer: str | None = None
    crs: str | None = None
    heights: HeightRules = field(default_factory=HeightRules)
    report: Path | None = None
    """GeoPackage to write with skipped, repaired, floating and sunk features"""
    workers: int = 0
    """processes for a large city; 0 for one per core"""


def ingest_buildings(
    store: str | Path,
    paths: Sequence[str | Path],
    options: BuildingOptions,
    progress: Progress = silent,
    ground: Ground | None = None,
) -> dict[str, Any]:
    """Put building files into a store; a source that is there already is replaced.

    Parameters
    ----------
    store : path of the store, made when it is not there
    progress : called with done, total and what was done
    ground : what to stand on, instead of the store's terrain

    Returns
    -------
    The report: read = stored + merged + skipped, and where the time went.

    Raises
    ------
    InputError
        The store is as it was then.
    """
    sources: dict[str, list[Parts]] = {}
    for path in paths:
        name = options.name or name_of(path)
        sources.setdefault(name, []).append(_reader(path, options))
    return ingest_parts(store, sources, options, progress, ground)


def ingest_parts(
    store: str | Path,
    sources: dict[str, list[Parts]],
    options: BuildingOptions,
    progress: Progress = silent,
    ground: Ground | None = None,
    details: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Put sources of buildings into a store, each read in parts.

    Parameters
    ----------
    sources : by name, what to read
    details : what the store is to remember about the sources besides
    """
    clock = Clock()
    with ExitStack() as stack:
        enter = stack.enter_context
        look = enter(FeatureReport(options.report)) if options.report else None
        writer = enter(editing(store))
        pool = enter(Workers(options.workers, str(store)))
        # One transaction is larger than SQLite's own cache, and its rows are read again.
        writer.connection.execute(f"PRAGMA cache_size=-{CACHE_KIB}")
        enter(writer.transaction())
        before = _check_names(writer, sources)
        taken = _taken(writer, sources, options, look, pool, progress)
        clock.lap("read and store")
        rebuilt = rebuild_objects(writer, ground, progress, pool, clock)
        for intake in taken:
            for remark, ids in rebuilt.noted.items():
                intake.note(ids, remark)
            writer.put_source(intake.name, KIND, intake.details() | (details or {}))
        report = _report(taken, rebuilt)
        files = {one.name: one.details()["files"] for one in taken}
        report["warnings"] = [*replaced(before, files), *report["warnings"]]
    clock.lap("commit")
    return report | _rates(clock, report)


def ingest_synthetic(
    store: str | Path,
    path: Path,
    count: int,
    options: BuildingOptions,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Put copies of a file's buildings into a store, on land around where they are."""
    name = options.name or f"synthetic_{name_of(path)}"

    def read() -> Iterator[Footprints]:
        return replicated(path, Path(store), count, options.layer, options.crs)

    details = {"synthetic": f"replicated from {path.name}"}
    return ingest_parts(store, {name: [read]}, options, progress, details=details)


def check_buildings(paths: Iterable[str | Path], options: BuildingOptions) -> None:
    """Read the beginning of files, so that what can't be used is refused at once.

    Raises
    ------
    InputError
    """
    for path in paths:
        # That there is no polygon, a reader says after the last part.
        for part in islice(_with_fields(_reader(path, options)(), options.heights), 2):
            heights_of(path, part.columns, len(part.feature), options.heights)


def remove_buildings(
    store: str | Path, name: str, progress: Progress = silent
) -> dict[str, Any]:
    """Take a building source out and make the object tiles again without it."""
    with Writer(store) as writer, writer.transaction():
        writer.drop_source(name)
        rebuilt = rebuild_objects(writer, progress=progress)
        return {"removed": name, **rebuilt.report}


def _reader(path: str | Path, options: BuildingOptions) -> Parts:
    return lambda: read_parts(path, options.layer, options.crs, PART_FEATURES)


def _taken(
    writer: Writer,
    sources: dict[str, list[Parts]],
    options: BuildingOptions,
    look: FeatureReport | None,
    pool: Workers,
    progress: Progress,
) -> list[Intake]:
    """Read all sources and store their objects instead of those of the same names."""
    taken, first = [], highest_id(writer) + 1
    for name, readers in sources.items():
        writer.connection.execute("DELETE FROM object WHERE source=?", (name,))
        intake = Intake(writer, name, first, look)
        for read in readers:
            for features, unreadable in _prepared(read(), options.heights, pool):
                intake.take(features, unreadable)
                # How many there will be, no file says before it was read.
                progress(intake.next_id - first, intake.next_id - first, f"storing {name}")
        intake.finish()
        first = intake.next_id
        taken.append(intake)
    return taken


def _prepared(
    parts: Iterator[Footprints], rules: HeightRules, pool: Workers
) -> Iterator[tuple[Features, Unreadable]]:
    """Repair what is read of one file; other processes do so where there is much."""
    unreadable: deque[Unreadable] = deque()

    def jobs(some: Iterable[Footprints]) -> Iterator[tuple[Footprints, HeightRules]]:
        for part in _with_fields(some, rules):
            unreadable.append(part.unreadable)
            yield packed(part), rules

    first, count = [], 0
    while count < FEW_OBJECTS and (part := next(parts, None)) is not None:
        first.append(part)
        count += len(part.feature)
    all_jobs = jobs(chain(first, parts))
    few = count < FEW_OBJECTS
    done = map(features_of, all_jobs) if few else pool.run(features_of, all_jobs)
    for features in done:
        yield features, unreadable.popleft()


def _with_fields(parts: Iterable[Footprints], rules: HeightRules) -> Iterator[Footprints]:
    """Give parts the fields that heights are to come from, if parts before had them."""
    seen: set[str] = set()
    for part in parts:
        seen |= part.columns.keys() & {rules.height, rules.levels, rules.base}
        nothing = np.full(len(part.feature), None, object)
        yield replace(part, columns=dict.fromkeys(seen, nothing) | part.columns)


def _check_names(writer: Writer, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the store's sources by name, if none of another kind has one of the names."""
    before = {source["name"]: source for source in writer.sources()}
    for name in names:
        if name in before and before[name]["kind"] != KIND:
            reason = f"{before[name]['kind']} source of this name is in the store"
            raise InputError(name, reason, "choose another with --name")
    return before


def _report(taken: Sequence[Intake], rebuilt: Rebuilt) -> dict[str, Any]:
    read = joined_reports(one.report() for one in taken)
    heard = [*read["warnings"], *rebuilt.report["warnings"]]
    names = [one.name for one in taken]
    return {**read, **rebuilt.report, "warnings": heard, "sources": names}


def _rates(clock: Clock, report: dict[str, Any]) -> dict[str, Any]:
    said = clock.report(report["read"])
    return {
        "seconds": said["seconds"],
        "stages_s": said["seconds_by_stage"],
        "buildings_per_s": said["posts_per_s"],
    }
