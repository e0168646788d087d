# SPDX-License-Identifier: Apache-2.0
"""What an app asks of its panels; there are none where their library is missing."""

from typing import TYPE_CHECKING, Protocol

from viewer.events import Event
from viewer.hud_text import length_text, place_text

if TYPE_CHECKING:
    from viewer.app import App


class Hud(Protocol):
    """Panels over the picture."""

    def take(self, events: list[Event]) -> list[Event]:
        """Take what concerns the panels; returns the other events."""

    def draw(self, app: "App", now_s: float) -> None:
        """Draw the panels into the window, and do what a person does with them."""

    def close(self) -> None:
        """Free everything."""


def title_of(app: "App") -> str:
    """Return what the window's frame says where there are no panels."""
    pose = app.navigator.pose
    place = place_text(pose.lon_rad, pose.lat_rad), length_text(pose.height_m)
    return app.state.message or ", ".join(place)
