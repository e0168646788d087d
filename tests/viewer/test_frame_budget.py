# SPDX-License-Identifier: Apache-2.0
"""A frame budget on made-up machines, by a virtual clock."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from viewer.frame_budget import STEP, CostModel, FrameBudget, Load, choose

FPS = 60.0
BUDGET_MS = 1000 / FPS
LATENCY_S = 0.2
"""From other thresholds to other pictures."""


def steady(_: float) -> float:
    return 1.0


@dataclass(frozen=True)
class Machine:
    """Frames that take level + triangles + draws, and a little noise."""

    level_ms: float = 4.0
    million_triangles_ms: float = 30.0
    thousand_draws_ms: float = 2.5
    noise: float = 0.03

    def frame_ms(self, load: Load) -> float:
        return (
            self.level_ms
            + self.million_triangles_ms * load.triangles / 1e6
            + self.thousand_draws_ms * load.draws / 1e3
        )


def scene(factor: float, busy: float) -> Load:
    """What there is to draw at a factor on the thresholds."""
    return Load(1e6 * busy * factor**-1.2, 800 * busy * factor**-0.6)


def fly(
    machine: Machine, seconds: float = 16.0, busy: Callable[[float], float] = steady
) -> tuple[NDArray[np.float64], FrameBudget]:
    """Frames as rows: time, ms, factor drawn, ms expected."""
    rng, budget = np.random.default_rng(7), FrameBudget(FPS)
    t_s, changes, frames = 0.0, [(0.0, 1.0)], []
    while t_s < seconds:
        factor = [f for since_s, f in changes if since_s <= t_s][-1]
        load = scene(factor, busy(t_s))
        ms = machine.frame_ms(load) * (1 + machine.noise * rng.standard_normal())
        frames.append((t_s, ms, factor, budget.model.predict(load)))
        budget.model.learn(load, ms, t_s)
        for _ in range(budget.questions):
            ahead = scene(budget.asks(), busy(t_s + LATENCY_S))
            if budget.tell(ahead, t_s):
                changes.append((t_s + LATENCY_S, budget.factor))
        t_s += max(ms, BUDGET_MS) / 1e3
    return np.array(frames), budget


MACHINES = {
    "plain": Machine(),
    "slow": Machine(million_triangles_ms=120.0),
    "slow at draws": Machine(million_triangles_ms=1.0, thousand_draws_ms=35.0),
    "slow at pixels": Machine(level_ms=10.0),
}


@pytest.mark.parametrize("machine", MACHINES.values(), ids=MACHINES)
def test_it_holds_the_budget_within_a_tenth_and_does_not_flicker(machine: Machine) -> None:
    frames, _ = fly(machine)
    late = frames[frames[:, 0] > 6.0]
    assert 0.9 * BUDGET_MS <= late[:, 1].mean() <= BUDGET_MS
    assert np.percentile(late[:, 1], 95) <= 1.1 * BUDGET_MS
    assert np.count_nonzero(np.diff(late[:, 2])) <= 2  # in ten seconds


def test_a_slower_machine_draws_coarser_detail() -> None:
    ends = [fly(Machine(million_triangles_ms=ms))[1].factor for ms in (20, 40, 80, 160)]
    assert ends == sorted(ends)
    assert len(set(ends)) == 4


def test_a_fast_machine_draws_what_was_asked_for() -> None:
    frames, budget = fly(Machine(million_triangles_ms=5.0))
    assert budget.factor == 1.0
    assert budget.changes == 0
    assert frames[:, 1].max() < BUDGET_MS


def fly_by_feedback(
    machine: Machine, seconds: float, busy: Callable[[float], float]
) -> NDArray[np.float64]:
    """The same, with thresholds that follow how late frames are, four times a second."""
    rng, t_s, asked_s = np.random.default_rng(7), 0.0, 0.0
    factor, smooth_ms = 1.0, BUDGET_MS
    changes, frames = [(0.0, 1.0)], []
    while t_s < seconds:
        drawn = [f for since_s, f in changes if since_s <= t_s][-1]
        ms = machine.frame_ms(scene(drawn, busy(t_s)))
        ms *= 1 + machine.noise * rng.standard_normal()
        smooth_ms += 0.2 * (ms - smooth_ms)
        frames.append((t_s, ms, drawn))
        if t_s - asked_s > 0.25:
            factor = max(factor * (smooth_ms / (0.93 * BUDGET_MS)) ** 0.5, 1.0)
            changes.append((t_s + LATENCY_S, factor))
            asked_s = t_s
        t_s += max(ms, BUDGET_MS) / 1e3
    return np.array(frames)


def test_a_city_that_comes_into_view_makes_few_late_frames_and_feedback_many() -> None:
    def city(t_s: float) -> float:
        return 1 + 4 * min(max(t_s - 8, 0) / 2, 1)

    shares = []
    for frames in (fly(Machine(), 16.0, city)[0], fly_by_feedback(Machine(), 16.0, city)):
        on_the_way = frames[(frames[:, 0] > 8) & (frames[:, 0] < 11)]
        shares.append(float((on_the_way[:, 1] > 1.1 * BUDGET_MS).mean()))
        assert frames[-1, 2] > 2 * on_the_way[0, 2]
    assert shares[0] < 0.15
    assert shares[1] > 3 * shares[0]


def test_detail_comes_back_when_there_is_time_again() -> None:
    frames, _ = fly(Machine(), 20.0, lambda t_s: 3.0 if t_s < 8 else 1.0)
    before, after = frames[frames[:, 0] < 8][-1, 2], frames[-1, 2]
    assert after < 0.6 * before
    assert frames[-60:, 1].mean() > 0.88 * BUDGET_MS


def test_detail_is_not_thrown_away_where_it_saves_nothing() -> None:
    machine = Machine(level_ms=2 * BUDGET_MS)
    frames, budget = fly(machine)
    assert budget.factor < 16.0
    least_ms = machine.frame_ms(scene(2 * budget.factor, 1.0))
    assert frames[-60:, 1].mean() < 1.08 * least_ms


def test_what_it_expects_is_what_comes() -> None:
    frames, budget = fly(Machine(noise=0.0))
    assert np.abs(frames[120:, 3] - frames[120:, 1]).max() < 0.05 * BUDGET_MS
    coarser = scene(2 * budget.factor, 1.0)
    expected_ms = budget.model.predict(coarser)
    assert expected_ms == pytest.approx(Machine().frame_ms(coarser), rel=0.15)


def test_a_single_frame_of_half_a_second_changes_nothing() -> None:
    machine, budget = Machine(million_triangles_ms=8.0), FrameBudget(FPS)
    for i in range(400):
        load = scene(budget.factor, 1.0)
        ms = 500.0 if i == 200 else machine.frame_ms(load)
        budget.model.learn(load, ms, i / FPS)
        budget.tell(scene(budget.asks(), 1.0), i / FPS)
    assert budget.changes == 0


def test_a_steady_view_forgets_nothing() -> None:
    rng, model = np.random.default_rng(3), CostModel()
    machine = Machine()
    for i in range(60 * 20):
        factor = 2.0 if i % 120 < 60 and i < 600 else 3.0
        load = scene(factor, 1.0 + 1e-3 * rng.standard_normal())
        model.learn(load, machine.frame_ms(load) + rng.standard_normal(), i / FPS)
    finer = scene(2.0, 1.0)
    assert model.predict(finer) == pytest.approx(machine.frame_ms(finer), rel=0.1)


def test_costs_are_never_negative() -> None:
    model = CostModel()
    for i, (triangles, ms) in enumerate([(1e5, 20.0), (2e5, 10.0), (3e5, 5.0)] * 40):
        model.learn(Load(triangles, 100.0), ms, i / FPS)
    assert model.slopes_ms().min() >= 0.0
    assert model.predict(Load(0.0, 0.0)) >= 0.0


def test_the_finest_that_fits_is_chosen_between_what_is_known() -> None:
    costs = {0: 40.0, 10: 20.0, 20: 10.0}
    assert choose(costs, 20, 15.5) == 15
    assert choose(costs, 0, 15.0) == 16
    assert choose({0: 14.9, 10: 9.0}, 0, 15.0) == 0
    assert choose({5: 14.6, 10: 14.3, 20: 9.0}, 10, 15.0) == 10
    assert choose({0: 31.0, 10: 30.5, 20: 30.0}, 10, 15.0) == 0
    assert STEP > 1
