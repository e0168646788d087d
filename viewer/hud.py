# SPDX-License-Identifier: Apache-2.0
"""Panels over the picture, made with Dear ImGui. Its library is an extra (`gui`)."""

from typing import TYPE_CHECKING, Any

from imgui_bundle import imgui

from viewer import hud_card, hud_help, hud_look, hud_style, hud_tools, hud_view
from viewer.events import Event, Focus, Key, MouseButton, MouseMove, Text, Wheel

if TYPE_CHECKING:
    from viewer.app import App
    from viewer.window import Window

GLSL = "#version 430"
BUTTONS = {"left": 0, "right": 1, "middle": 2}
KEYS = {
    "tab": "tab",
    "left": "left_arrow",
    "right": "right_arrow",
    "up": "up_arrow",
    "down": "down_arrow",
    "home": "home",
    "end": "end",
    "delete": "delete",
    "backspace": "backspace",
    "enter": "enter",
    "kp_enter": "enter",
    "escape": "escape",
    "a": "a",
    "c": "c",
    "v": "v",
    "x": "x",
    "z": "z",
}
"""Those that edit a text."""
FIXED: Any = (
    imgui.WindowFlags_.no_title_bar
    | imgui.WindowFlags_.no_resize
    | imgui.WindowFlags_.no_move
    | imgui.WindowFlags_.no_collapse
    | imgui.WindowFlags_.no_saved_settings
)
LONGEST_S = 0.1


class ImguiHud:
    """The panels of one window. Thread: the window's."""

    def __init__(self, window: "Window") -> None:
        self._window = window
        self._context = imgui.create_context()
        imgui.get_io().set_ini_filename("")
        imgui.get_io().config_input_text_enter_keep_active = True
        hud_style.dress(window.scale)
        imgui.backends.opengl3_init(GLSL)
        self._boxes: list[tuple[float, float, float, float]] = []
        self._last_s = 0.0
        self._typing = False
        self._unsure = 0
        """draws until it is known whether a click has begun a text"""
        self.tools = hud_tools.Tools()
        self.look = hud_look.LookPanel()

    def take(self, events: list[Event]) -> list[Event]:
        """Tell the panels; returns the events that are not theirs."""
        io = imgui.get_io()
        return [event for event in events if not self._is_ours(io, event)]

    def _is_ours(self, io: Any, event: Event) -> bool:
        match event:
            case MouseMove(x=x, y=y):
                io.add_mouse_pos_event(x, y)
            case MouseButton(x=x, y=y):
                io.add_mouse_pos_event(x, y)
                io.add_mouse_button_event(BUTTONS[event.button], event.down)
                over = self._is_over(x, y)
                self._typing = self._typing and over
                self._unsure = 3 * over
                return event.down and over
            case Wheel(x=x, y=y):
                io.add_mouse_wheel_event(0.0, event.notches)
                return self._is_over(x, y)
            case Key():
                if name := KEYS.get(event.name):
                    io.add_key_event(imgui.Key.mod_shift, event.shift)
                    io.add_key_event(imgui.Key.mod_ctrl, event.control)
                    io.add_key_event(getattr(imgui.Key, name), event.down)
                return (self._typing or self._unsure > 0) and event.down
            case Text(text=text):
                io.add_input_character(ord(text))
            case Focus(on=on):
                io.add_focus_event(on)
            case _:
                pass
        return False

    def _is_over(self, x: float, y: float) -> bool:
        """Say whether a panel of the last frame covers a pixel."""
        within = any(a <= x < c and b <= y < d for a, b, c, d in self._boxes)
        return within or imgui.is_popup_open("", imgui.PopupFlags_.any_popup)

    def draw(self, app: "App", now_s: float) -> None:
        """Draw all panels into the window's framebuffer."""
        io = imgui.get_io()
        size = self._window.size_px
        io.display_size = imgui.ImVec2(*size)
        io.delta_time = min(max(now_s - self._last_s, 1e-4), LONGEST_S)
        self._last_s = now_s
        imgui.backends.opengl3_new_frame()
        imgui.new_frame()
        self._boxes = []
        unit = self._window.scale
        imgui.get_style().font_scale_dpi = unit  # it may be on another screen by now
        self._panels(app, size, unit)
        imgui.render()
        imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())
        self._typing = io.want_text_input and imgui.is_any_item_active()
        self._unsure = max(self._unsure - 1, 0)

    def _panels(self, app: "App", size: tuple[int, int], unit: float) -> None:
        """Draw what is on: the help alone, or the panels, or only a message."""
        state, (width, height) = app.state, size
        gap, bar = 12 * unit, 40 * unit
        hud_card.draw_measurement(app)
        if state.help_visible:
            self._begin("help", (width / 2, height / 2), (0, 0), height - gap, 0.5)
            hud_help.draw(app, unit)
            self._end()
        elif state.hud_visible:
            self._begin("bar", (gap, height - gap - bar), (width - 2 * gap, bar), bar)
            hud_view.bar(app, width - 2 * gap)
            self._end()
            self._columns(app, width - 2 * gap, height - 3 * gap - bar, unit)
        elif state.message:
            self._begin("message", (gap, height - gap - bar), (0, bar), bar)
            hud_view.message(app, width - 4 * gap)
            self._end()

    def _columns(self, app: "App", width: float, height: float, unit: float) -> None:
        """Draw the panels on the left and, where there is anything, on the right."""
        gap = 12 * unit
        self._begin("main", (gap, gap), (min(316 * unit, width), 0), height)
        self.tools.search(app)
        self.look.draw(app, unit)
        self.tools.draw(app)
        hud_view.draw(app, unit)
        self._end()
        if hud_card.is_needed(app):
            wide = min(330 * unit, width)
            self._begin("card", (gap + width - wide, gap), (wide, 0), height)
            hud_card.draw(app, unit)
            self._end()

    def _begin(
        self,
        name: str,
        place: tuple[float, float],
        size: tuple[float, float],
        highest: float,
        pivot: float = 0.0,
    ) -> None:
        imgui.set_next_window_pos(place, imgui.Cond_.always, (pivot, pivot))
        widest = size[0] or 1e5
        imgui.set_next_window_size_constraints((size[0], size[1]), (widest, highest))
        flags = FIXED | imgui.WindowFlags_.always_auto_resize
        if name == "bar":
            flags |= imgui.WindowFlags_.no_scrollbar
        imgui.begin(name, None, flags)

    def _end(self) -> None:
        x, y = imgui.get_window_pos()
        width, height = imgui.get_window_size()
        self._boxes.append((x, y, x + width, y + height))
        imgui.end()

    def close(self) -> None:
        """Free everything."""
        imgui.backends.opengl3_shutdown()
        imgui.destroy_context(self._context)
