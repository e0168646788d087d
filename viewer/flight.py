# SPDX-License-Identifier: Apache-2.0
"""Fly a camera path, in real time or settled, and record every frame."""

import gc
import math
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.trace import TileTrace
from geopage.view import ViewState
from viewer import gil
from viewer.camera import pose_of
from viewer.frame_stats import FrameStats
from viewer.governor import Governor
from viewer.memory import Preemption, resident_bytes
from viewer.poses import Flight
from viewer.session import Session

FRAME = np.dtype(
    [
        ("t_s", "f8"),
        ("lat_deg", "f8"),
        ("lon_deg", "f8"),
        ("height_m", "f8"),
        ("heading_deg", "f8"),
        ("pitch_deg", "f8"),
        ("frame_ms", "f8"),
        ("upload_ms", "f8"),
        ("cull_ms", "f8"),
        ("draw_ms", "f8"),
        ("wait_ms", "f8"),
        ("preempted_ms", "f8"),
        ("gil_ms", "f8"),
        ("list_age_ms", "f8"),
        ("screen_error_px", "f8"),
        ("threshold_px", "f8"),
        ("expected_ms", "f8"),  # NaN without a frame budget
        ("triangles", "i8"),
        ("draw_calls", "i8"),
        ("objects", "i8"),
        ("fading", "i8"),
        ("stand_ins", "i8"),
        ("tiles_uploaded", "i8"),
        ("bytes_read", "i8"),
        ("memory_bytes", "i8"),
        ("rss_bytes", "i8"),
    ]
)
UPLOAD_BYTES = 2 << 20
UPLOAD_S = 1.5e-3
WARM_FRAMES = 3
FRAME_S = 1 / 60
"""No frame begins sooner than this after the one before, as on a 60 Hz screen."""
UNTIMED = (0.0, 0.0, 0.0, 0.0, 0, math.nan)
Progress = Callable[[float], None]


@dataclass(slots=True)
class Recording:
    """What a flight did: one FRAME, one view and one draw list a frame."""

    frames: list[tuple[float, ...]] = field(default_factory=list)
    views: list[ViewState] = field(default_factory=list)
    lists: list[DrawList] = field(default_factory=list)
    rss_before_bytes: int = 0
    settle_s: float = 0.0
    """Time to load the first view before the clock started"""
    trace: TileTrace | None = None
    """What became of each tile that was asked for, in real time"""

    def table(self) -> NDArray[np.void]:
        """Return (n,) FRAME."""
        return np.array(self.frames, FRAME)


def fly_paced(
    session: Session, flight: Flight, progress: Progress, governor: Governor | None = None
) -> Recording:
    """Fly in real time: the clock runs, frames take what they take.

    Parameters
    ----------
    governor : holds a frame rate; it may change the thresholds in every frame
    """
    recording = Recording(rss_before_bytes=resident_bytes())
    pager, renderer, feeder = session.pager, session.renderer, session.feeder
    recording.settle_s = _load_first(session, flight.view(0.0))
    gil.be_prompt()
    pace_s = governor.budget.budget_ms / 1000 if governor else FRAME_S
    with quiet_collector(), gil.interval(gil.KEEP_S), closing(Preemption()) as preemption:
        start_s = time.perf_counter()
        recording.trace = pager.record(lambda: time.perf_counter() - start_s)
        while (now_s := time.perf_counter() - start_s) < flight.path.duration_s:
            clock = FrameClock(preemption)
            view = flight.view(now_s)
            drawn = pager.draw_list()
            before_ns = time.perf_counter_ns()
            moved = feeder.feed(drawn.number, UPLOAD_BYTES, UPLOAD_S)
            upload_ms = (time.perf_counter_ns() - before_ns) / 1e6
            pager.view(view)
            clock.pause()
            stats = renderer.draw(drawn, view)
            clock.resume()
            age_ms = (view.t_s - drawn.view.t_s) * 1e3
            waited_ms, preempted_ms = clock.stood_still_ms()
            waited_ms += stats.gil_ms
            expected_ms = math.nan
            if governor:
                expected_ms = governor.frame(view, stats, clock.frame_ms())
            timed = upload_ms, waited_ms, preempted_ms, age_ms, moved, expected_ms
            record(session, recording, view, drawn, stats, timed, clock)
            progress(now_s)
            with gil.interval(gil.SHARE_S):
                time.sleep(max(0.0, pace_s - clock.frame_ms() / 1e3))
    return recording


