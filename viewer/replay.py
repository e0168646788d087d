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
from viewer.pixel_error import pixel_error
from viewer.session import Session

Rgb = NDArray[np.uint8]
COARSE = 4
"""The screen error is looked at in every fourth pixel of every fourth line."""


@dataclass(frozen=True, slots=True)
class Replay:
    """What the replays of a flight found."""

    frame_ms: NDArray[np.float64]
    """(n,) per frame, in the flight's order"""
    screen_error_px: NDArray[np.float64]
    """(n,) mean over a frame's terrain pixels"""
    kept: NDArray[np.float64]
    """(n,) share of them within the threshold or at a leaf"""
    hole_frames: int
    """Frames with a pixel or an object missing."""
    hole_pixels: int
    missing_objects: int


def time_again(
    session: Session, recording: Recording, progress: Callable[[int], None]
) -> NDArray[np.float64]:
    """Draw every recorded frame with its tiles resident, and time only that: the floor."""
    frame_ms = []
    with quiet_collector():
        for i, (view, drawn) in enumerate(
            zip(recording.views, recording.lists, strict=True)
        ):
            session.hold(drawn)
            clock = FrameClock()
            session.renderer.draw(drawn, view)
            frame_ms.append(clock.frame_ms())
            progress(i + 1)
    return np.array(frame_ms)


def look_again(
    session: Session,
    recording: Recording,
    frame_ms: NDArray[np.float64],
    show: Callable[[int, Rgb], None] | None,
    progress: Callable[[int], None],
) -> Replay:
    """Draw every recorded frame and count what is missing and how wrong it may be.

    Parameters
    ----------
    show : takes frame number and picture, for films
    """
    forest = session.pager.forests[Lane.TERRAIN]
    lowest_m = float(forest.records["min_height_m"].min())
    objects = ObjectHoles(session.pager.forests)
    pixels, missing, errors = [], [], []
    for i, (view, drawn) in enumerate(zip(recording.views, recording.lists, strict=True)):
        session.hold(drawn)
        session.renderer.draw(drawn, view)
        pixels.append(hole_pixels(session.renderer, view, lowest_m))
        missing.append(objects.count(drawn, view))
        if show:
            show(i, session.renderer.read_rgb())
        errors.append(
            pixel_error(forest, drawn, view, *session.renderer.read_coarse(COARSE))
        )
        progress(i + 1)
    return Replay(
        frame_ms,
        np.array([error.mean_px for error in errors]),
        np.array([error.kept for error in errors]),
        int((np.array(pixels) + np.array(missing) > 0).sum()),
        sum(pixels),
        sum(missing),
    )


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
