# SPDX-License-Identifier: Apache-2.0
"""How a method is measured: settled at key frames, or flown in real time."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from geopage.draw_list import DrawList
from geopage.view import ViewState
from tiles.errors import InputError
from tiles.frames import Floats
from tiles.surface import Surface
from viewer.bench_methods import Method
from viewer.bench_score import KeyFrame, Scorer, Scores
from viewer.camera_path import CameraPath
from viewer.flight import FRAME_S, Recording, fly_paced
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


def key_frames(
    session: Session, course: Course, method: Method, threshold_px: float
) -> list[KeyFrame]:
    """Return what a method draws, settled, at moments spread evenly over the path."""
    flight = Flight(course.path, session.surface, session.picture.size_px)
    last_s = max(course.path.duration_s - FRAME_S, 0.0)
    forests, frames = session.pager.forests, []
    for t_s in np.linspace(0.0, last_s, course.key_frames).tolist():
        views = flight.view(t_s), flight.view(t_s + FRAME_S)
        drawn = (method.draw_list(forests, view, threshold_px) for view in views)
        frames.append(KeyFrame(*zip(views, drawn, strict=True)))
    return frames


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
    session = scorer.session
    stats = [scorer.draw(frame.now) for frame in frames]
    took = percentiles(np.median(frame_ms, axis=0))
    figures = {
        "frames": len(frames),
        **{f"frame_{key}_ms": value for key, value in took.items()},
        "frame_spread_ms": float(np.median(np.ptp(frame_ms, axis=0))),
        **{name: float(np.mean([getattr(one, name) for one in stats])) for name in DRAWN},
        **drawn_bytes(session, [frame.now[1] for frame in frames]),
        **known(look(session, frames)),
    }
    scores = scorer.score(frames, threshold_px, keep=True)
    return {**figures, **scores.figures()}, scores


def paced(
    scorer: Scorer, course: Course, method: Method, threshold_px: float
) -> tuple[Json, Scores]:
    """Fly a method in real time, then judge frames of that flight."""
    settings = method.settings(threshold_px, course.budget_bytes)
    picture = scorer.session.picture
    with Session(course.store, settings, picture) as session:
        flight = Hurried(course.path, session.surface, picture.size_px, course.seconds)
        recording = fly_paced(session, flight, lambda done: None)
        session.pager.close()
        part = spread(len(recording.views), course.floor_frames)
        floor_ms = time_again(session, only(recording, part), lambda done: None)
        bytes_read = session.pager.counters["bytes_read"]
    lists, views = recording.lists, recording.views
    if len(views) < 2:
        raise InputError(course.path.name, "is over before two frames", "fly it longer")
    keys = [
        KeyFrame((views[i], lists[i]), (views[i + 1], lists[i + 1]))
        for i in nearest([view.t_s for view in views[:-1]], course.key_frames, flight)
    ]
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
        "stand_in_frames": flown["with_stand_ins"],
        **known(played),
    }
    scores = scorer.score(keys, threshold_px, keep=False)
    return {**figures, **scores.figures()}, scores


def look(session: Session, frames: Sequence[KeyFrame]) -> Replay:
    """Look for holes, and at the selection's own error, in key frames."""
    views, lists = zip(*(frame.now for frame in frames), strict=True)
    recording = Recording(views=list(views), lists=list(lists))
    return look_again(session, recording, np.zeros(0), None, lambda done: None)


def known(played: Replay) -> Json:
    """Return what the selection knows and what is missing."""
    error_px = float(np.median(played.screen_error_px))
    return {"selection_error_px": error_px, "hole_frames": played.hole_frames}


def drawn_bytes(session: Session, lists: list[DrawList]) -> Json:
    """Return stored bytes and number of the tiles that are drawn."""
    size, count = distinct_bytes(session, lists)
    return {"bytes": size, "tiles": count}


def nearest(times_s: list[float], count: int, flight: Flight) -> list[int]:
    """Return the frames next to moments spread over a flight, so that runs compare."""
    wanted = np.linspace(0.0, flight.path.duration_s, count)
    away_s = np.abs(np.subtract.outer(np.array(times_s), wanted))
    return [int(i) for i in np.unique(away_s.argmin(axis=0))]


def spread(count: int, most: int) -> list[int]:
    """Return at most so many of `count` numbers, ends included."""
    places = np.linspace(0, count - 1, min(most, count))
    return [int(i) for i in np.unique(places.astype(int))]


def only(recording: Recording, part: Sequence[int]) -> Recording:
    """Return some frames of a recording, to be drawn again."""
    views, lists = recording.views, recording.lists
    return Recording(views=[views[i] for i in part], lists=[lists[i] for i in part])