def _load_first(session: Session, view: ViewState) -> float:
    """Start the pager, load a view and draw it some times; return how long that took."""
    pager, renderer, feeder = session.pager, session.renderer, session.feeder
    pager.view(view)
    pager.start()
    start_s = time.perf_counter()
    while not (pager.draw_list().number and pager.settled):
        feeder.feed(pager.draw_list().number)
        time.sleep(0.002)
    for _ in range(WARM_FRAMES):
        renderer.draw(pager.draw_list(), view)
    return time.perf_counter() - start_s


def fly_settled(
    session: Session, flight: Flight, count: int, progress: Progress
) -> Recording:
    """Stop at `count` poses until each is settled; then draw it once more, timed."""
    recording = Recording(rss_before_bytes=resident_bytes())
    for t_s in np.linspace(0.0, flight.path.duration_s, count).tolist():
        view = flight.view(t_s)
        drawn, _ = session.settle(view)
        clock = FrameClock()
        stats = session.renderer.draw(drawn, view)
        record(session, recording, view, drawn, stats, UNTIMED, clock)
        progress(t_s)
    return recording


class FrameClock:
    """Where the time of one frame's own Python went, drawing apart.

    Where the wall clock ran and this thread's processor clock did not, the thread stood
    still: it waited for a lock, a read or the GIL, or it was ready and the operating
    system gave the core to somebody else. Linux counts the latter.
    """

    def __init__(self, preemption: Preemption | None = None) -> None:
        self.start_ns = time.perf_counter_ns()
        self._preemption = preemption
        self._spent_ns = np.zeros(3, np.int64)
        self.resume()

    def resume(self) -> None:
        """Count from here."""
        self._from = self._now()

    def pause(self) -> None:
        """Count up to here."""
        now = self._now()
        self._spent_ns += np.array(now, np.int64) - np.array(self._from, np.int64)

    def _now(self) -> tuple[int, int, int]:
        preempted_ns = self._preemption.ns() if self._preemption else 0
        return time.perf_counter_ns(), time.thread_time_ns(), preempted_ns

    def stood_still_ms(self) -> tuple[float, float]:
        """Return the time that the thread waited, and that it was ready without a core."""
        self.pause()
        self.resume()
        wall, busy, preempted = self._spent_ns.tolist()
        return max(wall - busy - preempted, 0) / 1e6, preempted / 1e6

    def frame_ms(self) -> float:
        """Return the time since the frame began."""
        return (time.perf_counter_ns() - self.start_ns) / 1e6


def record(
    session: Session,
    recording: Recording,
    view: ViewState,
    drawn: DrawList,
    stats: FrameStats,
    timed: tuple[float, float, float, float, int, float],
    clock: FrameClock,
) -> None:
    """Write one frame down."""
    upload_ms, wait_ms, preempted_ms, age_ms, moved, expected_ms = timed
    frame_ms = clock.frame_ms()
    pose = pose_of(view)
    recording.views.append(view)
    recording.lists.append(drawn)
    recording.frames.append(
        (
            view.t_s,
            math.degrees(pose.lat_rad),
            math.degrees(pose.lon_rad),
            pose.height_m,
            math.degrees(pose.heading_rad),
            math.degrees(pose.pitch_rad),
            frame_ms,
            upload_ms,
            stats.cull_ms,
            stats.gl_ms,
            wait_ms,
            preempted_ms,
            stats.gil_ms,
            age_ms,
            stats.screen_error_px,
            drawn.threshold_px,
            expected_ms,
            stats.triangles,
            stats.draw_calls,
            stats.objects,
            stats.fading,
            stats.stand_ins,
            moved,
            session.pager.counters["bytes_read"],
            sum_of(session.pager.memory()),
            resident_bytes(),
        )
    )


def sum_of(memory: dict[str, int]) -> int:
    """Return the bytes in use now."""
    return sum(
        memory[key]
        for key in ("index_bytes", "resident_bytes", "uploaded_bytes", "in_flight_bytes")
    )


class quiet_collector:  # noqa: N801  (used as a statement)
    """Keep Python's garbage collector out of the frames inside."""

    def __enter__(self) -> None:
        gc.collect()
        gc.freeze()
        gc.disable()

    def __exit__(self, *_: object) -> None:
        gc.enable()
        gc.unfreeze()
