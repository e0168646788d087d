# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from geopage.trace import TileTrace, late_ms, summary
from tiles.lanes import Lane

LAND = Lane.TERRAIN


def rows(*which: int) -> np.ndarray:
    return np.array(which, np.int32)


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        self.now_s += 1.0
        return self.now_s


def test_a_tile_s_way_is_written_down_once_each() -> None:
    trace = TileTrace(dict.fromkeys(Lane, 9), Clock())
    trace.asked(LAND, rows(4, 7), np.array((3.0, 1.0)))
    for what in ("taken_s", "read_s", "decoded_s", "uploaded_s"):
        trace.note(what, LAND, 4)
    trace.asked(LAND, rows(4, 7), np.array((2.0, 9.0)))
    trace.drew(LAND, rows(4), rows(7))
    trace.drew(LAND, rows(4), rows(7))
    trace.cancelled(LAND, rows(7))
    table = trace.table()
    assert table["row"].tolist() == [4, 7]
    assert [table[name][0] for name in ("asked_s", "taken_s", "uploaded_s")] == [1, 2, 5]
    assert table["drawn_s"][0] == table["awaited_s"][1] > 5
    assert table["first_rank"].tolist() == [3, 1]
    assert table["best_rank"].tolist() == [2, 1]
    assert table["last_rank"].tolist() == [2, 9]
    assert table["cancelled"].tolist() == [0, 1]
    assert np.isnan(table["taken_s"][1])


def test_a_tile_is_late_from_when_something_coarser_was_drawn_instead() -> None:
    trace = TileTrace(dict.fromkeys(Lane, 9), Clock())
    trace.asked(LAND, rows(1, 2, 3), np.zeros(3))  # 1 s
    trace.note("uploaded_s", LAND, 1)  # 2 s
    trace.drew(LAND, rows(1), rows(2, 3))  # 3 s
    trace.note("uploaded_s", LAND, 2)  # 4 s
    late = late_ms(trace.table())
    assert late[:2].tolist() == [0.0, 1000.0]
    assert np.isnan(late[2])
    found = summary(trace.table())
    assert found["tiles_late"] == 1
    assert found["late_max_ms"] == 1000.0
    assert found["never_drawn_share"] == 0.5
    assert found["prediction_hit_share"] == 0.5


def test_a_tile_that_left_and_is_asked_for_again_is_a_new_line() -> None:
    trace = TileTrace(dict.fromkeys(Lane, 9), Clock())
    for _ in range(2):
        trace.asked(LAND, rows(5), np.zeros(1))
        trace.note("uploaded_s", LAND, 5)
        trace.left(LAND, 5)
    assert trace.table()["row"].tolist() == [5, 5]


@pytest.mark.parametrize("most", [0, 3])
def test_what_has_no_room_is_counted(most: int) -> None:
    trace = TileTrace(dict.fromkeys(Lane, 9), Clock(), most)
    trace.asked(LAND, rows(0, 1, 2, 3, 4), np.zeros(5))
    assert len(trace.table()) == most
    assert trace.left_out == 5 - most
    trace.note("taken_s", LAND, 4)
    trace.cancelled(LAND, rows(4))
    trace.drew(LAND, rows(4), rows(3))
