# SPDX-License-Identifier: Apache-2.0
"""Failures: a thread dies, threads do not end, threads work although nothing changes."""

import itertools
import time
from pathlib import Path

import numpy as np
import pytest

from geopage.manager import TileManager
from geopage.pager import Pager
from geopage.scene import SceneManager
from geopage.server import TileServer
from geopage.settings import PagerSettings, Throttle
from tests.geopage.stub_renderer import prime
from tests.geopage.trial import HIGH_M
from tests.geopage.worlds import SPOT
from viewer.stability.paging_threads import (
    PAUSE_S,
    busy_at_rest_s,
    threads_of,
    turn,
)
from viewer.stability.site import Site

SITE = Site(*SPOT)
FRAME_ASKS = 50
LATEST_S = 0.02
"""Moments of closing lie so long after the start, at most."""


def fall(pager: Pager, frames: int = 20_000) -> None:
    """Show ever other views."""
    for i in range(frames):
        turn(pager, SITE.view(1e6 * 0.999**i, t_s=i / 60))


@pytest.mark.parametrize("role", [SceneManager, TileManager, TileServer])
@pytest.mark.parametrize("steps", [0, 7])
def test_what_kills_a_thread_surfaces_in_the_caller_and_ends_the_others(
    store_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    role: type[SceneManager | TileManager | TileServer],
    steps: int,
) -> None:
    left, well = iter(range(steps)), role.step

    def dies(self: object, *now_s: float) -> object:
        if next(left, None) is None:
            raise MemoryError("no more")
        return well(self, *now_s)  # type: ignore[arg-type]

    monkeypatch.setattr(role, "step", dies)
    pager = Pager(store_path)
    pager.start()
    with pytest.raises(MemoryError, match="no more"):
        fall(pager)
    with pytest.raises(MemoryError, match="no more"):
        pager.draw_list()
    start_s = time.monotonic()
    pager.close()
    assert time.monotonic() - start_s < 2.0
    assert not threads_of(pager)


def longest_shutdown_s(
    store: Path, site: Site, count: int, settings: PagerSettings | None = None
) -> float:
    """Close pagers with all their threads at random moments of a fall.

    Returns
    -------
    The longest that closing took, and that a thread lived on: at most 2 s.
    """
    rng, longest = np.random.default_rng(5), 0.0
    for moment_s in rng.uniform(0.0, LATEST_S, count).tolist():
        pager = Pager(store, settings, dry=settings is None)
        pager.start()
        start_s = time.monotonic()
        for i in itertools.count():
            if time.monotonic() - start_s >= moment_s:
                break
            turn(pager, site.view(HIGH_M * 0.5**i, t_s=i * PAUSE_S))
        start_s = time.monotonic()
        pager.close()
        while threads_of(pager):
            time.sleep(PAUSE_S)
        longest = max(longest, time.monotonic() - start_s)
    return longest


def test_threads_end_in_time_whenever_they_are_told_to(store_path: Path) -> None:
    assert longest_shutdown_s(store_path, SITE, 20) < 2.0


def test_threads_end_in_time_while_they_wait_for_a_slow_line(store_path: Path) -> None:
    slow = PagerSettings(throttle=Throttle(1e-4, 5000.0))
    assert longest_shutdown_s(store_path, SITE, 5, slow) < 2.0


def test_a_static_view_costs_the_paging_threads_nothing(store_path: Path) -> None:
    assert busy_at_rest_s(store_path, SITE) == (0.0, 0, 0)


def test_nothing_begins_while_a_frame_needs_the_gil(
    store_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[object] = []
    for role in (SceneManager, TileManager, TileServer):
        step = role.step

        def noted(self: object, *now_s: float, step: object = step) -> object:
            begun.append(self)
            return step(self, *now_s)  # type: ignore[operator]

        monkeypatch.setattr(role, "step", noted)
    asked: list[int] = []

    def wants_gil() -> bool:
        asked.append(len(begun))
        return len(asked) <= FRAME_ASKS

    with Pager(store_path) as pager:
        pager.make_way_for(wants_gil)
        pager.view(SITE.view(1e6, t_s=0.0))
        pager.start()
        prime(pager)
    assert set(asked[:FRAME_ASKS]) == {0}
    assert begun


def test_threads_end_in_time_during_a_frame(store_path: Path) -> None:
    pager = Pager(store_path)
    pager.make_way_for(lambda: True)
    pager.view(SITE.view(1e6, t_s=0.0))
    pager.start()
    start_s = time.monotonic()
    pager.close()
    assert time.monotonic() - start_s < 2.0
    assert not threads_of(pager)
