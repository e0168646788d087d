# SPDX-License-Identifier: Apache-2.0
"""What an app tells its pager, and only when it is news."""

from geopage.pager import Pager
from geopage.view import ViewState
from viewer.camera import Pose, view_state
from viewer.navigation_geometry import Lens


class Told:
    """The last view and destination that the pager has heard of."""

    def __init__(self, pager: Pager) -> None:
        self._pager = pager
        self._view: ViewState | None = None
        self._end: Pose | None = None

    def view(self, view: ViewState, *, held: bool) -> bool:
        """Say where the eye is, if it is elsewhere; returns whether it is.

        Parameters
        ----------
        held : the pager goes on with the view that it has
        """
        moved = self._view is None or _look_of(view) != _look_of(self._view)
        self._view = view
        if moved and not held:
            self._pager.view(view)
        return moved

    def again(self) -> None:
        """Say at the next step where the eye is, whether it has moved or not."""
        self._view = None

    def destination(self, end: Pose | None, lens: Lens) -> None:
        """Let the pager load what is at the end of a flight in spare time."""
        if end != self._end:
            self._end = end
            there = view_state(end, lens.size_px, lens.fov_rad) if end else None
            self._pager.destination(there)


def _look_of(view: ViewState) -> tuple[bytes, bytes, int, int]:
    """Return what tells two views apart, time aside."""
    return view.eye.tobytes(), view.rotation.tobytes(), view.width_px, view.height_px
