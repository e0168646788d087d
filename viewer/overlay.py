# SPDX-License-Identifier: Apache-2.0
"""What can be shown on top of a frame, for those who look at how it is made."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Overlay:
    """Which overlays are on; those that are off cost nothing."""

    wireframe: bool = False
    """Edges of all triangles."""
    bounds: bool = False
    """Edges of the drawn terrain tiles' boxes, stand-ins' in orange."""
    heat: bool = False
    """Screen error of each terrain tile against the threshold: white where they are
    equal, blue where the error is smaller (dark: an eighth or less), orange where it is
    larger (dark: eight times or more)."""
    picked: tuple[int, int] | None = None
    """Row of the objects' forest and object in its tile (`PROXY_ORDINAL`: its proxies)
    that is painted over."""


OFF = Overlay()
