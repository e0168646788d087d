# SPDX-License-Identifier: Apache-2.0
"""`geopage bench`: speed against accuracy of every method, on one's own data."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geopage.progress import bar
from geopage.settings import MIB, PagerSettings
from geopage.view import ViewState
from tiles.errors import InputError
from viewer.bench_chart import PICTURE, bench_chart
from viewer.bench_methods import METHODS, SETTLED, Method, that_differ
from viewer.bench_modes import (
    Course,
    Hurried,
    key_frames,
    paced,
    read_rate,
    settled,
    time_in_turn,
    views_of,
)
from viewer.bench_page import FRAMES, Triple, bench_page, write_triple
from viewer.bench_score import Scorer, Scores
from viewer.bench_table import as_csv
from viewer.camera_path import CameraPath, read_path
from viewer.charts import pyplot
from viewer.key_frames import WIDTH_PX
from viewer.machine import machine, where_measured
from viewer.poses import Flight
from viewer.run import Run, make_folders
from viewer.session import Picture, Session

THRESHOLDS_PX = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
QUICK_PX = (1.0, 4.0, 16.0)
KEY_FRAMES, QUICK_FRAMES = 12, 6
QUICK_S = 4.0
FLOOR_FRAMES, QUICK_FLOOR = 100_000, 40
QUICK_WIDTH_PX = 128
"""About so many pixels of a line are judged against the sources"""
SHOWN_PX = 2.0
"""Pictures are shown of the coarsest threshold and of the one nearest to this."""
FINER, FINEST_PX = 4.0, 0.125
"""The reference is so much finer than the finest threshold, and at least so fine."""
Json = dict[str, Any]
Case = tuple[Method, str, float]
HEAD = ("method", "mode", "threshold_px")


@dataclass(frozen=True, slots=True)
class Bench:
    """What to measure and where to write it."""

    path: Path
    out: Path
    thresholds_px: tuple[float, ...] = ()
    """Empty: the default sweep"""
    quick: bool = False
    size_px: tuple[int, int] | None = None
    budget_bytes: int = 512 * MIB
    key_frames: int | None = None

    @property
    def sweep(self) -> tuple[float, ...]:
        """Thresholds, ascending."""
        default = QUICK_PX if self.quick else THRESHOLDS_PX
        return tuple(sorted(set(self.thresholds_px or default)))

    @property
    def picture(self) -> Picture:
        """How large the frames are."""
        return Picture(self.size_px or ((640, 360) if self.quick else (1280, 720)))


def bench(store: Path, what: Bench, methods: Sequence[Method] = METHODS) -> Json:
    """Measure all methods over all thresholds; write results.csv, chart and page.

    Returns
    -------
    `about`, what was measured and on which machine, and `rows`, as in results.csv

    Raises
    ------
    InputError
    """
    path = read_path(what.path)
    make_folders(Run(what.path, what.out / FRAMES))
    pyplot(what.out)  # whether there is one is said before anything is measured
    reference_px = min(FINEST_PX, what.sweep[0] / FINER)
    settings = PagerSettings(reference_px, budget_bytes=what.budget_bytes, fade_s=0.0)
    with Session(store, settings, what.picture) as session:
        apart = that_differ(methods, session.pager.forests)
        course = course_of(store, what, path)
        about = about_of(what, course, reference_px, machine(session.renderer.gl))
        scorer = Scorer(session, reference_px, QUICK_WIDTH_PX if what.quick else WIDTH_PX)
        cases = list(cases_of(apart, what.sweep, quick=what.quick))
        rows: dict[Case, Json] = {}
        triples: dict[Case, Triple] = {}
        with bar("measuring", len(cases), "runs") as show:
            for case, figures, scores in measured(scorer, course, cases):
                rows[case] = dict(zip(HEAD, (case[0].name, *case[1:]), strict=True))
                rows[case] |= figures
                if scores.worst and case[2] in shown(what.sweep):
                    triples[case] = write_triple(what.out, rows[case], scores.worst)
                show(len(rows))
        finest = key_frames(scorer, views_on(scorer, course), METHODS[0], what.sweep[0])
        about["tiles_read"] = read_rate(session, finest)
        scorer.stages.close()
    table = [rows[case] for case in cases]
    write(what.out, table, about, [triples[case] for case in cases if case in triples])
    return {"about": about, "rows": table}


def cases_of(
    methods: Sequence[Method], sweep: Sequence[float], *, quick: bool = False
) -> Iterator[Case]:
    """Return what is measured, in the order of the table.

    Parameters
    ----------
    quick : fly only our own method and those that differ in motion alone
    """
    for method in methods:
        for mode in method.modes:
            for threshold_px in sweep:
                if mode == SETTLED or not quick or method.is_ours or method.moves:
                    yield method, mode, threshold_px


def measured(
    scorer: Scorer, course: Course, cases: Sequence[Case]
) -> Iterator[tuple[Case, Json, Scores]]:
    """Measure cases, those that are compared soon after each other."""
    surface, size_px = scorer.session.surface, scorer.session.picture.size_px
    views = views_on(scorer, course)
    still = [case for case in cases if case[1] == SETTLED]
    frames = [key_frames(scorer, views, case[0], case[2]) for case in still]
    times = time_in_turn(scorer, frames)
    for case, own, frame_ms in zip(still, frames, times, strict=True):
        yield case, *settled(scorer, own, frame_ms, case[2])
    flight = Hurried(course.path, surface, size_px, course.seconds)
    for case in sorted(set(cases) - set(still), key=lambda c: (c[2], cases.index(c))):
        yield case, *paced(scorer, course, flight, case[0], case[2])


def views_on(scorer: Scorer, course: Course) -> list[tuple[ViewState, ViewState]]:
    """Return the views of the path's key frames."""
    session = scorer.session
    return views_of(course, Flight(course.path, session.surface, session.picture.size_px))


