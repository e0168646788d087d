# SPDX-License-Identifier: Apache-2.0
import threading

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from geopage.priority_queue import MOST_PASSED, PriorityQueue
from tiles.lanes import Lane

COUNT = 12
LANES = st.sampled_from(list(Lane))
REQUESTS = st.dictionaries(st.integers(0, COUNT - 1), st.floats(-50, 1050), max_size=COUNT)


def queue_of(lane: Lane, requests: dict[int, float]) -> PriorityQueue:
    queue = PriorityQueue(dict.fromkeys(Lane, COUNT))
    put(queue, lane, requests)
    return queue


def put(queue: PriorityQueue, lane: Lane, requests: dict[int, float]) -> set[int]:
    rows = np.array(list(requests), np.int32)
    cancelled = queue.replace_lane(lane, rows, np.array(list(requests.values()), float))
    return set(cancelled.tolist())


class QueueMachine(RuleBasedStateMachine):
    """The queue against plain dictionaries and sets."""

    def __init__(self) -> None:
        super().__init__()
        self.queue = PriorityQueue(dict.fromkeys(Lane, COUNT))
        self.pending: dict[Lane, dict[int, float]] = {lane: {} for lane in Lane}
        self.wanted: dict[Lane, dict[int, float]] = {lane: {} for lane in Lane}
        self.taken: dict[Lane, set[int]] = {lane: set() for lane in Lane}

    @rule(lane=LANES, requests=REQUESTS)
    def replace(self, lane: Lane, requests: dict[int, float]) -> None:
        cancelled = put(self.queue, lane, requests)
        assert cancelled == set(self.pending[lane]) - set(requests)
        self.wanted[lane] = requests
        taken = self.taken[lane]
        self.pending[lane] = {row: key for row, key in requests.items() if row not in taken}

    @rule(lane=LANES)
    def pop(self, lane: Lane) -> None:
        row = self.queue.pop(lane)
        pending = self.pending[lane]
        assert (row is None) == (not pending)
        if row is not None:
            assert row not in self.taken[lane]
            assert pending.pop(row) == min([self.wanted[lane][row], *pending.values()])
            self.taken[lane].add(row)

    @rule(lane=LANES, row=st.integers(0, COUNT - 1))
    def done(self, lane: Lane, row: int) -> None:
        self.queue.done(lane, row)
        self.taken[lane].discard(row)

    @invariant()
    def agrees(self) -> None:
        for lane in Lane:
            assert self.queue.pending(lane) == len(self.pending[lane])
            for row in range(COUNT):
                assert self.queue.is_wanted(lane, row) == (row in self.wanted[lane])
                found = self.queue.ranks(lane, np.array([row], np.int32))
                assert found == [self.wanted[lane].get(row, np.inf)]
            flags = self.queue.taken(lane, np.arange(COUNT, dtype=np.int32))
            assert set(np.flatnonzero(flags).tolist()) == self.taken[lane]


TestQueue = pytest.mark.filterwarnings("error")(QueueMachine.TestCase)
TestQueue.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)


def test_the_smallest_rank_comes_first_and_equal_ranks_in_the_order_given() -> None:
    queue = queue_of(Lane.TERRAIN, {3: 2.0, 7: -1.0, 5: 2.0})
    assert [queue.pop(Lane.TERRAIN) for _ in range(4)] == [7, 3, 5, None]


def test_a_cancelled_request_is_never_served() -> None:
    queue = queue_of(Lane.OBJECTS, {1: 1.0, 2: 2.0})
    assert put(queue, Lane.OBJECTS, {2: 5.0}) == {1}
    assert [queue.pop(Lane.OBJECTS) for _ in range(2)] == [2, None]


def test_one_lane_does_not_hold_up_the_other() -> None:
    queue = queue_of(Lane.TERRAIN, dict.fromkeys(range(COUNT), -100.0))
    put(queue, Lane.OBJECTS, {0: 1e3})
    assert queue.pop(Lane.OBJECTS) == 0


def test_waiting_ends_when_the_lane_gets_a_request_and_when_the_queue_closes() -> None:
    queue = queue_of(Lane.TERRAIN, {})
    woken: list[bool] = []

    def wait_twice() -> None:
        woken.append(queue.wait(Lane.TERRAIN, 10))
        queue.pop(Lane.TERRAIN)
        woken.append(queue.wait(Lane.TERRAIN, 10))

    thread = threading.Thread(target=wait_twice)
    thread.start()
    put(queue, Lane.OBJECTS, {1: 1.0})
    put(queue, Lane.TERRAIN, {1: 1.0})
    while queue.pending(Lane.TERRAIN):
        assert thread.is_alive()
    queue.close()
    thread.join(10)
    assert woken == [True, False]


def test_a_closed_queue_hands_nothing_out() -> None:
    queue = queue_of(Lane.TERRAIN, {1: 1.0})
    queue.close()
    assert queue.pop(Lane.TERRAIN) is None
    assert not queue.wait(Lane.TERRAIN)


def test_on_one_line_the_lane_with_the_best_request_has_its_turn() -> None:
    queue = PriorityQueue(dict.fromkeys(Lane, COUNT), one_line=True)
    put(queue, Lane.TERRAIN, {1: 5.0, 2: 7.0})
    put(queue, Lane.OBJECTS, {3: 6.0, 4: 8.0})
    order = []
    for _ in range(4):
        found = {lane: queue.pop(lane) for lane in reversed(Lane)}
        order += [row for row in found.values() if row is not None]
    assert order == [1, 3, 2, 4]


def test_on_one_line_a_lane_waits_until_it_has_its_turn() -> None:
    queue = PriorityQueue(dict.fromkeys(Lane, COUNT), one_line=True)
    put(queue, Lane.TERRAIN, {1: 5.0})
    put(queue, Lane.OBJECTS, {3: 6.0})
    assert not queue.wait(Lane.OBJECTS, 0.0)
    assert queue.wait(Lane.TERRAIN, 0.0)
    queue.pop(Lane.TERRAIN)
    assert queue.wait(Lane.OBJECTS, 0.0)


def test_on_one_line_a_lane_is_overtaken_only_so_often() -> None:
    queue = PriorityQueue(dict.fromkeys(Lane, COUNT * 3), one_line=True)
    put(queue, Lane.TERRAIN, {row: float(row) for row in range(2 * MOST_PASSED)})
    put(queue, Lane.OBJECTS, {5: 1000.0})
    for _ in range(MOST_PASSED):
        assert queue.pop(Lane.OBJECTS) is None
        assert queue.pop(Lane.TERRAIN) is not None
    assert queue.pop(Lane.TERRAIN) is None
    assert queue.pop(Lane.OBJECTS) == 5
    assert queue.pop(Lane.TERRAIN) is not None
