# SPDX-License-Identifier: Apache-2.0
"""Detail that fits the time of a frame: pure logic, no clock and no renderer of its own.

After Funkhouser and Sequin, "Adaptive display algorithm for interactive frame rates
during visualization of complex virtual environments" (SIGGRAPH 1993). Theirs, and here:
the time of a frame is predicted before it is drawn, from what it would draw, and of the
details that fit the frame those of largest benefit are drawn; so a city that comes into
view makes the detail coarser at once and not only after frames that came late, as
feedback on the frame time would. Theirs, and not here: a level of detail and a way of
shading for each object by itself, chosen greedily by benefit for cost over all objects.
Here one factor on the thresholds of terrain and objects is chosen. Every tile then errs
by at most the same number of pixels, so the finest factor that fits is also the one of
largest benefit, where benefit is the least worst error of the picture, not a sum.
Their coefficients of cost were measured once for each machine; these are fitted to the
flight's own frames.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

STEP = 1.03
"""Ratio of one detail to the next."""
COARSEST = 117
"""Steps to the coarsest: 32 times the threshold."""
OFFSETS = (-48, -12, -2, 0, 2, 12, 30, 60)
"""Steps from the present detail to those whose load is asked for, in turns."""
EASY, TARGET = 0.93, 0.98
"""Finer detail is drawn where a frame fits the first share of the budget; it is then
as fine as fits the second."""
USELESS = 0.05
"""Detail is not made coarser where that saves no more than this share of a frame."""
PATIENCE_S, HURRY_S = 1.0, 0.25
"""Least time between a change and the next, to finer and to coarser detail."""
LEVEL_S, SLOPES_S = 0.5, 20.0
"""Half lives of what is remembered: where frame times are, and what they grow with."""
MOST_MARGIN = 0.15
PRIOR_SHARE = 0.5
"""Before anything is known, half of a frame's time grows with its triangles."""
PRIOR_WEIGHT = 0.2
"""of that, in squared relative changes of a frame's load that count as much"""
OUTLIER, LEAST_SPREAD = 3.0, 0.1
"""A frame counts as at most so many spreads off, the spread being at least this share of
a frame: the system takes the processor away now and then."""


class Load(NamedTuple):
    """What a frame has to draw."""

    triangles: float
    draws: float


class CostModel:
    """Milliseconds of a frame = level + per triangle + per draw, by least squares.

    Exponentially weighted and recursive, with two memories. Means of load and time are
    short-lived, because what a pixel costs changes with the view. What frames cost more
    for more load is learnt from deviations from these means and lives long; so a steady
    view, whose noise says nothing about it, does not wash it away.
    """

    def __init__(self) -> None:
        self.level_ms = 0.0
        self.spread_ms = 0.0
        self._load = np.ones(2)
        self._moments = np.zeros((2, 2))
        self._products = np.zeros(2)
        self._last_s = -np.inf

    def learn(self, load: Load, ms: float, now_s: float) -> None:
        """Take in one frame."""
        x = _thousands(load)
        passed_s = max(now_s - self._last_s, 0.0)
        self._last_s = now_s
        if np.isinf(passed_s):
            self._load, self.level_ms = x, ms
            return
        most_ms = OUTLIER * max(self.spread_ms, LEAST_SPREAD * self.level_ms)
        missed_ms = min(max(ms - self.predict(load), -most_ms), most_ms)
        ms = self.predict(load) + missed_ms
        keep, keep_long = (0.5 ** (passed_s / s) for s in (LEVEL_S, SLOPES_S))
        apart = x - self._load
        self._moments = keep_long * self._moments + np.outer(apart, apart)
        self._products = keep_long * self._products + apart * (ms - self.level_ms)
        self._load = keep * self._load + (1 - keep) * x
        self.level_ms = keep * self.level_ms + (1 - keep) * ms
        variance = keep * self.spread_ms**2 + (1 - keep) * missed_ms**2
        self.spread_ms = float(np.sqrt(variance))

    def predict(self, load: Load) -> float:
        """Return the expected time of a frame, ms."""
        apart = _thousands(load) - self._load
        return max(float(self.level_ms + self.slopes_ms() @ apart), 0.0)

    def slopes_ms(self) -> NDArray[np.float64]:
        """Return what a thousand triangles more, and a thousand draws, take, (2,) ms.

        Neither is negative: what would be is taken as zero, and the other fitted alone.
        """
        weight = PRIOR_WEIGHT * self._load**2
        prior = np.array((PRIOR_SHARE * self.level_ms / self._load[0], 0.0))
        matrix = self._moments + np.diag(weight)
        right = self._products + weight * prior
        both = np.linalg.solve(matrix, right)
        if both.min() >= 0.0:
            return np.asarray(both, np.float64)
        alone = np.asarray(np.maximum(right / np.diag(matrix), 0.0), np.float64)
        alone[int(both.argmin())] = 0.0
        return alone


