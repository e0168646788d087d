# SPDX-License-Identifier: Apache-2.0
"""Draw a recorded flight again with everything resident: floor, holes, film.

The replay draws the lists and poses that the flight drew, without pager, servers or
uploads in the timed part, so its frame times are the floor of the flight's own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from tiles.lanes import Lane
from viewer.flight import FrameClock, Recording, quiet_collector
from viewer.holes import ObjectHoles, hole_pixels
from viewer.session import Session

Rgb = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Replay:
    """What the replay of a flight found."""

    frame_ms: NDArray[np.float64]
    """(n,) per frame, in the flight's order"""
    hole_frames: int
    """Frames with a pixel or an object missing."""
    hole_pixels: int
    missing_objects: int


def replay(
    session: Session,
    recording: Recording,
    show: Callable[[int, Rgb], None] | None,
    progress: Callable[[int], None],
) -> Replay:
    """Draw every recorded frame again.

    Parameters
    ----------
    show : takes frame number and picture, for films
    """
    lowest_m = float(session.pager.forests[Lane.TERRAIN].records["min_height_m"].min())
    objects = ObjectHoles(session.pager.forests)
    frame_ms, pixels, missing = [], [], []
    with quiet_collector():
        for i, (view, drawn) in enumerate(zip(recording.views, recording.lists, strict=True)):
            session.hold(drawn)
            clock = FrameClock()
            session.renderer.draw(drawn, view)
            frame_ms.append(clock.frame_ms())
            pixels.append(hole_pixels(session.renderer, view, lowest_m))
            missing.append(objects.count(drawn, view))
            if show:
                show(i, session.renderer.read_rgb())
            progress(i + 1)
    holes = np.array(pixels) + np.array(missing)
    return Replay(np.array(frame_ms), int((holes > 0).sum()), sum(pixels), sum(missing))


def distinct_bytes(session: Session, lists: list[DrawList]) -> tuple[int, int]:
    """Return stored bytes and number of the distinct tiles that lists draw."""
    total = count = 0
    for lane, field in ((Lane.TERRAIN, "terrain"), (Lane.OBJECTS, "objects")):
        rows = [getattr(one, field) for one in lists]
        used = np.unique(np.concatenate(rows)) if rows else np.zeros(0, np.int32)
        records = session.pager.forests[lane].records[used]
        total += int(records["tile_bytes"].sum())
        count += len(used)
    return total, count
