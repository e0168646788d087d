# SPDX-License-Identifier: Apache-2.0
"""An app in a real window whose clock a test turns."""

import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from geopage.settings import PagerSettings
from tests.viewer.small_world import BLOCK_M, LAT_DEG, LON_DEG, ROWS
from tiles.frames import Ecef
from viewer.app import IDLE_S, App
from viewer.app_state import AppState
from viewer.camera import Pose, project
from viewer.events import Event, Key, MouseButton
from viewer.open_window import hud_of
from viewer.session import Picture, Session
from viewer.window import Window

STEP_S = 1 / 30
CITY = LON_DEG + 0.9 * BLOCK_M * ROWS / 78_500, LAT_DEG + 0.9 * BLOCK_M * ROWS / 111_000
FINE = PagerSettings(object_threshold_px=0.5, fade_s=0.0)
DOWN = -math.pi / 2


def over_city(height_m: float, pitch_rad: float = DOWN) -> Pose:
    lon, lat = (math.radians(one) for one in CITY)
    return Pose(lon, lat, height_m, 0.0, pitch_rad)


class Flown(App):
    """An app whose clock the test turns, and which pages between its steps."""

    t_s = 0.0

    def go(self, seconds: float = STEP_S, *events: Event) -> int:
        """Turn the clock; returns how often the world was drawn."""
        left, drawn = list(events), 0
        for _ in range(max(round(seconds / STEP_S), 1)):
            self.t_s += STEP_S
            self.session.pager.step(self.t_s)
            drawn += self.step(self.t_s, left) is not None
            left = []
        return drawn

    def settle(self) -> None:
        """Go on until everything is there."""
        for _ in range(600):
            self.go()
            if self.wait_s() >= IDLE_S:
                return
        raise AssertionError("never settled")

    def put(self, pose: Pose) -> None:
        """Be somewhere else, all of it loaded."""
        self.navigator.stop()
        self.navigator.pose = pose
        self.settle()

    def press(self, x: float, y: float, button: str = "left", *, down: bool) -> None:
        event = MouseButton(x, y, "left" if button == "left" else "right", down)
        self.go(STEP_S, replace(event, t_s=self.t_s))

    def click(self, x: float, y: float) -> None:
        self.press(x, y, down=True)
        self.press(x, y, down=False)

    def key(self, name: str) -> None:
        self.go(STEP_S, Key(name, down=True), Key(name, down=False))

    def where(self, point: Ecef) -> tuple[float, float]:
        x, y, depth = project(self.navigator.view(0.0), point)
        assert depth > 0
        return float(x), float(y)


@contextmanager
def open_app(
    store: Path, folder: Path, size_px: tuple[int, int], *, panels: bool = False
) -> Iterator[Flown]:
    """Open a copy of a store above its city, with everything loaded."""
    copy = shutil.copy(store, folder / "hills.geopage")
    with (
        Window("app", size_px) as window,
        Session(copy, FINE, Picture(size_px), context=window.gl) as session,
    ):
        session.renderer.smooth = False  # so that the window shows what was drawn
        state = AppState(FINE.threshold_px, FINE.object_threshold_px, out=folder)
        hud = hud_of(window) if panels else None
        app = Flown(session, window, over_city(2000.0), state, hud)
        session.pager.view(app.navigator.view(0.0))
        app.settle()
        yield app
        app.close()
