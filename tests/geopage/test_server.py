# SPDX-License-Identifier: Apache-2.0
from collections.abc import Callable

import numpy as np
import pytest

from geopage.priority_queue import PriorityQueue
from geopage.residency import Residency
from geopage.server import PAUSES_S, TileServer
from geopage.tile_state import State
from geopage.tree import Tree
from tiles.errors import ReadFault, TileFault
from tiles.forest import Forest
from tiles.lanes import Lane

LANE = Lane.OBJECTS


class StubSource:
    """Bodies that are made up, after a stated time, with something to do while reading."""

    meanwhile: Callable[[], object]

    def __init__(self, delay_s: float = 0.0) -> None:
        self.delay_s = delay_s
        self.read_rows: list[int] = []
        self.meanwhile = lambda: None

    def free_s(self, now_s: float) -> float:
        return now_s

    def ready_s(self, record: np.void, now_s: float) -> float:
        assert record["row"] > 0
        return now_s + self.delay_s

    def read(self, record: np.void) -> bytes:
        self.read_rows.append(int(record["row"]))
        self.meanwhile()
        return b"body"

    def close(self) -> None:
        self.read_rows.clear()


class Bench:
    """One server with everything around it."""

    def __init__(self, forests: dict[Lane, Forest], trees: dict[Lane, Tree]) -> None:
        self.queue = PriorityQueue({lane: len(tree.parent) for lane, tree in trees.items()})
        self.residency = Residency(trees, self.queue, 2**22)
        self.source = StubSource()
        self.faults: list[str] = []
        self.decode: Callable[[bytes], object] = bytes.upper
        self.records = forests[LANE].records
        self.rows = np.flatnonzero(trees[LANE].has_tile).astype(np.int32)
        self.server = TileServer(
            LANE,
            self.records,
            self.source,
            self._decode,
            self.queue,
            self.residency,
            self.faults,
        )

    def _decode(self, body: bytes) -> object:
        return self.decode(body)

    def want(self, *rows: int) -> None:
        asked = np.array(rows, np.int32)
        ranks = np.arange(float(len(rows)))
        cancelled = self.queue.replace_lane(LANE, asked, ranks)
        self.residency.queued(LANE, asked, ranks, cancelled)

    def state(self, row: int) -> State:
        return self.residency.state(LANE, row)


@pytest.fixture
def bench(forests: dict[Lane, Forest], trees: dict[Lane, Tree]) -> Bench:
    return Bench(forests, trees)


def test_requests_are_read_best_first_and_delivered_decoded(bench: Bench) -> None:
    a, b = (int(row) for row in bench.rows[:2])
    bench.want(b, a)
    assert bench.server.step(0.0) == bench.server.step(0.0) == 0.0
    assert bench.server.step(0.0) is None
    assert bench.source.read_rows == [bench.records["row"][b], bench.records["row"][a]]
    assert bench.residency.ready == {(LANE, b): b"BODY", (LANE, a): b"BODY"}
    assert bench.residency.counters.tiles_loaded == 2
    assert bench.residency.counters.bytes_read == 8


def test_a_slow_source_is_waited_for_by_the_clock(bench: Bench) -> None:
    row = int(bench.rows[0])
    bench.source.delay_s = 0.5
    bench.want(row)
    assert bench.server.step(10.0) == 0.0
    assert bench.server.step(10.0) == 0.5
    assert bench.server.step(10.4) == pytest.approx(0.1)
    assert bench.state(row) is State.LOADING
    assert bench.server.step(10.5) == 0.0
    assert bench.state(row) is State.RESIDENT


def test_work_that_goes_stale_before_the_read_is_dropped(bench: Bench) -> None:
    row = int(bench.rows[0])
    bench.source.delay_s = 0.5
    bench.want(row)
    bench.server.step(0.0)
    bench.want()
    assert bench.server.step(0.1) == 0.0
    assert bench.source.read_rows == []
    assert bench.state(row) is State.ABSENT
    assert bench.residency.counters.tiles_cancelled == 1


