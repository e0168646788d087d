# SPDX-License-Identifier: Apache-2.0
"""The loop of a window: events, pose, paging, picture.

A step does all of it once, by the caller's clock. Where nothing changes, nothing is
drawn, nothing is told to the pager, and the loop waits for the next event.
"""

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from geopage.draw_list import DrawList
from geopage.view import ViewState
from tiles.errors import InputError
from tiles.frames import Ecef
from viewer import gil
from viewer.app_actions import Actions
from viewer.app_film import Filming
from viewer.app_hud import Hud, title_of
from viewer.app_input import Input
from viewer.app_paging import Told
from viewer.app_record import Recorder, Replayer
from viewer.app_search import Search
from viewer.app_state import MESSAGE_S, AppState
from viewer.camera import Pose, unproject
from viewer.events import Event, Key, MouseButton, MouseMove, Wheel
from viewer.flight import FRAME_S, UPLOAD_BYTES, UPLOAD_S
from viewer.frame_stats import FrameStats
from viewer.ground import Ground
from viewer.navigation import Navigator
from viewer.navigation_geometry import Lens
from viewer.session import Session
from viewer.sun import sun_direction
from viewer.window import Window

if TYPE_CHECKING:
    from viewer.app_shot import Shot
    from viewer.governor import Governor

SMALLEST_PX = 16
IDLE_S, WAITING_S = 1.0, 0.004
"""How long to wait for an event: at rest, and while tiles are on their way."""
MOVING_SHARE, RESTING_SHARE = 0.1, 0.5
"""Of the last frame's time, for uploads."""
EXTRA_FRAMES = 6
"""The HUD settles in so many frames after an event."""
WATCH_S = 2.0
REST_S = 0.3
"""An eye that has not moved for so long rests: then detail may take its time."""
WELCOME = "drag turns, wheel zooms, double click flies there"


