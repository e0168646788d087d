# SPDX-License-Identifier: Apache-2.0
"""What a window tells: plain values, so that tests can say them too.

Positions are pixels of the picture from its top left corner, 0.5, 0.5 the middle of the
first one; keys have GLFW's names in
lower case (w, left, page_up, f11, ...).
"""

from dataclasses import dataclass
from typing import Literal

Button = Literal["left", "right", "middle"]


@dataclass(frozen=True, slots=True)
class MouseMove:
    """The cursor is at a pixel."""

    x: float
    y: float


@dataclass(frozen=True, slots=True)
class MouseButton:
    """A button went down or up at a pixel."""

    x: float
    y: float
    button: Button
    down: bool
    shift: bool = False
    t_s: float = 0.0
    """when it was heard of, to tell a double click"""
    late_s: float = 0.0
    """it may have happened so much earlier: nobody listened meanwhile"""


@dataclass(frozen=True, slots=True)
class Wheel:
    """The wheel was turned at a pixel; positive is away from the hand."""

    x: float
    y: float
    notches: float


@dataclass(frozen=True, slots=True)
class Key:
    """A key went down, is held down (`again`) or went up."""

    name: str
    down: bool
    shift: bool = False
    control: bool = False
    again: bool = False


@dataclass(frozen=True, slots=True)
class Text:
    """A character was typed."""

    text: str


@dataclass(frozen=True, slots=True)
class Focus:
    """The window got or lost the keyboard."""

    on: bool


@dataclass(frozen=True, slots=True)
class Refresh:
    """What the window shows was damaged or has another size."""


@dataclass(frozen=True, slots=True)
class Close:
    """The window is to be closed."""


Event = MouseMove | MouseButton | Wheel | Key | Text | Focus | Refresh | Close