def _thousands(load: Load) -> NDArray[np.float64]:
    return np.maximum(np.asarray(load, np.float64), 1.0) / 1000.0


class FrameBudget:
    """Chooses the factor on the thresholds. Thread: render.

    Parameters
    ----------
    fps : frames per second to be held; the user's own threshold is the finest detail
    """

    def __init__(self, fps: float) -> None:
        self.budget_ms = 1000.0 / fps
        self.model = CostModel()
        self.changes = 0
        self._step = 0
        self._changed_s = -np.inf
        self._loads: dict[int, Load] = {}
        self._turn = 0

    @property
    def factor(self) -> float:
        """What the user's thresholds are multiplied by; 1 or more."""
        return STEP**self._step

    @property
    def questions(self) -> int:
        """How many loads to tell in a frame: more where frames are late."""
        late = round(self.model.level_ms / self.budget_ms)
        return min(max(late, 1), len(OFFSETS))

    def asks(self) -> float:
        """Return the factor whose load is to be told next."""
        return STEP ** self._asked()

    def _asked(self) -> int:
        return min(max(self._step + OFFSETS[self._turn], 0), COARSEST)

    def tell(self, load: Load, now_s: float) -> bool:
        """Say what a frame would draw at the factor that was asked for.

        Returns
        -------
        Whether the factor has changed.
        """
        self._loads[self._asked()] = load
        self._turn = (self._turn + 1) % len(OFFSETS)
        if self._turn:
            return False
        step = choose(self._costs_ms(), self._step, self.budget_ms)
        self._loads.clear()
        wait_s = HURRY_S if step > self._step else PATIENCE_S
        if step == self._step or now_s - self._changed_s < wait_s:
            return False
        self._step, self._changed_s = step, now_s
        self.changes += 1
        return True

    def _costs_ms(self) -> dict[int, float]:
        margin_ms = min(self.model.spread_ms, MOST_MARGIN * self.budget_ms)
        return {
            step: self.model.predict(load) + margin_ms for step, load in self._loads.items()
        }


def choose(costs_ms: Mapping[int, float], step: int, budget_ms: float) -> int:
    """Return the step to draw next: the finest that fits, between those that are known.

    Where none fits it is the finest that takes hardly longer than the shortest.

    Parameters
    ----------
    costs_ms : predicted time of a frame at some steps, ascending, `step` among them
    step : the present one
    """
    known = np.array(list(costs_ms))
    steps = np.arange(known[0], known[-1] + 1)
    ms = np.interp(steps, known, list(costs_ms.values()))
    if ms.min() > budget_ms:
        return int(steps[ms <= ms.min() * (1 + USELESS)][0])
    if EASY * budget_ms < costs_ms[step] <= budget_ms:
        return step
    fits = ms <= max(TARGET * budget_ms, ms.min())
    return int(steps[fits][0])
