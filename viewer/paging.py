# SPDX-License-Identifier: Apache-2.0
"""Page a flight without drawing it, by a virtual clock.

Every frame takes `FRAME_S` or what is asked for; selecting, reading and decoding take no
time; a throttled line takes what it says. So nothing depends on the machine, and two runs
give the same figures. The flight begins when the first view has all that it needs, and
nothing else: until then all policies page alike, on demand.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from geopage.draw_list import DrawList
from geopage.pager import Pager
from geopage.policies.oracle import SLOT_S, Oracle
from geopage.prediction import ground_under
from geopage.screen_error import lens_of
from geopage.selection import Thresholds, everything, select, trees_of
from geopage.settings import MIB, PagerSettings
from geopage.trace import summary
from geopage.view import ViewState
from tiles.errors import InputError
from tiles.forest import Rows, build_forest
from tiles.lanes import Lane
from tiles.store import Store
from viewer.area_error import by_area, screen_errors_px
from viewer.flight import FRAME_S, UPLOAD_BYTES
from viewer.paging_trace import write_trace_page
from viewer.poses import Flight

PERCENT = 95.0
LEAST_BYTES_S = 1024.0
SETTLE_STEPS, LONGER = 1000, 1.02
"""A first view that is not there after so many steps, each a little longer, never is."""


@dataclass(slots=True)
class Seen:
    """What each frame showed."""

    error_px: list[float] = field(default_factory=list)
    """95th percentile over the picture's ground"""
    objects_missing: list[int] = field(default_factory=list)
    """object tiles that the view needs and for which coarser ones, or none, are drawn"""
    with_stand_ins: int = 0


class Paging:
    """A pager and what stands in for a renderer. Thread: the one that made it."""

    def __init__(self, store: Path, settings: PagerSettings) -> None:
        self.pager = Pager(store, settings, dry=True)
        self.trees = trees_of(self.pager.forests)
        self._cell = self.pager.forests[Lane.TERRAIN].records["cell"]
        self._limits = Thresholds(settings.threshold_px, settings.objects_px)
        self._there = {
            lane: np.zeros(len(tree.parent), np.uint8) for lane, tree in self.trees.items()
        }
        self.seen = Seen()
        self.upload_bytes = UPLOAD_BYTES
        """taken over in a frame"""
        self.uploaded: set[tuple[Lane, int]] = set()
        """what the last frame took over"""
        self.now_s = 0.0
        """of the flight; the trace's clock"""

    def frame(self, view: ViewState) -> DrawList:
        """Do what a render loop does for one frame, but for the drawing."""
        pager = self.pager
        pager.view(view)
        drawn = pager.draw_list()
        for lane, row in pager.releases(drawn.number):
            self._there[lane][row] = 0
            pager.released(lane, row)
        self.uploaded.clear()
        for item in pager.take_uploads(self.upload_bytes):
            self._there[item.lane][item.row] = 1
            self.uploaded.add((item.lane, item.row))
            pager.uploaded(item.lane, item.row)
        return drawn

    def foresee(self, oracle: Oracle, flight: Flight) -> None:
        """Tell the oracle what is to come."""
        throttle = self.pager.settings.throttle
        rate = throttle.mib_per_s * MIB if throttle else np.inf
        times_s = np.arange(0.0, flight.path.duration_s, SLOT_S).tolist()
        views = [flight.view(t_s) for t_s in times_s]
        forest = self.pager.forests[Lane.TERRAIN]
        grounds_m = [ground_under(forest, view.eye) for view in views]
        oracle.foresee(self.trees, views, grounds_m, self._limits, rate)

    def error_px(self, drawn: DrawList, view: ViewState) -> float:
        """Return the 95th percentile of a list's screen error, by area."""
        ground_m = ground_under(self.pager.forests[Lane.TERRAIN], view.eye)
        tree = self.trees[Lane.TERRAIN]
        errors_px = screen_errors_px(tree, self._cell, drawn, view, ground_m)
        return by_area(errors_px, PERCENT)

    def settle(self, view: ViewState) -> float:
        """Load what the first view needs; return when that is done."""
        now_s, step_s = 0.0, FRAME_S
        for _ in range(SETTLE_STEPS):
            if self.frame(view).number and self.missing(view) == (0, 0):
                return now_s
            self.pager.advance(now_s, now_s + step_s)
            now_s += step_s
            step_s *= LONGER  # over a slow line it takes hours
        raise InputError("first view", "it never has all that it needs", ADVICE)

    def missing(self, view: ViewState) -> tuple[int, int]:
        """Count the terrain and object tiles that a view needs and has not."""
        return len(self._wanted(Lane.TERRAIN, view)), len(self._wanted(Lane.OBJECTS, view))

    def _wanted(self, lane: Lane, view: ViewState) -> Rows:
        chosen = select(self.trees, lens_of(view), self._there, self._limits)
        return chosen.wants[lane].rows

    def objects_missing(self, drawn: DrawList, view: ViewState) -> int:
        """Count the object tiles that a view needs and a list draws coarser ones for.

        Or none at all. Where it draws finer ones instead, nothing is missing.
        """
        tree = self.trees[Lane.OBJECTS]
        has_drawn = np.zeros(len(tree.parent), np.bool_)
        rows = drawn.objects
        while len(rows):
            has_drawn[rows] = True
            rows = tree.parent[rows]
            rows = rows[rows >= 0]
            rows = rows[~has_drawn[rows]]
        return int((~has_drawn[self._wanted(Lane.OBJECTS, view)]).sum())

    def look(self, drawn: DrawList, view: ViewState) -> None:
        """Write down how good a list is for a view."""
        self.seen.error_px.append(self.error_px(drawn, view))
        self.seen.objects_missing.append(self.objects_missing(drawn, view))
        self.seen.with_stand_ins += bool(drawn.stand_in.any())


