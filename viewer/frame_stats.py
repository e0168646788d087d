# SPDX-License-Identifier: Apache-2.0
"""The figures of a drawn frame."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FrameStats:
    """What one frame drew and where its time went."""

    triangles: int
    draw_calls: int
    """Draws inside the two multi-draws."""
    tiles: int
    objects: int
    """Own objects and proxies in visible tiles."""
    fading: int
    """Draws of objects that come or go."""
    stand_ins: int
    screen_error_px: float
    """Error of the drawn terrain, mean weighted by area on the screen."""
    cull_ms: float
    gl_ms: float
    """From the first GL call to the end of the last, including the GPU's work."""
    gil_ms: float
    """From the end of GL's work until Python ran again."""
    frame_ms: float
