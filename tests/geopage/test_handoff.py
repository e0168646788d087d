# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

from geopage.handoff import HISTORY, Signal, TripleBuffer, ViewSlot, same_pose
from tests.geopage.worlds import view_at


def test_the_newest_value_is_taken_and_older_ones_are_skipped() -> None:
    buffer = TripleBuffer(0)
    assert buffer.take() == 0
    for value in (1, 2, 3):
        buffer.publish(value)
    assert [buffer.take(), buffer.take()] == [3, 3]


def test_peeking_takes_nothing() -> None:
    buffer = TripleBuffer("old")
    buffer.publish("new")
    assert [buffer.peek(), buffer.take()] == ["new", "new"]


def test_a_signal_is_raised_once_and_lowered_by_its_waiter() -> None:
    signal = Signal()
    signal.set()
    signal.set()
    assert signal.wait(0)
    assert [signal.clear(), signal.clear()] == [True, False]
    assert not signal.wait(0)


def test_a_closed_signal_ends_every_wait() -> None:
    signal = Signal()
    signal.set()
    signal.close()
    assert not signal.wait()
    assert signal.closed


def test_a_view_that_was_dealt_with_at_rest_wakes_nobody() -> None:
    signal = Signal()
    slot = ViewSlot(signal)
    slot.publish(view_at(100.0))
    assert signal.clear()
    slot.rest(view_at(100.0))
    slot.publish(view_at(100.0, t_s=1.0))
    assert not signal.clear()
    slot.publish(view_at(101.0, t_s=2.0))
    assert signal.clear()


def test_the_history_holds_the_last_views_oldest_first() -> None:
    slot = ViewSlot(Signal())
    for i in range(HISTORY + 3):
        slot.publish(view_at(100.0, t_s=float(i)))
    assert [view.t_s for view in slot.history()] == [float(i + 3) for i in range(HISTORY)]


def test_a_pose_is_the_same_only_when_the_whole_picture_is() -> None:
    view = view_at(100.0)
    assert same_pose(view, replace(view, t_s=5.0))
    assert not same_pose(view, replace(view, width_px=1281))
    assert not same_pose(view, view_at(100.0, heading_deg=1e-6))