ADVICE = "give it more memory with --budget, or a larger --threshold"


def page_flight(
    store: Path,
    flight: Flight,
    settings: PagerSettings,
    progress: Callable[[float], None],
    out: Path | None = None,
    frame_s: float = FRAME_S,
) -> dict[str, Any]:
    """Page one flight and return its figures, JSON-ready.

    Parameters
    ----------
    out : folder for the trace and its page
    frame_s : how long each frame takes
    """
    paging = Paging(store, replace(settings, policy="demand"))
    with paging.pager as pager:
        start_s = paging.settle(flight.view(0.0))
        pager.set_policy(settings.policy)
        if isinstance(pager.policy, Oracle):
            paging.foresee(pager.policy, flight)
        trace = pager.record(lambda: paging.now_s)
        before, booked = pager.counters, carried(pager)
        count = round(flight.path.duration_s / frame_s)
        for i in range(count):
            paging.now_s = i * frame_s
            view = flight.view(paging.now_s)
            drawn = paging.frame(view)
            paging.look(drawn, view)
            now_s = start_s + paging.now_s
            pager.advance(now_s, now_s + frame_s)
            progress(paging.now_s)
        spent = {key: value - before[key] for key, value in pager.counters.items()}
        found = figures(settings, paging.seen, spent) | {
            "bytes_carried": carried(pager) - booked,
            "peak_bytes": pager.memory()["peak_bytes"],
            "first_view_s": start_s,
            "seconds": flight.path.duration_s,
            "prediction": summary(trace.table()),
        }
        if out:
            write_trace_page(out, trace.table(), paging.trees, found)
        return found


def ideal_bytes(store: Path, flight: Flight, settings: PagerSettings) -> int:
    """Return the stored bytes of the distinct tiles that a flight's views draw.

    When all is there; without those of the first view.
    """
    limits = Thresholds(settings.threshold_px, settings.objects_px)
    with Store(store) as opened:
        trees = trees_of({lane: build_forest(opened.index(lane)) for lane in Lane})
    there, total = everything(trees), 0
    drawn = {lane: np.zeros(len(tree.parent), np.bool_) for lane, tree in trees.items()}
    times_s = np.arange(0.0, flight.path.duration_s, SLOT_S).tolist()
    for i, t_s in enumerate(times_s):
        chosen = select(trees, lens_of(flight.view(t_s)), there, limits)
        for lane, rows in ((Lane.TERRAIN, chosen.terrain), (Lane.OBJECTS, chosen.objects)):
            new = np.unique(rows[~drawn[lane][rows]])
            drawn[lane][new] = True
            total += int(trees[lane].tile_bytes[new].sum()) if i else 0
    return total


def needed_mib_per_s(ideal: int, seconds: float) -> float:
    """Return the rate of a line that carries a flight's ideal bytes while it lasts."""
    return max(ideal / seconds, LEAST_BYTES_S) / MIB


def carried(pager: Pager) -> int:
    """Return the bytes that came through the throttled line, or that were read."""
    return pager.line.carried_bytes if pager.line else pager.counters["bytes_read"]


def figures(settings: PagerSettings, seen: Seen, spent: dict[str, int]) -> dict[str, Any]:
    """Put together what a flight showed and what it cost."""
    error_px, missing = np.array(seen.error_px), np.array(seen.objects_missing)
    good = error_px <= settings.threshold_px
    throttle = settings.throttle
    return {
        "policy": settings.policy,
        "throttle": [throttle.mib_per_s, throttle.latency_ms] if throttle else None,
        "frames": len(error_px),
        "share_frames_within": float(good.mean()),
        "share_frames_complete": float((good & (missing == 0)).mean()),
        "error_p50_px": float(np.percentile(error_px, 50)),
        "error_p95_px": float(np.percentile(error_px, 95)),
        "object_tiles_missing_mean": float(missing.mean()),
        "frames_with_stand_ins": seen.with_stand_ins,
        **spent,
    }
