# SPDX-License-Identifier: Apache-2.0
"""Ingest of elevation models and pictures: plan, read, mesh, swap the index."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rasterio.errors import RasterioError

from ingest.changed import change_of
from ingest.clock import Clock
from ingest.journal import Journal, digest
from ingest.mosaic import Mosaic
from ingest.names import replaced
from ingest.progress import Progress, silent
from ingest.raster_copy import REASONS, copy_in
from ingest.raster_open import bounded, open_raster, unreadable
from ingest.raster_plan import RasterOptions, Source, check_kinds, plan, plan_all, said_of
from ingest.terrain_build import Recipe, rebuild
from tiles.errors import InputError, UnfinishedError
from tiles.writer import Writer

ADVICES = {
    "not an elevation": "check its unit: heights are from -12,000 to 9,500 m",
    "beyond the datum's grid": "state another with --datum",
}
MEETING = "reach_m", "meets", "missed_m"
__all__ = [
    "RasterOptions",
    "copy",
    "editing",
    "ingest_rasters",
    "plan",
    "remove_raster",
]


def ingest_rasters(
    store: str | Path,
    files: Sequence[tuple[Path, RasterOptions]],
    progress: Progress = silent,
    workers: int = 0,
) -> dict[str, Any]:
    """Read rasters into a store and make the terrain again where they change it.

    Parameters
    ----------
    files : each with what the user states about it
    workers : processes; 0 for one per core

    Returns
    -------
    Report with `read`, `stored`, `merged`, `skipped`, ... of posts, and a line a source.

    Raises
    ------
    InputError
        Readers see nothing of it then; a store made for it is taken away again.
    """
    clock = Clock()
    planned = plan_all(files)
    with editing(store) as writer:
        journal = Journal(writer)
        named = {source["name"]: source for source in writer.sources()}
        check_kinds(named, planned)
        command = f"done {digest(planned)}"
        if report := journal.said(command):
            return report
        # The sample earth is planned first; what is wrong with other files shows sooner.
        copied = [copy(writer, one, progress, journal) for one in reversed(planned)]
        new = {source["name"]: source for source in reversed(copied)}
        clock.lap("read")
        after = list({**named, **new}.values())
        given = zip(planned, files, strict=True)
        own = [new[one["name"]] for one, (_, stated) in given if not stated.is_sample]
        own = own or list(new.values())
        report = posts_of(own)
        paths = {name: [source["path"]] for name, source in new.items()}
        doubts = [source["doubt"] for source in own if source["doubt"]]
        report["warnings"] = [*replaced(named, paths), *doubts]
        report |= change(journal, after, workers, progress, clock)
        for about in report["sources"]:
            one = new[about["name"]]
            about |= {key: one[key] for key in MEETING if key in one}
        report |= clock.report(report["read"])
        leave_word(writer, command, report)
    return report


def leave_word(writer: Writer, command: str, report: dict[str, Any]) -> None:
    """Note that the terrain is done where buildings stand on the old one still.

    Who comes back with the same command, goes on there.
    """
    if writer.object_count():
        journal = Journal(writer)
        with journal.step():
            journal.say(command, report)


def posts_of(copied: list[Source]) -> dict[str, Any]:
    """Count the posts that were read, and say what each source is."""
    reasons: Counter[str] = Counter()
    for source in copied:
        reasons.update(source["posts"]["skipped"])
    stored = sum(source["posts"]["stored"] for source in copied)
    counts = {"read": stored + reasons.total(), "stored": stored, "merged": 0}
    counts |= {"skipped": reasons.total(), "repaired": 0}
    about = [said_of(one) | {"skipped": one["posts"]["skipped"]} for one in copied]
    return {**counts, "skipped_by_reason": dict(reasons), "sources": about}


@contextmanager
def editing(store: str | Path) -> Iterator[Writer]:
    """Open a store for writing; one made here is taken away when its input is refused.

    But not where its making broke off, it holds what was done so far; and not where
    another command, which found it there, has put something in.
    """
    writer = Writer(store)
    try:
        yield writer
    except InputError as error:
        empty = writer.made_here and writer.meta("generation") == "0"
        writer.close()
        if empty and not isinstance(error, UnfinishedError):
            for tail in ("", "-wal", "-shm"):
                Path(f"{store}{tail}").unlink(missing_ok=True)
        raise
    finally:
        writer.close()


def copy(
    writer: Writer, source: Source, progress: Progress, journal: Journal | None = None
) -> Source:
    """Copy a planned file's posts into the store under a key that nobody names yet.

    Returns
    -------
    The source with its `blocks`, and the posts `stored` and `skipped`, by reason.

    Raises
    ------
    InputError
        Also when no post holds data.
    """
    journal = journal or Journal(writer)
    with bounded(), journal.undisturbed(), open_raster(source["path"]) as dataset:
        try:
            copied = copy_in(journal, digest(source), dataset, source, progress)
        except RasterioError as error:
            raise unreadable(source["path"], error) from error
    counts = zip(REASONS, copied.skipped, strict=True)
    skipped = {why: count for why, count in counts if count}
    if not copied.stored:
        why = max(skipped, key=skipped.__getitem__, default=REASONS[0])
        advice = ADVICES.get(why, "check its nodata value")
        reason = "holds no data" if why not in ADVICES else f"holds no height: {why}"
        raise InputError(source["path"], reason, advice)
    posts = {"stored": copied.stored, "skipped": skipped}
    return {**source, "blocks": copied.blocks, "posts": posts}


def change(
    journal: Journal,
    after: list[Source],
    workers: int,
    progress: Progress,
    clock: Clock,
) -> dict[str, Any]:
    """Give a store other sources and make the terrain again where that changes it."""
    journal.require()  # else the copies may be gone
    writer = journal.writer
    before = writer.sources()
    mosaic = Mosaic(writer.connection, after)
    for layer in mosaic.layers:
        source = next(one for one in after if one["name"] == layer.name)
        source["reach_m"], source["meets"] = mosaic.reach_m(layer), mosaic.meets(layer)
        source["missed_m"] = mosaic.missed_m(layer)
    changed = change_of(before, after, mosaic)
    recipe = Recipe(str(writer.path), after, mosaic.rims, changed)
    clock.lap("rims")
    return rebuild(journal, recipe, workers, progress, clock)


def remove_raster(
    store: str | Path, name: str, workers: int = 0, progress: Progress = silent
) -> dict[str, Any]:
    """Take a terrain or imagery source out and make the terrain again without it.

    Raises
    ------
    InputError
        When there is none of this name.
    """
    clock, command = Clock(), f"removed {name}"
    with editing(store) as writer:
        if report := Journal(writer).said(command):
            return report
        sources = writer.sources()
        names = [source["name"] for source in sources]
        if name not in names:
            known = ", ".join(names) or "none"
            raise InputError(store, f"has no source {name!r}", f"it has {known}")
        rest = [source for source in sources if source["name"] != name]
        report = change(Journal(writer), rest, workers, progress, clock)
        report = {"removed": name, **report}
        leave_word(writer, command, report)
    return report
