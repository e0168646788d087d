# SPDX-License-Identifier: Apache-2.0
"""A window with an OpenGL context, and the events of its mouse and keys.

GLFW is called through ctypes, which gives the GIL away, so that waiting for events or
for the screen stops no paging. All calls belong to the thread that made the window.
"""

import math
import time
from typing import Any

import glfw
import moderngl

from tiles.closing import Closing
from tiles.errors import InputError
from viewer.events import (
    Button,
    Close,
    Event,
    Focus,
    Key,
    MouseButton,
    MouseMove,
    Refresh,
    Text,
    Wheel,
)
from viewer.gl import Gl
from viewer.window_context import Loader, address_of, make_window, raising

NONE: Any = None
SIGNS = {"+": "equal", "-": "minus"}
BUTTONS: dict[int, Button] = {0: "left", 1: "right", 2: "middle"}
KEYS = {
    value: name.removeprefix("KEY_").lower()
    for name, value in vars(glfw).items()
    if name.startswith("KEY_") and isinstance(value, int)
}


class Window(Closing):
    """One window. It collects its events until `take_events` is called.

    Parameters
    ----------
    title : of the window
    size_px : in the screen's own unit, which some systems scale
    visible : False for a context without a picture on the screen

    Raises
    ------
    InputError
        When there is no display, or no driver that can draw; in one line.
    """

    count = 0
    """how many are open in this process"""

    def __init__(
        self, title: str, size_px: tuple[int, int], *, visible: bool = True
    ) -> None:
        self._events: list[Event] = []
        self._left_is_right = False
        self._heard_s = math.inf
        """when it was last asked what happened; infinite while it is waited for"""
        self._windowed: tuple[int, int, int, int] | None = None
        with raising():
            self.handle = make_window(title, size_px, visible=visible)
            Window.count += 1
            glfw.make_context_current(self.handle)
            glfw.swap_interval(1)
        try:
            loader: Any = Loader(self.handle)
            self.gl = Gl(moderngl.create_context(context=loader), address_of)
        except Exception:
            self.close()
            raise
        self._listen()

    # What it looks like.

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the picture in it; (0, 0) while it is minimised."""
        width, height = glfw.get_framebuffer_size(self.handle)
        return (0, 0) if self.minimised else (int(width), int(height))

    @property
    def minimised(self) -> bool:
        """Whether nothing of it is to be seen."""
        return bool(glfw.get_window_attrib(self.handle, glfw.ICONIFIED))

    @property
    def scale(self) -> float:
        """How much larger than usual letters must be on this screen."""
        return max(float(max(glfw.get_window_content_scale(self.handle))), 1.0)

    def hide(self) -> None:
        """Take it from the screen."""
        glfw.hide_window(self.handle)

    def set_title(self, title: str) -> None:
        """Write into the window's frame."""
        glfw.set_window_title(self.handle, title)

    def toggle_fullscreen(self) -> None:
        """Fill the screen that shows most of the window, or go back."""
        if self._windowed:
            glfw.set_window_monitor(self.handle, NONE, *self._windowed, 0)
            self._windowed = None
            return
        place = *glfw.get_window_pos(self.handle), *glfw.get_window_size(self.handle)
        if (monitor := self._monitor()) is not None:
            self._windowed = place
            mode = glfw.get_video_mode(monitor)
            size = mode.size.width, mode.size.height
            glfw.set_window_monitor(self.handle, monitor, 0, 0, *size, mode.refresh_rate)

    @property
    def is_fullscreen(self) -> bool:
        """Whether it fills a screen."""
        return self._windowed is not None

    def _monitor(self) -> Any:
        """Return the monitor in which most of the window is, None where there is none."""
        x, y = glfw.get_window_pos(self.handle)
        width, height = glfw.get_window_size(self.handle)

        def shared(monitor: Any) -> int:
            left, top = glfw.get_monitor_pos(monitor)
            size = glfw.get_video_mode(monitor).size
            across = min(x + width, left + size.width) - max(x, left)
            down = min(y + height, top + size.height) - max(y, top)
            return max(across, 0) * max(down, 0)

        return max(glfw.get_monitors(), key=shared, default=None)

    # What happens.

    def take_events(self, wait_s: float = 0.0) -> list[Event]:
        """Return what happened; without anything, after waiting so long at most."""
        glfw.poll_events()
        if wait_s > 0 and not self._events:
            self._heard_s = math.inf
            glfw.wait_events_timeout(wait_s)
        self._heard_s = time.monotonic()
        events, self._events = self._events, []
        return events

    def swap(self) -> None:
        """Show what was drawn."""
        glfw.swap_buffers(self.handle)

    def is_lost(self) -> bool:
        """Say whether the driver was reset and lost everything that it was given."""
        try:
            return bool(self.gl.call("glGetGraphicsResetStatus") & 0xFFFF)
        except InputError:
            return False  # a driver that can't tell

    def close(self) -> None:
        """Close the window."""
        glfw.make_context_current(NONE)
        glfw.destroy_window(self.handle)
        Window.count -= 1
        if not Window.count:
            glfw.terminate()

    # How events arrive.

    def _listen(self) -> None:
        add, handle = self._events_add, self.handle
        self._cursor = self._px(*glfw.get_cursor_pos(handle))
        """where the mouse was at the last event, not where it has got to since"""
        glfw.set_cursor_pos_callback(handle, self._on_move)
        glfw.set_mouse_button_callback(handle, self._on_button)
        glfw.set_scroll_callback(handle, self._on_wheel)
        glfw.set_key_callback(handle, self._on_key)
        glfw.set_char_callback(handle, lambda _, code: add(Text(chr(code))))
        glfw.set_window_focus_callback(handle, lambda _, on: add(Focus(bool(on))))
        glfw.set_window_close_callback(handle, lambda _: add(Close()))
        glfw.set_window_refresh_callback(handle, lambda _: add(Refresh()))
        glfw.set_framebuffer_size_callback(handle, lambda *_: add(Refresh()))

    def _events_add(self, event: Event) -> None:
        self._events.append(event)

    def _px(self, x: float, y: float) -> tuple[float, float]:
        """Return the middle of the pixel at a place; some screens have several a unit."""
        width, height = glfw.get_window_size(self.handle)
        across, down = glfw.get_framebuffer_size(self.handle)
        column, row = x * across / max(width, 1), y * down / max(height, 1)
        return math.floor(column) + 0.5, math.floor(row) + 0.5

    def _on_move(self, _: Any, x: float, y: float) -> None:
        self._cursor = self._px(x, y)
        self._events_add(MouseMove(*self._cursor))

    def _on_button(self, _: Any, button: int, action: int, mods: int) -> None:
        if button in BUTTONS:
            down, shift = action == glfw.PRESS, bool(mods & glfw.MOD_SHIFT)
            name = BUTTONS[button]
            if name == "left" and down:
                self._left_is_right = bool(mods & glfw.MOD_CONTROL)
            if name == "left" and self._left_is_right:
                name = "right"  # for those who have one button
            now_s = time.monotonic()
            times_s = now_s, max(now_s - self._heard_s, 0.0)
            self._events_add(MouseButton(*self._cursor, name, down, shift, *times_s))

    def _on_wheel(self, _: Any, __: float, notches: float) -> None:
        self._events_add(Wheel(*self._cursor, notches))

    def _on_key(self, _: Any, key: int, code: int, action: int, mods: int) -> None:
        shift, control = bool(mods & glfw.MOD_SHIFT), bool(mods & glfw.MOD_CONTROL)
        states = action != glfw.RELEASE, shift, control, action == glfw.REPEAT
        self._events_add(Key(_key_name(key, code), *states))


def _key_name(key: int, code: int) -> str:
    """Return what is written on a key; letters are elsewhere on other keyboards."""
    name = KEYS.get(key, "")
    written = "" if name.startswith("kp_") else glfw.get_key_name(key, code) or ""
    if len(written) == 1 and written.isascii() and written.isalpha():
        return str(written.lower())
    return SIGNS.get(written, name)


def open_hidden() -> moderngl.Context:
    """Return the context of a window that is never shown, where there is no EGL.

    Raises
    ------
    InputError
    """
    return Window("geopage", (64, 64), visible=False).gl.context
