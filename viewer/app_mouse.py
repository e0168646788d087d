# SPDX-License-Identifier: Apache-2.0
"""Tells clicks, double clicks and drags apart."""

import math

from viewer.events import MouseButton, MouseMove

CLICK_PX, CLICK_S = 5.0, 1.0
DOUBLE_PX, DOUBLE_S = 8.0, 0.6


class Clicks:
    """Turns presses and releases of the left button into clicks.

    Frames may take longer than the time between two clicks: the time in which nobody
    listened does not count.
    """

    def __init__(self) -> None:
        self._down: MouseButton | None = None
        self._last: MouseButton | None = None

    def moved(self, event: MouseMove) -> None:
        """Take a drag for no click."""
        if self._down and _away_px(self._down, event) > CLICK_PX:
            self._down = None

    def pressed(self, event: MouseButton) -> bool:
        """Note a press, and say whether it is the second one of a double click."""
        last, self._last, self._down = self._last, event, event
        is_double = (
            last is not None
            and event.t_s - event.late_s - last.t_s < DOUBLE_S
            and _away_px(last, event) < DOUBLE_PX
        )
        if is_double:
            self._last = self._down = None
        return is_double

    def released(self, event: MouseButton) -> bool:
        """Say whether a release ends a click."""
        down, self._down = self._down, None
        return (
            down is not None
            and event.t_s - event.late_s - down.t_s < CLICK_S
            and _away_px(down, event) <= CLICK_PX
        )


def _away_px(a: MouseButton, b: MouseButton | MouseMove) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)
