# SPDX-License-Identifier: Apache-2.0
"""What events of the window mean for an app."""

from typing import TYPE_CHECKING

from viewer.app_commands import BY_KEY, HELD
from viewer.app_mouse import Clicks
from viewer.events import Close, Event, Focus, Key, MouseButton, MouseMove, Wheel

if TYPE_CHECKING:
    from viewer.app import App


class Input:
    """Hands events on to navigation and commands."""

    def __init__(self, app: "App") -> None:
        self._app = app
        self._clicks = Clicks()
        self._dragging = ""

    def handle(self, event: Event) -> None:
        """Do what one event says."""
        match event:
            case MouseMove():
                self._clicks.moved(event)
                if self._dragging:
                    self._app.navigator.move(event.x, event.y)
            case MouseButton():
                self._button(event)
            case Wheel():
                self._app.replayer.stop()
                self._app.navigator.wheel(event.x, event.y, event.notches)
            case Key():
                self._key(event)
            case Focus(on=False):
                self._app.navigator.held.clear()
            case Close():
                self._app.state.closing = True
            case _:
                pass

    def _button(self, event: MouseButton) -> None:
        app = self._app
        if not event.down:
            if event.button == self._dragging or not self._dragging:
                self._dragging = ""
                app.navigator.release()
            if event.button == "left" and self._clicks.released(event):
                app.do.inspect(event.x, event.y)
            return
        app.replayer.stop()
        if event.button == "left" and self._clicks.pressed(event):
            app.do.approach(event.x, event.y)
            return
        self._dragging = event.button
        app.navigator.press(event.x, event.y, tilting=event.button != "left")

    def _key(self, event: Key) -> None:
        app = self._app
        app.navigator.fast = event.shift
        if (way := HELD.get(event.name)) is not None:
            if not event.down:
                app.navigator.held.discard(way)
            elif not event.control:
                app.replayer.stop()
                app.navigator.held.add(way)
        elif event.down:
            command = BY_KEY.get(event.name)
            if command and (command.repeats or not event.again):
                command.act(app)
