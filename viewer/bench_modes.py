# SPDX-License-Identifier: Apache-2.0
"""How a method is measured: settled at key frames, or flown in real time."""

import time
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from geopage.draw_list import DrawList
from geopage.policies.oracle import Oracle
from geopage.settings import MIB, PagerSettings
from geopage.view import ViewState
from tiles.errors import InputError
from tiles.frames import Floats
from tiles.lanes import Lane
from tiles.surface import Surface
from viewer.bench_methods import Method
from viewer.bench_score import Frame, KeyFrame, Scorer, Scores
from viewer.camera_path import CameraPath
from viewer.flight import FRAME_S, Recording, fly_paced
from viewer.paging import Paging
from viewer.poses import Flight
from viewer.replay import Replay, distinct_bytes, look_again, time_again
from viewer.report import frame_figures, percentiles
from viewer.session import Session

DRAWS = 3
DRAWN = ("triangles", "draw_calls", "objects")
Json = dict[str, Any]


class Hurried(Flight):
    """A path flown in another time than its own.

    Parameters
    ----------
    seconds : how long the whole flight takes
    """

    def __init__(
        self,
        path: CameraPath,
        surface: Surface,
        size_px: tuple[int, int],
        seconds: float,
    ) -> None:
        super().__init__(path, surface, size_px)
        self._speed = path.duration_s / seconds
        self.path = copy(path)
        self.path.duration_s = seconds

    def view(self, t_s: float) -> ViewState:
        """Return the view at a time of this flight."""
        return replace(super().view(t_s * self._speed), t_s=t_s)


@dataclass(frozen=True, slots=True)
class Course:
    """What is flown, and how finely it is judged."""

    store: Path
    path: CameraPath
    seconds: float
    """How long a paced flight takes"""
    key_frames: int
    budget_bytes: int
    floor_frames: int
    """About so many frames of a paced flight are timed again"""


def moments(course: Course) -> list[float]:
    """Return the times of the key frames on the path's own clock, spread evenly, s."""
    last_s = max(course.path.duration_s - FRAME_S, 0.0)
    return [float(t_s) for t_s in np.linspace(0.0, last_s, course.key_frames)]


def views_of(course: Course, flight: Flight) -> list[tuple[ViewState, ViewState]]:
    """Return the views of the key frames, and of the frames after them."""
    times_s = moments(course)
    return [(flight.view(t_s), flight.view(t_s + FRAME_S)) for t_s in times_s]


def key_frames(
    scorer: Scorer,
    views: Sequence[tuple[ViewState, ViewState]],
    method: Method,
    threshold_px: float,
) -> list[KeyFrame]:
    """Return what a method draws, settled, in some views."""

    def frame(view: ViewState) -> Frame:
        drawn = scorer.stages.draw_list(method, view, threshold_px)
        return Frame(view, drawn, method.mesh)

    return [KeyFrame(frame(now), frame(after)) for now, after in views]


def time_in_turn(scorer: Scorer, cases: Sequence[Sequence[KeyFrame]]) -> list[Floats]:
    """Time the key frames of several cases.

    Every case is drawn once before any is drawn again: what slows the machine down for a
    while then slows all of them alike. The first round is not counted.

    Returns
    -------
    frame_ms : for each case (DRAWS, its key frames)
    """
    rounds = [
        [[scorer.draw(frame.now).frame_ms for frame in case] for case in cases]
        for _ in range(DRAWS + 1)
    ]
    return [np.array(draws) for draws in zip(*rounds[1:], strict=True)]


def settled(
    scorer: Scorer, frames: Sequence[KeyFrame], frame_ms: Floats, threshold_px: float
) -> tuple[Json, Scores]:
    """Measure what a method draws when everything is there.

    Parameters
    ----------
    frames, frame_ms : of `key_frames` and `time_in_turn`
    """
    session = scorer.stages.session(frames[0].now.mesh)
    stats = [scorer.draw(frame.now) for frame in frames]
    took = percentiles(np.median(frame_ms, axis=0))
    figures = {
        "frames": len(frames),
        **{f"frame_{key}_ms": value for key, value in took.items()},
        "frame_spread_ms": float(np.median(np.ptp(frame_ms, axis=0))),
        **{name: float(np.mean([getattr(one, name) for one in stats])) for name in DRAWN},
        **drawn_bytes(session, [frame.now.drawn for frame in frames]),
        **known(look(session, frames)),
    }
    scores = scorer.score(frames, threshold_px)
    return {**figures, **scores.figures()}, scores