def course_of(store: Path, what: Bench, path: CameraPath) -> Course:
    """Return how the path is flown."""
    seconds = min(QUICK_S, path.duration_s) if what.quick else path.duration_s
    count = what.key_frames or (QUICK_FRAMES if what.quick else KEY_FRAMES)
    floor_frames = QUICK_FLOOR if what.quick else FLOOR_FRAMES
    return Course(store, path, seconds, count, what.budget_bytes, floor_frames)


def about_of(what: Bench, course: Course, reference_px: float, where: Json) -> Json:
    """Return what the header says."""
    width, height = what.picture.size_px
    hurry = course.path.duration_s / course.seconds
    speed = "" if hurry == 1 else f", {hurry:g} times as fast as the path says"
    return {
        **where_measured(where),
        "store": course.store.name,
        "path": course.path.name,
        "picture": f"{width} x {height} px",
        "paced": f"{course.seconds:g} s{speed}, one flight, page cache warm",
        "settled": f"{course.key_frames} key frames",
        "reference": f"the same views at {reference_px:g} px, everything resident",
        "memory_budget": f"{what.budget_bytes / MIB:g} MiB",
    }


def shown(sweep: Sequence[float]) -> tuple[float, float]:
    """Return the thresholds of which pictures are shown."""
    return min(sweep, key=lambda px: abs(math.log(px / SHOWN_PX))), sweep[-1]


def write(out: Path, rows: list[Json], about: Json, triples: list[Triple]) -> None:
    """Write results.csv, the chart and the page.

    Raises
    ------
    InputError
    """
    try:
        (out / "results.csv").write_text(as_csv(rows, about))
        bench_chart(rows, about, [out / "chart.svg", out / "chart.png"])
        bench_chart(rows, about, [out / "pictures.svg"], PICTURE)
        bench_page(out, rows, about, triples)
    except OSError as error:
        reason = str(error.strerror or error)
        raise InputError(out, reason, "name a folder that can be written") from error
