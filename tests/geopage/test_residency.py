# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from geopage.priority_queue import PriorityQueue
from geopage.residency import Residency
from geopage.selection import trees_of
from geopage.tile_state import State
from tests.geopage.worlds import deep_globe, object_records
from tiles.forest import build_forest
from tiles.lanes import Lane

TREES = trees_of(
    {
        Lane.TERRAIN: build_forest(deep_globe()),
        Lane.OBJECTS: build_forest(object_records()),
    }
)
FIRST_FREE = int(np.argmax(TREES[Lane.TERRAIN].level > 2))
MEMORY = 4000
LOADING = 5000


def residency(tiles: int) -> Residency:
    """A residency with room for some terrain tiles, no index charged."""
    queue = PriorityQueue({lane: len(tree.parent) for lane, tree in TREES.items()})
    return Residency(TREES, queue, tiles * MEMORY + LOADING - MEMORY)


def upload(room: Residency, row: int) -> None:
    assert room.reserve(Lane.TERRAIN, row)
    room.deliver(Lane.TERRAIN, row, object())
    del room.ready[Lane.TERRAIN, row]
    room.told.append((State.UPLOADED, Lane.TERRAIN, row))


def rows(*numbers: int) -> np.ndarray[tuple[int], np.dtype[np.int32]]:
    return np.array(numbers, np.int32) + FIRST_FREE


def test_a_tile_is_paid_for_from_before_its_read_until_its_slot_is_free() -> None:
    room, row = residency(10), int(rows(0)[0])
    assert room.reserve(Lane.TERRAIN, row)
    assert room.memory()["in_flight_bytes"] == LOADING
    room.deliver(Lane.TERRAIN, row, object())
    assert room.memory()["resident_bytes"] == MEMORY
    room.told.append((State.UPLOADED, Lane.TERRAIN, row))
    number, uploaded = room.snapshot()
    assert uploaded[Lane.TERRAIN][row] == 1
    assert room.make_room(10 * LOADING, number + 1)
    assert room.memory()["uploaded_bytes"] == MEMORY
    assert room.snapshot()[1][Lane.TERRAIN][row] == 0
    room.told.append((State.ABSENT, Lane.TERRAIN, row))
    room.snapshot()
    assert room.used_bytes == 0
    assert room.memory()["peak_bytes"] == LOADING


def test_nothing_is_reserved_beyond_the_budget() -> None:
    room = residency(2)
    kept = [room.reserve(Lane.TERRAIN, int(row)) for row in rows(0, 1, 2)]
    assert kept == [True, False, False]
    room.deliver(Lane.TERRAIN, int(rows(0)[0]), object())
    assert room.reserve(Lane.TERRAIN, int(rows(1)[0]))


def test_the_least_recently_needed_tile_goes_first() -> None:
    room = residency(3)
    for row in rows(0, 1, 2):
        upload(room, int(row))
    for number, row in ((1, 1), (2, 0), (3, 2)):
        assert room.snapshot()[0] == number
        room.used(Lane.TERRAIN, rows(row), number)
    assert room.make_room(2 * MEMORY, 3)
    assert {entry[2] for entry in room.released} == set(rows(1, 0).tolist())


def test_what_the_newest_list_needs_and_what_is_pinned_never_goes() -> None:
    room = residency(40)
    for row in (0, 5, 31, *rows(0, 1)):
        upload(room, int(row))
    number, _ = room.snapshot()
    room.used(Lane.TERRAIN, rows(0, 1), number)
    assert not room.make_room(10**9, number)
    assert not room.released


def test_a_release_waits_for_a_list_without_the_tile() -> None:
    room = residency(3)
    upload(room, int(rows(0)[0]))
    number, uploaded = room.snapshot()
    assert uploaded[Lane.TERRAIN][rows(0)].all()
    room.make_room(10**9, number + 1)
    assert [entry[0] for entry in room.released] == [number + 1]


def test_an_eviction_is_taken_back_when_the_renderer_was_not_told() -> None:
    room = residency(3)
    for row in rows(0, 1):
        upload(room, int(row))
    number, _ = room.snapshot()
    room.make_room(10**9, number + 1)
    room.released.popleft()
    assert room.keep_again(Lane.TERRAIN, rows(0, 1))
    assert room.snapshot()[1][Lane.TERRAIN][rows(0, 1)].tolist() == [0, 1]
    assert not room.released


def test_coarse_levels_are_pinned_only_where_they_are_small_change() -> None:
    level = TREES[Lane.TERRAIN].level
    assert residency(20).pinned_bytes == 32 * MEMORY
    assert residency(10_000).pinned_bytes == int((level <= 2).sum()) * MEMORY


def test_a_budget_below_the_index_is_refused_with_the_number_that_is_enough() -> None:
    with pytest.raises(ValueError, match="expected at least") as caught:
        residency(40).charge_index(10**6)
    assert str(40 * MEMORY + LOADING - MEMORY) in str(caught.value)


class RoomMachine(RuleBasedStateMachine):
    """Random sessions of eight tiles in a room for three."""

    def __init__(self) -> None:
        super().__init__()
        self.room = residency(3)
        self.states = dict.fromkeys(rows(*range(8)).tolist(), State.ABSENT)

    def those(self, state: State) -> list[int]:
        return [row for row, found in self.states.items() if found is state]

    @rule(pick=st.integers(0, 7))
    def read(self, pick: int) -> None:
        row = list(self.states)[pick]
        if self.states[row] is State.ABSENT and self.room.reserve(Lane.TERRAIN, row):
            self.states[row] = State.LOADING

    @rule(how=st.sampled_from(["deliver", "drop", "fail"]))
    def finish(self, how: str) -> None:
        for row in self.those(State.LOADING)[:1]:
            if how == "deliver":
                self.room.deliver(Lane.TERRAIN, row, object())
                self.states[row] = State.RESIDENT
            elif how == "drop":
                self.room.drop(Lane.TERRAIN, row)
                self.states[row] = State.ABSENT
            elif row != next(iter(self.states)):
                self.room.fail(Lane.TERRAIN, row)
                self.states[row] = State.FAILED

    @rule()
    def upload(self) -> None:
        for row in self.those(State.RESIDENT)[:1]:
            self.room.told.append((State.UPLOADED, Lane.TERRAIN, row))
            self.states[row] = State.UPLOADED
            self.room.snapshot()

    @rule(size=st.integers(0, 4 * MEMORY))
    def evict(self, size: int) -> None:
        self.room.make_room(size, self.room.number + 1)
        for _, _, row in self.room.released:
            self.states[row] = State.RELEASING

    @rule()
    def release(self) -> None:
        for _, lane, row in list(self.room.released)[:1]:
            self.room.released.popleft()
            self.room.told.append((State.ABSENT, lane, row))
            self.room.snapshot()
            self.states[row] = State.ABSENT

    @invariant()
    def within_budget(self) -> None:
        held = {state: len(self.those(state)) for state in State}
        uploaded = held[State.UPLOADED] + held[State.RELEASING]
        expected = LOADING * held[State.LOADING] + MEMORY * (
            held[State.RESIDENT] + uploaded
        )
        assert self.room.used_bytes == expected <= self.room.budget_bytes
        assert self.room.memory()["peak_bytes"] <= self.room.budget_bytes
        assert all(
            self.room.state(Lane.TERRAIN, row) is s for row, s in self.states.items()
        )


TestRoom = RoomMachine.TestCase
TestRoom.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
