# SPDX-License-Identifier: Apache-2.0
"""When a view needs more memory than there is, its thresholds rise, smoothly.

The factor goes up while the needed tiles take more than `FULL` of the room, and down
again when they would still fit after the step. Between the two nothing moves; and a
view that made it rise does not make it fall, so that a static view comes to rest.
"""

from geopage.handoff import same_pose
from geopage.view import ViewState

FULL = 0.8
STEP = 1.05
MOST = 256.0
GROWTH = STEP**-4
"""The needed tiles grow by no more than this, as a rule, in one step down: by the square
of the step, and something for whole tiles. Less, and thresholds go to and fro."""


class MemoryPressure:
    """The factor on both thresholds. Thread: scene manager."""

    def __init__(self, room_bytes: int) -> None:
        self.room_bytes = room_bytes
        self.factor = 1.0
        self._raised_for: ViewState | None = None

    def update(self, needed_bytes: int, view: ViewState) -> bool:
        """Adjust to what a view needs at the present factor; say whether it changed."""
        before = self.factor
        if needed_bytes > FULL * self.room_bytes:
            self.factor = min(self.factor * STEP, MOST)
            self._raised_for = view
        elif needed_bytes < FULL * self.room_bytes * GROWTH and self._may_fall(view):
            self.factor = max(self.factor / STEP, 1.0)
        return self.factor != before

    def try_again(self) -> None:
        """Let the factor fall for any view: what is asked for has changed."""
        self._raised_for = None

    def _may_fall(self, view: ViewState) -> bool:
        return self._raised_for is None or not same_pose(self._raised_for, view)

    @property
    def message(self) -> str:
        """One line for the user while thresholds are raised, else empty."""
        if self.factor == 1.0:
            return ""
        return f"memory is short: thresholds are {self.factor:.2f} times as large"
