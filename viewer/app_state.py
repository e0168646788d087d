# SPDX-License-Identifier: Apache-2.0
"""What a person has chosen and sees beside the picture; no drawing, no window."""

from collections import deque
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from tiles.frames import Ecef
from viewer.bookmarks import Bookmark
from viewer.overlay import OFF, Overlay

Json = dict[str, Any]
GRAPH_FRAMES = 180
MESSAGE_S = 6.0
FRAME_MS = 1000 / 60
"""What the budget line of the graph is at, where no rate was asked for."""


@dataclass(slots=True)
class AppState:
    """Everything that keys, mouse and HUD change."""

    threshold_px: float
    object_threshold_px: float | None = None
    fps: float | None = None
    policy: str = "benefit"
    style: str = ""
    """name of the field that colours the buildings, or empty"""
    frozen: bool = False
    """what is drawn stays selected for the view at which it was frozen"""
    hud_visible: bool = True
    help_visible: bool = False
    overlay: Overlay = OFF
    utc: datetime | None = None
    """of the sun; None: it stands where the relief is best seen"""
    picked: Json | None = None
    """what the last click was on, as `viewer.pick.pick` says it"""
    measuring: bool = False
    points: list[Ecef] = field(default_factory=list)
    """of the measurement, none to two"""
    bookmarks: list[Bookmark] = field(default_factory=list)
    shot_scale: int = 2
    """a picture is so many times as wide as the window"""
    out: Path = Path()
    """where pictures and tours go"""
    closing: bool = False
    message: str = ""
    frame_ms: deque[float] = field(default_factory=lambda: deque(maxlen=GRAPH_FRAMES))
    _message_s: float = 0.0
    _message_ends_s: float | None = None

    @property
    def budget_ms(self) -> float:
        """The time that a frame may take."""
        return 1000 / self.fps if self.fps else FRAME_MS

    def say(self, message: str, for_s: float = MESSAGE_S) -> None:
        """Show a line for a while, from the next step on: this one may take seconds."""
        self.message, self._message_s, self._message_ends_s = message, for_s, None

    def unsay(self, message: str) -> None:
        """Let a line go at the next step, if it is shown."""
        if self.message == message:
            self._message_ends_s = 0.0

    def forget(self, now_s: float) -> bool:
        """Take the line away when it was long enough there; says whether it did."""
        if self._message_ends_s is None:
            self._message_ends_s = now_s + self._message_s
        if not self.message or now_s < self._message_ends_s:
            return False
        self.message = ""
        return True
