# SPDX-License-Identifier: Apache-2.0
import sqlite3
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geopage.draw_list import DrawList
from geopage.pager import Pager
from geopage.selection import ideal
from geopage.settings import DETAILS, PagerSettings, Throttle
from geopage.tile_state import State
from geopage.view import ViewState
from tests.geopage.stub_renderer import StubRenderer, prime
from tests.geopage.worlds import SPOT, deep_globe, object_records, view_at, write_store
from tiles import cells
from tiles.lanes import Lane

SMALL = 720_000
"""Enough for the index, the zones and a good hundred tiles of 4,000 bytes."""
TOKYO = (2.44, 0.62)


@pytest.fixture
def pager(store_path: Path) -> Iterator[Pager]:
    with Pager(store_path) as made:
        yield made


def assert_same_picture(drawn: DrawList, wanted: DrawList) -> None:
    assert set(drawn.terrain.tolist()) == set(wanted.terrain.tolist())
    assert drawn.objects.tolist() == wanted.objects.tolist()
    assert drawn.own.tolist() == wanted.own.tolist()
    assert drawn.proxies.tolist() == wanted.proxies.tolist()


def fly_in(frames: int) -> list[ViewState]:
    heights = np.geomspace(1e7, 50.0, frames)
    return [view_at(float(h), t_s=i / 60) for i, h in enumerate(heights)]


def fly(pager: Pager, views: list[ViewState]) -> list[DrawList]:
    renderer = StubRenderer(pager)
    lists = []
    for view in views:
        lists.append(renderer.frame(view))
        pager.step(view.t_s)
    return lists


@pytest.mark.parametrize("height_m", [1e7, 1e5, 2e3, 50.0])
def test_a_settled_pager_draws_the_ideal(pager: Pager, height_m: float) -> None:
    drawn = StubRenderer(pager).settle(view_at(height_m))
    assert_same_picture(drawn, ideal(pager.forests, view_at(height_m), 2.0, 2.0))
    assert drawn.settled
    assert not drawn.stand_in.any()


def test_the_first_list_comes_when_all_zones_are_there(pager: Pager) -> None:
    renderer = StubRenderer(pager)
    assert renderer.frame(view_at(1e7)).number == 0
    first = prime(pager, renderer.upload)
    assert first.number > 0
    assert (
        0.25 ** cells.level(pager.forests[Lane.TERRAIN].records["cell"][first.terrain])
    ).sum() == 32


def test_nothing_of_a_flight_depends_on_anything_but_its_views(store_path: Path) -> None:
    runs = []
    for _ in range(2):
        with Pager(store_path, PagerSettings(throttle=Throttle(0.05, 5.0))) as pager:
            lists = fly(pager, fly_in(200))
            runs.append(([drawn.terrain.tolist() for drawn in lists], pager.counters))
    assert runs[0] == runs[1]
    assert runs[0][1]["tiles_loaded"] > 50


