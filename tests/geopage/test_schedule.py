# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from geopage.ground_needs import Needs
from geopage.schedule import NONE, UNMET, Line, Marks, choose, line_of, marks_of, ranked

PICTURES, TILES = 5, 7
GOALS = st.lists(
    st.lists(st.integers(0, TILES - 1), max_size=TILES, unique=True),
    min_size=PICTURES,
    max_size=PICTURES,
)
SIZES = st.lists(st.integers(1, 9), min_size=TILES, max_size=TILES)
AHEAD_S = np.array((0.5, 1.0, 2.0, 3.0, 4.0))


def booked(
    goals: list[list[int]], sizes: list[int], rate: float
) -> tuple[Needs, np.ndarray, Line, Marks, list[int]]:
    start = np.cumsum([0, *map(len, goals)]).astype(np.int32)
    rows = np.array([row for goal in goals for row in goal], np.int32)
    needs = Needs(start, rows, np.full(len(rows), 0.5, np.float32), rows[:0])
    size, line, marks = np.array(sizes), line_of(AHEAD_S, rate, 0.0), marks_of(TILES)
    every = np.arange(PICTURES, dtype=np.int32)
    met = choose(needs, every, 1.0, size, line, marks.due)
    return needs, size, line, marks, np.flatnonzero(met).tolist()


def in_time(
    goals: list[list[int]], sizes: list[int], rate: float, chosen: list[int]
) -> bool:
    """Read the tiles in the order of the pictures that need them."""
    read: set[int] = set()
    for k in chosen:
        read |= set(goals[k])
        if sum(sizes[row] for row in read) > AHEAD_S[k] * rate:
            return False
    return True


@given(GOALS, SIZES, st.floats(0.5, 30))
def test_chosen_goals_can_all_be_met_and_no_other_can_be_added(
    goals: list[list[int]], sizes: list[int], rate: float
) -> None:
    *_, chosen = booked(goals, sizes, rate)
    assert in_time(goals, sizes, rate, chosen)
    for other in set(range(PICTURES)) - set(chosen):
        assert not in_time(goals, sizes, rate, sorted([*chosen, other]))


@given(GOALS, SIZES, st.floats(0.5, 30))
def test_what_is_due_first_is_first_and_what_comes_too_late_is_last(
    goals: list[list[int]], sizes: list[int], rate: float
) -> None:
    needs, size, line, marks, chosen = booked(goals, sizes, rate)
    rows, ranks = ranked(needs, size, line, marks)
    assert sorted(rows.tolist()) == sorted({row for goal in goals for row in goal})
    due = [min([k for k in chosen if row in goals[k]], default=99) for row in rows.tolist()]
    order = np.argsort(ranks)
    assert (np.diff(np.array(due)[order]) >= 0).all()
    assert ((ranks > UNMET / 2) == (np.array(due) == 99)).all()
    assert (marks.due == NONE).all()
    assert not marks.gain.any()
