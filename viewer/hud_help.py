# SPDX-License-Identifier: Apache-2.0
"""The on-screen help, made from the tables that the keys are read from."""

from typing import TYPE_CHECKING

from imgui_bundle import imgui

from viewer.app_commands import COMMANDS, HELD_HELP, MOUSE_HELP
from viewer.hud_style import ACCENT, text_in

if TYPE_CHECKING:
    from viewer.app import App

PANEL_HELP = (
    ("Find", "a place (47.37, 8.54), a name, or a condition (height>100)"),
    ("Detail", "how fine things are drawn, and what that costs"),
    ("Look", "time of day; buildings coloured by an attribute"),
    ("Tools", "measure, save pictures; record a tour, then replay or film it"),
    ("Bookmarks", "views to come back to"),
)


def draw(app: "App", unit: float) -> None:
    """Draw the help's content: mouse and panels on the left, keys on the right."""
    keys = HELD_HELP + tuple((one.label, one.help) for one in COMMANDS if one.help)
    imgui.begin_group()
    _table("Mouse", MOUSE_HELP, 96 * unit)
    imgui.spacing()
    _table("Panels (Tab)", PANEL_HELP, 96 * unit)
    imgui.end_group()
    imgui.same_line(0, 32 * unit)
    imgui.begin_group()
    _table("Keys", keys, 150 * unit)
    imgui.end_group()
    if imgui.button("Close (H)"):
        app.state.help_visible = False


def _table(title: str, rows: tuple[tuple[str, str], ...], column: float) -> None:
    text_in(ACCENT, title)
    for keys, meaning in rows:
        imgui.text_unformatted(keys)
        imgui.same_line(column)  # from where the group begins
        imgui.text_disabled(meaning)