def test_both_lanes_progress_on_a_slow_line(store_path: Path) -> None:
    with Pager(store_path, PagerSettings(throttle=Throttle(0.02, 10.0))) as pager:
        renderer = StubRenderer(pager)
        renderer.settle(view_at(300.0))
        lanes = [lane for lane, _ in renderer.uploads]
    assert lanes.count(Lane.OBJECTS) >= 3
    for lane in Lane:
        assert lane in lanes[: len(lanes) // 2]


POSES = st.builds(
    view_at,
    st.floats(1.5, 7.0).map(lambda x: 10.0**x),
    st.sampled_from([SPOT, TOKYO, (SPOT[0] + 0.001, SPOT[1])]),
    st.floats(-90, 0),
    st.floats(0, 360),
)


@settings(max_examples=15)
@given(st.lists(st.tuples(POSES, st.integers(1, 40)), min_size=1, max_size=6))
def test_the_budget_holds_in_random_sessions_and_they_settle(
    store_path: Path, session: list[tuple[ViewState, int]]
) -> None:
    # The renderer checks the bytes, and that it has what it is told to draw, each frame.
    with Pager(store_path, PagerSettings(budget_bytes=SMALL)) as pager:
        renderer = StubRenderer(pager, 16_000)
        for view, frames in session:
            for _ in range(frames):
                renderer.frame(view)
                pager.step(0.0)
        drawn = renderer.settle(view)
        wanted = ideal(pager.forests, view, drawn.threshold_px, drawn.object_threshold_px)
        missing = set(wanted.terrain.tolist()) - set(drawn.terrain.tolist())
        assert not missing or drawn.threshold_px > 2.0


def test_a_short_budget_raises_the_threshold_and_says_so(store_path: Path) -> None:
    with Pager(store_path, PagerSettings(budget_bytes=520_000)) as pager:
        drawn = StubRenderer(pager).settle(view_at(1e6))
        assert drawn.threshold_px > 2.0
        assert drawn.object_threshold_px == drawn.threshold_px
        assert "memory is short" in pager.message


def test_a_jump_cancels_what_the_old_place_wanted(store_path: Path) -> None:
    with Pager(store_path, PagerSettings(throttle=Throttle(0.05))) as pager:
        renderer = StubRenderer(pager)
        pager.view(view_at(300.0))
        now_s = 0.0
        while not pager.draw_list().number:
            now_s += 0.01
            pager.step(now_s)
            renderer.frame(view_at(300.0))
        pager.step(now_s)
        before = pager.counters["tiles_cancelled"]
        already = len(renderer.uploads)
        there = view_at(300.0, TOKYO, t_s=0.01)
        for i in range(3000):
            renderer.frame(there)
            pager.step(now_s + i / 100)
        assert pager.counters["tiles_cancelled"] > before + 20
        wanted = ideal(pager.forests, there, 2.0, 2.0)
        old = cells.contains(
            cells.cell_at(*SPOT, 4), pager.forests[Lane.TERRAIN].records["cell"]
        )
        late = [
            row for lane, row in renderer.uploads[already + 1 :] if lane is Lane.TERRAIN
        ]
        assert not set(late) & set(np.flatnonzero(old)) - set(wanted.terrain.tolist())


@pytest.fixture
def spoilt_path(tmp_path: Path) -> Path:
    """A store in which the town's skyline and the spot's deepest tiles are damaged."""
    path = tmp_path / "spoilt.geopage"
    write_store(path, deep_globe(), object_records())
    with sqlite3.connect(path) as connection:
        connection.execute(
            "UPDATE tile SET body=zeroblob(length(body)) WHERE lane=0 AND cell=?",
            (int(cells.cell_at(*SPOT, 12)),),
        )
    connection.close()
    return path


def test_a_corrupt_tile_is_reported_and_stood_in_for(spoilt_path: Path) -> None:
    with Pager(spoilt_path) as pager:
        drawn = StubRenderer(pager).settle(view_at(300.0))
        cell = pager.forests[Lane.TERRAIN].records["cell"]
        assert len(pager.faults) == 1
        assert cells.text(int(cells.cell_at(*SPOT, 12))) in pager.faults[0]
        stand_ins = cell[drawn.terrain[drawn.stand_in]]
        assert cells.contains(stand_ins, cells.cell_at(*SPOT, 12)).tolist() == [True]


def run_until_settled(
    renderer: StubRenderer, view: ViewState, limit_s: float = 10.0
) -> DrawList:
    pager, until_s = renderer.pager, time.monotonic() + limit_s
    pause = threading.Event()
    while True:
        drawn = renderer.frame(view)
        if pager.settled:
            return drawn
        assert time.monotonic() < until_s, pager.counters
        pause.wait(0.002)


def test_threads_settle_at_the_ideal_and_close_in_time(store_path: Path) -> None:
    pager = Pager(store_path)
    interval_s = sys.getswitchinterval()
    pager.start()
    assert sys.getswitchinterval() < interval_s
    renderer = StubRenderer(pager)
    pager.view(view_at(5e4))
    prime(pager, renderer.upload)
    for view in (view_at(5e4), view_at(100.0, t_s=0.1)):
        assert_same_picture(
            run_until_settled(renderer, view), ideal(pager.forests, view, 2.0, 2.0)
        )
    start_s = time.monotonic()
    pager.close()
    assert time.monotonic() - start_s < 2.0
    assert sys.getswitchinterval() == interval_s
    assert not {thread.name for thread in threading.enumerate()} & set(pager.wake_ups)


def test_a_static_view_wakes_nobody(store_path: Path) -> None:
    with Pager(store_path) as pager:
        pager.start()
        renderer = StubRenderer(pager)
        run_until_settled(renderer, view_at(100.0))
        pause = threading.Event()
        pause.wait(0.05)  # the last thread goes to sleep
        before = dict(pager.wake_ups)
        for i in range(40):
            renderer.frame(view_at(100.0, t_s=float(i)))
            pause.wait(0.002)
        assert pager.wake_ups == before
        assert min(before.values()) >= 1


def test_a_view_that_stops_without_a_word_comes_to_rest(pager: Pager) -> None:
    renderer = StubRenderer(pager)
    for view in fly_in(400)[:300]:
        renderer.frame(view)
        pager.step(view.t_s)
    for i in range(300):
        for item in pager.take_uploads(2**20):
            renderer.upload(item)
            pager.uploaded(item.lane, item.row)
        pager.step(view.t_s + i / 60)
    assert pager.settled


def test_an_error_in_a_server_surfaces_in_the_caller(
    store_path: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "gone.geopage"
    copy.write_bytes(store_path.read_bytes())
    pager = Pager(copy)
    copy.unlink()
    pager.start()
    pager.view(view_at(100.0))
    with pytest.raises(Exception, match=r"gone\.geopage"):
        prime(pager)
    with pytest.raises(Exception, match=r"gone\.geopage"):
        pager.view(view_at(100.0))
    pager.close()


def test_stepping_a_started_pager_is_refused(pager: Pager) -> None:
    pager.start()
    with pytest.raises(RuntimeError, match="step"):
        pager.step(0.0)


def test_a_tile_that_nobody_wants_any_more_is_not_uploaded(pager: Pager) -> None:
    renderer = StubRenderer(pager)
    pager.view(view_at(300.0))
    prime(pager, renderer.upload)
    for _ in range(10):
        pager.step(0.0)
    waiting = set(pager._residency.ready)
    pager.view(view_at(1e7, TOKYO))
    pager.step(0.0)
    assert waiting
    assert not waiting & {(item.lane, item.row) for item in pager.take_uploads(2**20)}
    pager.step(0.0)
    states = {pager._residency.state(*key) for key in waiting}
    assert states <= {State.ABSENT, State.QUEUED, State.LOADING, State.RESIDENT}


def test_uploads_keep_to_their_bytes_but_always_make_progress(pager: Pager) -> None:
    renderer = StubRenderer(pager)
    pager.view(view_at(300.0))
    prime(pager, renderer.upload)
    for _ in range(10):
        pager.step(0.0)
    assert len(pager.take_uploads(1)) == 1
    assert len(pager.take_uploads(8_000)) == 2


def test_a_flight_in_reads_little_that_it_never_draws(pager: Pager) -> None:
    fly(pager, fly_in(600))
    counted = pager.counters
    assert counted["tiles_unused"] <= 0.25 * counted["tiles_loaded"]
    assert counted["bytes_read"] > 0


def test_detail_by_speed_is_less_while_the_view_moves_and_the_same_at_rest(
    store_path: Path,
) -> None:
    cost = {}
    for detail in DETAILS:
        with Pager(store_path, PagerSettings(detail=detail, fade_s=0.0)) as pager:
            east = SPOT[0] + np.linspace(-3e-4, 3e-4, 60)
            views = [
                view_at(2e3, (lon, SPOT[1]), -60.0, t_s=i / 60)
                for i, lon in enumerate(east)
            ]
            StubRenderer(pager).settle(views[0])
            renderer = StubRenderer(pager)
            renderer.there = {
                (lane, row)
                for lane in Lane
                for row in range(len(pager.forests[lane].parent))
                if pager._residency.state(lane, row) is State.UPLOADED
            }
            lists = []
            for view in views:
                lists.append(renderer.frame(view))
                pager.step(10.0 + view.t_s)
            cost[detail] = sum(len(drawn.objects) for drawn in lists[-20:])
            last = renderer.settle(replace(views[-1], t_s=20.0))
            assert_same_picture(last, ideal(pager.forests, views[-1], 2.0, 2.0))
            assert last.sweep.shutter_s == 0.0
    assert cost["size-and-speed"] < 0.8 * cost["size"]
