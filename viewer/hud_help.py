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


def draw(app: "App") -> None:
    """Draw the help's content."""
    columns = (
        ("Mouse", MOUSE_HELP),
        ("Keys", HELD_HELP + tuple((c.label, c.help) for c in COMMANDS if c.help)),
        ("Panels (Tab)", PANEL_HELP),
    )
    for title, rows in columns:
        text_in(ACCENT, title)
        if imgui.begin_table(title, 2, imgui.TableFlags_.sizing_fixed_fit):
            for keys, meaning in rows:
                imgui.table_next_row()
                imgui.table_next_column()
                imgui.text_unformatted(keys)
                imgui.table_next_column()
                imgui.text_disabled(meaning)
            imgui.end_table()
        imgui.spacing()
    if imgui.button("Close"):
        app.state.help_visible = False