def test_work_that_goes_stale_during_the_read_is_not_decoded(bench: Bench) -> None:
    row = int(bench.rows[0])
    bench.source.meanwhile = bench.want
    bench.decode = lambda _: pytest.fail("decoded")
    bench.want(row)
    bench.server.step(0.0)
    assert bench.state(row) is State.ABSENT
    assert not bench.residency.ready
    bench.want(row)
    assert bench.queue.pop(LANE) == row


def test_a_fault_is_reported_once_and_the_tile_never_asked_for_again(bench: Bench) -> None:
    row = int(bench.rows[0])

    def spoil(_: bytes) -> object:
        raise TileFault("OBJECTS", "0/8/1/1", "checksum differs")

    bench.decode = spoil
    bench.want(row)
    bench.server.step(0.0)
    bench.want(row)
    assert bench.server.step(0.0) is None
    assert bench.state(row) is State.FAILED
    assert bench.faults == ["OBJECTS tile 0/8/1/1: checksum differs"]


def test_other_errors_are_not_swallowed(bench: Bench) -> None:
    bench.decode = lambda _: {}["missing"]
    bench.want(int(bench.rows[0]))
    with pytest.raises(KeyError, match="missing"):
        bench.server.step(0.0)


def test_a_tile_without_room_is_not_read_and_can_be_asked_for_again(bench: Bench) -> None:
    row = int(bench.rows[0])
    bench.residency.budget_bytes = bench.residency.used_bytes + 100
    bench.want(row)
    assert bench.server.step(0.0) == 0.0
    assert bench.source.read_rows == []
    assert bench.state(row) is State.ABSENT
    bench.want(row)
    assert bench.queue.pop(LANE) == row


def failing(times: int, fault: type[TileFault]) -> Callable[[], object]:
    """What a source does meanwhile whose first reads fail."""
    left = iter(range(times))

    def fail() -> None:
        if next(left, None) is not None:
            raise fault("OBJECTS", "cell", "disk I/O error")

    return fail


def run_until_idle(bench: Bench) -> float:
    """Step by the clock until nothing is on its way; return what it shows then."""
    now_s = 0.0
    while (wait_s := bench.server.step(now_s)) is not None:
        now_s += wait_s
    return now_s


def test_a_read_that_fails_for_a_passing_reason_is_tried_again(bench: Bench) -> None:
    row, other = (int(row) for row in bench.rows[:2])
    bench.source.meanwhile = failing(len(PAUSES_S), ReadFault)
    bench.want(row)
    assert run_until_idle(bench) == pytest.approx(sum(PAUSES_S))
    assert bench.residency.ready == {(LANE, row): b"BODY"}
    assert len(bench.source.read_rows) == len(PAUSES_S) + 1
    assert bench.faults == []
    bench.source.meanwhile = failing(1, ReadFault)
    bench.want(row, other)
    assert run_until_idle(bench) == PAUSES_S[0]


def test_a_tile_that_waits_for_its_next_read_stops_no_other(bench: Bench) -> None:
    row, other = (int(row) for row in bench.rows[:2])
    bench.source.meanwhile = failing(1, ReadFault)
    bench.want(row, other)
    while bench.server.step(0.0) == 0.0:
        pass
    assert list(bench.residency.ready) == [(LANE, other)]
    assert bench.state(row) is State.LOADING


@pytest.mark.parametrize(
    ("fault", "reads"), [(ReadFault, len(PAUSES_S) + 1), (TileFault, 1)]
)
def test_a_read_that_always_fails_becomes_one_fault(
    bench: Bench, fault: type[TileFault], reads: int
) -> None:
    row = int(bench.rows[0])
    bench.source.meanwhile = failing(1000, fault)
    bench.want(row)
    run_until_idle(bench)
    assert len(bench.source.read_rows) == reads
    assert bench.state(row) is State.FAILED
    assert bench.faults == ["OBJECTS tile cell: disk I/O error"]


def test_a_tile_that_waits_for_its_next_read_is_given_up_when_stale(bench: Bench) -> None:
    row = int(bench.rows[0])
    bench.source.meanwhile = failing(1000, ReadFault)
    bench.want(row)
    while bench.server.step(0.0) == 0.0:
        pass
    bench.want()
    run_until_idle(bench)
    assert bench.state(row) is State.ABSENT
    assert bench.faults == []
