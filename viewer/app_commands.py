# SPDX-License-Identifier: Apache-2.0
"""What keys do: one table, from which the on-screen help is made too."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from viewer.app import App

HELD = {
    "w": "forward",
    "s": "back",
    "a": "left",
    "d": "right",
    "up": "forward",
    "down": "back",
    "left": "left",
    "right": "right",
    "page_up": "up",
    "page_down": "down",
    "e": "up",
    "c": "down",
    "j": "turn_left",
    "l": "turn_right",
    "i": "look_up",
    "k": "look_down",
}
"""Keys that fly while they are held, and the `navigation.WAYS` that they fly."""
MOUSE_HELP = (
    ("drag", "turn the globe: what you grab stays under the cursor"),
    ("wheel", "zoom to the cursor"),
    ("right drag", "tilt and turn around the point in view (or Ctrl + drag)"),
    ("double click", "fly there"),
    ("click", "what is this? Buildings show their attributes"),
)
HELD_HELP = (
    ("W A S D, arrows", "fly; with Shift faster"),
    ("E / C, Page up / down", "rise and sink"),
    ("I J K L", "look around"),
)


@dataclass(frozen=True, slots=True)
class Command:
    """Something that one key does once."""

    keys: tuple[str, ...]
    label: str
    """the keys as people read them"""
    help: str
    act: Callable[["App"], None]
    repeats: bool = False
    """again and again while the key is down"""


TAB = "Tab shows the panels again"


def _toggle_hud(app: "App") -> None:
    app.state.hud_visible = not app.state.hud_visible
    if app.state.hud_visible:
        app.state.unsay(TAB)
    else:
        app.say(TAB)


def _toggle_help(app: "App") -> None:
    app.state.help_visible = not app.state.help_visible


def _zoom(app: "App", notches: float) -> None:
    width, height = app.navigator.lens.size_px
    app.replayer.stop()
    app.navigator.wheel(width // 2 + 0.5, height // 2 + 0.5, notches)


def _nearer(app: "App") -> None:
    _zoom(app, 1.0)


def _farther(app: "App") -> None:
    _zoom(app, -1.0)


def _toggle_frozen(app: "App") -> None:
    app.do.freeze(on=not app.state.frozen)


def _toggle_wireframe(app: "App") -> None:
    shown = app.state.overlay
    app.state.overlay = replace(shown, wireframe=not shown.wireframe)


def _quit(app: "App") -> None:
    app.state.closing = True


def _escape(app: "App") -> None:
    """End what is on top, or else close the window."""
    state = app.state
    if state.help_visible:
        state.help_visible = False
    elif app.search.hits or app.search.message:
        app.search.ask("")
    elif state.measuring:
        app.do.measure(on=False)
    elif state.picked:
        app.do.unpick()
    elif app.replayer.on:
        app.replayer.stop()
    elif app.recorder.on:
        app.do.record()
    elif app.window.is_fullscreen:
        app.window.toggle_fullscreen()
    else:
        state.closing = True


COMMANDS = (
    Command(("equal", "kp_add"), "+", "nearer", _nearer, repeats=True),
    Command(("minus", "kp_subtract"), "-", "farther", _farther, repeats=True),
    Command(("n",), "N", "north up", lambda app: app.navigator.face(0.0)),
    Command(
        ("r",), "R", "back to the start", lambda app: app.do.fly_to(app.navigator.home)
    ),
    Command(("f", "f11"), "F", "full screen", lambda app: app.window.toggle_fullscreen()),
    Command(("h", "f1"), "H or F1", "this help", _toggle_help),
    Command(("tab",), "Tab", "hide or show the panels", _toggle_hud),
    Command(("p",), "P", "save a picture", lambda app: app.do.take_picture()),
    Command(("m",), "M", "measure between two clicks", lambda app: app.do.measure()),
    Command(("b",), "B", "bookmark this view", lambda app: app.do.add_bookmark()),
    Command(("v",), "V", "record a tour; again to save it", lambda app: app.do.record()),
    Command(("x",), "X", "freeze what is selected, and look around", _toggle_frozen),
    Command(("g",), "G", "triangles", _toggle_wireframe),
    Command(("q",), "Q or Esc", "quit", _quit),
    Command(("escape",), "", "", _escape),
)
BY_KEY = {key: command for command in COMMANDS for key in command.keys}


def keys_text() -> str:
    """Return what mouse and keys do, a line each."""
    named = tuple((one.label, one.help) for one in COMMANDS if one.help)
    return "\n".join(f"  {keys:<24}{what}" for keys, what in MOUSE_HELP + HELD_HELP + named)