def paced(
    scorer: Scorer, course: Course, flight: Hurried, method: Method, threshold_px: float
) -> tuple[Json, Scores]:
    """Fly a method in real time, then judge frames of that flight."""
    settings = method.settings(threshold_px, course.budget_bytes)
    picture, gl = scorer.session.picture, scorer.session.renderer.gl
    with Session(course.store, settings, picture, context=gl) as session:
        recording = fly_paced(session, flight, lambda done: None)
        session.pager.close()
        part = spread(len(recording.views), course.floor_frames)
        floor_ms = time_again(session, only(recording, part), lambda done: None)
        bytes_read = session.pager.counters["bytes_read"]
    lists = recording.lists
    if len(lists) < 2:
        raise InputError(course.path.name, "is over before two frames", "fly it longer")
    times_s = [t_s * course.seconds / course.path.duration_s for t_s in moments(course)]
    keys = shown_at(recording, flight, times_s)
    table, played = recording.table(), look(scorer.session, keys)
    flown = frame_figures(table, played, paced=True)
    figures = {
        "frames": flown["count"],
        **{f"frame_{key}_ms": flown[f"{key}_ms"] for key in ("p50", "p95", "p99", "max")},
        "jank_ms": flown["jank_ms"],
        "floor_p50_ms": float(np.percentile(floor_ms, 50)),
        "floor_p99_ms": float(np.percentile(floor_ms, 99)),
        "settle_ms": recording.settle_s * 1e3,
        **{name: float(table[name].mean()) for name in DRAWN},
        **drawn_bytes(scorer.session, lists),
        "bytes_read": bytes_read,
        **(oracle(course, flight, settings) if method.is_ours else {}),
        "stand_in_frames": flown["with_stand_ins"],
        **known(played),
    }
    scores = scorer.score(keys, threshold_px)
    return {**figures, **scores.figures()}, scores


def oracle(course: Course, flight: Flight, settings: PagerSettings) -> Json:
    """Return what a pager reads that knows the whole flight: by a virtual clock."""
    paging = Paging(course.store, replace(settings, policy="oracle"))
    with paging.pager as pager:
        if isinstance(pager.policy, Oracle):
            paging.foresee(pager.policy, flight)
        start_s = paging.settle(flight.view(0.0))
        for i in range(round(course.seconds / FRAME_S)):
            paging.frame(flight.view(i * FRAME_S))
            now_s = start_s + i * FRAME_S
            pager.advance(now_s, now_s + FRAME_S)
        counted = pager.counters
    return {"oracle_bytes": counted["bytes_read"], "oracle_tiles": counted["tiles_loaded"]}


def read_rate(session: Session, frames: Sequence[KeyFrame]) -> str:
    """Say how fast the tiles of some frames are read, checked and unpacked."""
    rows = {
        lane: np.unique(np.concatenate([getattr(f.now.drawn, name) for f in frames]))
        for lane, name in ((Lane.TERRAIN, "terrain"), (Lane.OBJECTS, "objects"))
    }
    start_s = time.perf_counter()
    for lane, of in rows.items():
        for row in of.tolist():
            session.tile(lane, row)
    seconds = time.perf_counter() - start_s
    size, count = drawn_bytes(session, [frame.now.drawn for frame in frames]).values()
    return f"{size / MIB / seconds:.0f} MiB a second: {count} tiles, page cache warm"


def look(session: Session, frames: Sequence[KeyFrame]) -> Replay:
    """Look for holes, and at the selection's own error, in key frames."""
    recording = Recording(
        views=[frame.now.view for frame in frames],
        lists=[frame.now.drawn for frame in frames],
    )
    return look_again(session, recording, np.zeros(0), None, lambda done: None)


def known(played: Replay) -> Json:
    """Return what the selection knows and what is missing."""
    error_px = float(np.median(played.screen_error_px))
    return {"selection_error_px": error_px, "hole_frames": played.hole_frames}


def drawn_bytes(session: Session, lists: list[DrawList]) -> Json:
    """Return stored bytes and number of the tiles that are drawn."""
    size, count = distinct_bytes(session, lists)
    return {"bytes": size, "tiles": count}


def shown_at(recording: Recording, flight: Flight, times_s: list[float]) -> list[KeyFrame]:
    """Return what a flight drew at some moments, from where the path is just then.

    So all flights are judged at the same poses, whenever their frames began.
    """
    began_s = [view.t_s for view in recording.views]

    def at(t_s: float) -> Frame:
        last = max(int(np.searchsorted(began_s, t_s, side="right")) - 1, 0)
        return Frame(flight.view(t_s), recording.lists[last])

    return [KeyFrame(at(t_s), at(t_s + FRAME_S)) for t_s in times_s]


def spread(count: int, most: int) -> list[int]:
    """Return at most so many of `count` numbers, ends included."""
    places = np.linspace(0, count - 1, min(most, count))
    return [int(i) for i in np.unique(places.astype(int))]


def only(recording: Recording, part: Sequence[int]) -> Recording:
    """Return some frames of a recording, to be drawn again."""
    views, lists = recording.views, recording.lists
    return Recording(views=[views[i] for i in part], lists=[lists[i] for i in part])