class App:
    """A session in a window. Thread: the one that made the window.

    Parameters
    ----------
    session : drawn with the window's context
    start : where the eye is at first
    """

    def __init__(
        self,
        session: Session,
        window: Window,
        start: Pose,
        state: AppState,
        hud: Hud | None = None,
    ) -> None:
        self.session, self.state, self.hud = session, state, hud
        self.window: Window = window
        self.ground = Ground(session.surface)
        lens = Lens(session.renderer.size_px)
        self.drawn: DrawList | None = None
        """the list that the last frame was drawn from"""
        self._seen: ViewState | None = None
        """the view of the last frame"""
        self.navigator: Navigator = Navigator(start, lens, self.touch, self.ground.below)
        self.do: Actions = Actions(self)
        self.input = Input(self)
        self.recorder, self.replayer = Recorder(), Replayer()
        self.filming = Filming()
        self.search = Search(session.store)
        self.governor: Governor | None = None
        """holds a frame rate, where one is wanted"""
        self.shot: Shot | None = None
        self.stats: FrameStats | None = None
        self.loading = True
        """whether the view lacks something that is on its way"""
        self.resting = False
        """whether the eye has not moved for a moment"""
        self._moved_s = self.now_s = 0.0
        self.told = Told(session.pager)
        self._extra = EXTRA_FRAMES
        self._still = False
        """whether the last frame showed the same as the one before: it is smoothed"""
        self._title = ""
        self._watch_s = 0.0
        self._overlay, self._sun = state.overlay, state.utc

    def run(self) -> None:
        """Go on until the window is closed."""
        self.session.pager.view(self.navigator.view(0.0))
        self.session.pager.start()
        self.state.say(WELCOME, math.inf)
        start = time.monotonic()
        gil.be_prompt()
        with gil.interval(gil.KEEP_S):
            while not self.state.closing:
                begun = time.monotonic()
                with gil.interval(gil.SHARE_S):
                    events = self.window.take_events(self.wait_s())
                self.step(time.monotonic() - start, events)
                if not self.wait_s():
                    with gil.interval(gil.SHARE_S):
                        time.sleep(max(0.0, FRAME_S - (time.monotonic() - begun)))

    def close(self) -> list[str]:
        """End what goes on beside the window; returns what to say about it."""
        self.window.hide()
        told = []
        if self.recorder.on:
            self.do.record()
            told.append(self.state.message)
        told += self.filming.close()
        if self.hud:
            self.hud.close()
        return told

    def step(self, now_s: float, events: list[Event] | None = None) -> FrameStats | None:
        """Do everything once; returns figures where the world was drawn anew.

        Parameters
        ----------
        now_s : on a clock that begins with the app
        events : None: what the window has

        Raises
        ------
        InputError
            When the driver was reset.
        """
        self.now_s = now_s
        happened = self.window.take_events() if events is None else events
        if happened:
            moves = all(isinstance(event, MouseMove) for event in happened)
            self._extra = max(self._extra, 2 if moves else EXTRA_FRAMES)
            if any(isinstance(event, MouseButton | Wheel | Key) for event in happened):
                self.state.unsay(WELCOME)
        left = self.hud.take(happened) if self.hud and self.state.hud_visible else happened
        for event in left:
            self.input.handle(event)
        self._watch()
        if self._resize() == (0, 0):
            return None
        if self.state.forget(now_s):
            self._extra = EXTRA_FRAMES
        self.replayer.step(self)
        self.navigator.step(now_s)
        self.told.destination(self.navigator.destination, self.navigator.lens)
        self.recorder.step(self)
        self.filming.step(self)
        self.do.step()
        if self.search.step():
            self._extra = EXTRA_FRAMES
        return self._show(happened)

    def wait_s(self) -> float:
        """Return how long nothing will change unless something happens."""
        if self.window.minimised:
            return IDLE_S / 4
        if self._extra or self.navigator.moving:
            return 0.0
        if self.replayer.on or self.recorder.on:
            return FRAME_S
        if not self.session.pager.settled or self.shot:
            return WAITING_S
        return IDLE_S if self._still else 0.0

    def _show(self, happened: list[Event]) -> FrameStats | None:
        """Page and draw, as far as there is anything new."""
        begun = time.perf_counter()
        view = self.navigator.view(self.now_s)
        moved = self.told.view(view, held=self.state.frozen or self.shot is not None)
        pager = self.session.pager
        drawn = pager.draw_list()
        self._feed(drawn, moved=moved)
        self._rest(moved=moved)
        if not drawn.number:
            return None
        stats, new = None, self._is_new(drawn) or moved
        if new or (pager.settled and not self._still):
            self._still = not new
            stats = self._draw(drawn, view)
            self._extra = max(self._extra, 1)
        if self.shot and self.shot.step(self):
            self.shot, self._extra = None, EXTRA_FRAMES
        if self._extra or happened:
            self._extra = max(self._extra - 1, 0)
            self._compose()
            if stats:
                self._judge(view, stats, (time.perf_counter() - begun) * 1e3)
            with gil.interval(gil.SHARE_S):
                self.window.swap()
        return stats

    def _feed(self, drawn: DrawList, *, moved: bool) -> None:
        """Upload tiles for as long as a frame bears: longer where frames take long."""
        last_s = self.state.frame_ms[-1] / 1000 if self.state.frame_ms else 0.0
        upload_s = max(UPLOAD_S, last_s * (MOVING_SHARE if moved else RESTING_SHARE))
        size_bytes = int(UPLOAD_BYTES * upload_s / UPLOAD_S)
        self.session.feeder.feed(drawn.number, size_bytes, upload_s)

    def _rest(self, *, moved: bool) -> None:
        """Note whether all is there, and give a resting eye all the detail asked for."""
        if self.loading == self.session.pager.settled:
            self.loading, self._extra = not self.loading, max(self._extra, 2)
        if moved:
            self._moved_s = self.now_s
        self.resting = self.now_s - self._moved_s > REST_S
        if self.governor:
            self.governor.rest(on=self.resting)

    def _judge(self, view: ViewState, stats: FrameStats, frame_ms: float) -> None:
        self.state.frame_ms.append(frame_ms)
        if self.governor:
            self.governor.frame(view, stats, frame_ms)

    def redraw(self) -> None:
        """Draw the world at the next step, whether anything has moved or not."""
        self.drawn = None

    def _is_new(self, drawn: DrawList) -> bool:
        looks = self.state.overlay, self.state.utc
        changed = looks != (self._overlay, self._sun) or self.drawn is not drawn
        self._overlay, self._sun = looks
        return changed or drawn.fade is not None

    def _draw(self, drawn: DrawList, view: ViewState) -> FrameStats:
        renderer, utc = self.session.renderer, self.state.utc
        renderer.overlay = self.state.overlay
        renderer.look = replace(renderer.look, sun=sun_direction(utc) if utc else None)
        self.drawn, self._seen = drawn, view
        self.stats = self.session.renderer.draw(drawn, view)
        return self.stats

    def _compose(self) -> None:
        """Put the last picture into the window, and the panels over it."""
        self.session.renderer.blit(0, self.window.size_px)
        if self.hud:
            self.hud.draw(self, self.now_s)
        elif (title := title_of(self)) != self._title:
            self._title = title
            self.window.set_title(title)

    def _resize(self) -> tuple[int, int]:
        """Draw as large as the window is; returns its size."""
        size = self.window.size_px
        wanted = max(size[0], SMALLEST_PX), max(size[1], SMALLEST_PX)
        if size != (0, 0) and wanted != self.session.renderer.size_px and not self.shot:
            self.set_size(wanted)
        return size

    def set_size(self, size_px: tuple[int, int]) -> None:
        """Draw pictures of another size from now on."""
        self.session.renderer.resize(size_px)
        self.session.picture = replace(self.session.picture, size_px=size_px)
        self.navigator.lens = replace(self.navigator.lens, size_px=size_px)
        self.drawn = self._seen = None
        self._extra = EXTRA_FRAMES

    def _watch(self) -> None:
        """Look now and then whether the driver was reset."""
        if self.now_s < self._watch_s:
            return
        self._watch_s = self.now_s + WATCH_S
        if self.window.is_lost():
            reason = "the driver was reset and has lost every picture"
            raise InputError("OpenGL", reason, "start geopage view again")

    def say(self, message: str, for_s: float = MESSAGE_S) -> None:
        """Show a line for a while."""
        self.state.say(message, for_s)
        self.refresh()

    def refresh(self) -> None:
        """Draw the panels anew."""
        self._extra = EXTRA_FRAMES

    def touch(self, x: float, y: float) -> Ecef | None:
        """Return the point that is drawn at a pixel, None where sky."""
        seen = self._seen
        if seen is None or not (0 <= x < seen.width_px and 0 <= y < seen.height_px):
            return None
        depth = self.session.renderer.read_depth(int(x), int(y))
        return unproject(seen, int(x) + 0.5, int(y) + 0.5, depth) if depth else None
