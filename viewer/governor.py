# SPDX-License-Identifier: Apache-2.0
"""Holds a frame rate: tells a pager the thresholds that a `FrameBudget` chooses."""

import time
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geopage.prediction import ground_under
from geopage.selection import Thresholds
from geopage.view import ViewState
from tiles.frames import Ecef
from tiles.lanes import Lane
from viewer.frame_budget import FrameBudget, Load
from viewer.frame_stats import FrameStats
from viewer.load import Forecast, ahead_of
from viewer.session import Session

VIEWS = 24


class Governor:
    """Watches frames and sets thresholds. Thread: render.

    Parameters
    ----------
    limits : the finest thresholds, those that the user has asked for
    """

    def __init__(self, session: Session, limits: Thresholds, fps: float) -> None:
        self._limits = limits
        self.budget = FrameBudget(fps)
        self._pager = session.pager
        self._forecast = Forecast(session.pager, session.renderer)
        self._own_ms = 0.0
        self._resting = False
        self._views: deque[ViewState] = deque(maxlen=VIEWS)
        self._warm_up()

    def _warm_up(self) -> None:
        """Compile what counts, or load it from the cache, so that no frame has to."""
        eye = Ecef(np.array((1e7, 0.0, 0.0)))
        self._forecast.load(ViewState(0.0, eye, np.eye(3), 500.0, 640, 480), self._limits)

    @property
    def limits(self) -> Thresholds:
        """The finest thresholds; set others and they count from now on."""
        return self._limits

    @limits.setter
    def limits(self, limits: Thresholds) -> None:
        self._limits = limits
        self._set()

    def rest(self, *, on: bool) -> None:
        """While the eye rests, draw as fine as the limits are, however long it takes."""
        if on != self._resting:
            self._resting = on
            self._set()

    def frame(self, view: ViewState, stats: FrameStats, frame_ms: float) -> float:
        """Take in a frame that was drawn; returns how long it was expected to take, ms.

        Parameters
        ----------
        view : its time counts as the time of the frame
        frame_ms : without what this takes itself
        """
        start_ns = time.perf_counter_ns()
        load = Load(stats.triangles, stats.draw_calls)
        expected_ms = self.budget.model.predict(load)
        self.budget.model.learn(load, frame_ms + self._own_ms, view.t_s)
        self._views.append(view)
        if self._resting:
            return expected_ms
        floor_m = ground_under(self._pager.forests[Lane.TERRAIN], view.eye)
        soon = ahead_of(list(self._views), floor_m)
        for _ in range(self.budget.questions):
            wanted = self._limits.times(self.budget.asks())
            if self.budget.tell(self._forecast.load(soon, wanted), view.t_s):
                self._set()
        self._own_ms = (time.perf_counter_ns() - start_ns) / 1e6
        return expected_ms

    def figures(self, frames: NDArray[np.void]) -> dict[str, Any]:
        """Return what became of the budget over a flight's frames, for its report.

        Parameters
        ----------
        frames : (n,) FRAME
        """
        took_ms, limit_ms = frames["frame_ms"], self.budget.budget_ms
        apart_ms = np.abs(took_ms - frames["expected_ms"])[1:]
        slopes = self.budget.model.slopes_ms()
        return {
            "budget_ms": limit_ms,
            "share_within": float((took_ms <= limit_ms).mean()),
            "share_within_10_percent_more": float((took_ms <= 1.1 * limit_ms).mean()),
            "changes": self.budget.changes,
            "threshold_px": spread_of(frames["threshold_px"]),
            "expected_apart_ms": spread_of(apart_ms),
            "ms_per_million_triangles": float(slopes[0]) * 1e3,
            "ms_per_thousand_draws": float(slopes[1]),
        }

    def _set(self) -> None:
        limits = self._limits.times(1.0 if self._resting else self.budget.factor)
        self._pager.set_limits(limits.terrain_px, limits.objects_px)


def spread_of(values: NDArray[np.float64]) -> dict[str, float]:
    """Return p50, p95 and max."""
    if not len(values):
        return {}
    p50, p95 = np.percentile(values, (50, 95)).tolist()
    return {"p50": p50, "p95": p95, "max": float(values.max())}
