# SPDX-License-Identifier: Apache-2.0
"""The app with the pager's own threads, in real time."""

import time
from pathlib import Path

from tests.viewer.flown import STEP_S, open_app
from tests.viewer.screen import Screen
from viewer.app import IDLE_S

SIZE = 320, 200


def test_a_static_view_wakes_no_thread(
    hill_store: Path, screen: Screen, tmp_path: Path
) -> None:
    assert screen.display
    with open_app(hill_store, tmp_path, SIZE) as app:
        pager = app.session.pager
        pager.start()
        for _ in range(2):  # at rest, and again after a move
            app.navigator.wheel(160.5, 100.5, 1.0)
            end = time.monotonic() + 60
            while app.wait_s() < IDLE_S:
                assert time.monotonic() < end
                app.t_s += STEP_S
                app.step(app.t_s, app.window.take_events(0.005))
            before = pager.wake_ups
            for _ in range(20):
                app.t_s += STEP_S
                assert app.step(app.t_s, app.window.take_events(0.01)) is None
            assert pager.wake_ups == before
