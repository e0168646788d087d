# SPDX-License-Identifier: Apache-2.0
from itertools import combinations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from geopage.policies.oracle import Oracle, deadlines, frames_to_fill, in_time
from geopage.selection import Thresholds
from geopage.tree import Tree
from tests.geopage.worlds import view_at
from tiles.lanes import Lane

SLOTS, TILES = 6, 7
NEEDS = st.lists(
    st.lists(st.booleans(), min_size=TILES, max_size=TILES), min_size=SLOTS, max_size=SLOTS
).map(np.array)
SIZES = st.lists(st.integers(1, 9), min_size=TILES, max_size=TILES).map(
    lambda sizes: np.array(sizes, float)
)


def brought_in_time(
    needs: np.ndarray, size: np.ndarray, rate: float, chosen: list[int]
) -> bool:
    """Read the tiles byte for byte in the order of the frames that need them."""
    there, read = set(), 0.0
    for slot in chosen:
        new = set(np.flatnonzero(needs[slot]).tolist()) - there
        there |= new
        read += sum(size[i] for i in new)
        if read > slot * rate:
            return False
    return True


@given(NEEDS, SIZES, st.floats(0.5, 30))
def test_chosen_frames_can_all_be_had_in_time_and_no_other_can_be_added(
    needs: np.ndarray, size: np.ndarray, rate: float
) -> None:
    found = frames_to_fill(needs, size, rate, np.zeros(SLOTS, np.bool_))
    chosen = np.flatnonzero(found).tolist()
    assert brought_in_time(needs, size, rate, chosen)
    for other in set(range(SLOTS)) - set(chosen):
        assert not brought_in_time(needs, size, rate, sorted([*chosen, other]))


@given(NEEDS, SIZES, st.floats(0.5, 30))
def test_the_line_is_fast_enough_when_reading_in_order_is(
    needs: np.ndarray, size: np.ndarray, rate: float
) -> None:
    for count in (1, 3):
        for chosen in combinations(range(SLOTS), count):
            flags = np.isin(np.arange(SLOTS), chosen)
            assert in_time(needs, size, rate, flags) == brought_in_time(
                needs, size, rate, list(chosen)
            )


@given(NEEDS, st.sets(st.integers(0, SLOTS - 1)))
def test_a_tile_is_due_when_the_first_chosen_frame_needs_it(
    needs: np.ndarray, chosen: set[int]
) -> None:
    due = deadlines(needs, np.isin(np.arange(SLOTS), sorted(chosen)))
    for i in range(TILES):
        users = [slot for slot in sorted(chosen) if needs[slot, i]]
        assert due[i] == (users[0] if users else np.inf)


def test_what_is_used_last_goes_first(trees: dict[Lane, Tree]) -> None:
    oracle, limit = Oracle(), Thresholds(2.0, 2.0)
    views = [view_at(h) for h in (1e7, 1e6, 1e5, 1e4, 1e3)]
    oracle.foresee(trees, views, [0.0] * len(views), limit, np.inf)
    needs = oracle._needs[Lane.TERRAIN]
    first = needs.argmax(axis=0)
    rows = np.array([np.flatnonzero(needs.any(axis=0) & (first == k))[0] for k in (1, 3)])
    never = np.flatnonzero(~needs.any(axis=0))[:1]
    rows = np.concatenate((rows, never)).astype(np.int32)
    order = oracle.leaving(Lane.TERRAIN, rows, np.array([5, 5, 5]))
    assert np.argsort(order).tolist() == [2, 1, 0]
