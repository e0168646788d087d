# SPDX-License-Identifier: Apache-2.0
"""One settled picture as a file."""

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from geopage.settings import PagerSettings
from tiles.errors import InputError
from viewer.camera import Pose, view_state
from viewer.pick import pick, require_pixel
from viewer.picture import write_png
from viewer.session import Picture, Session

SUPERSAMPLE = 2
LARGEST = 8192


def render_still(
    store: Path, settings: PagerSettings, given: argparse.Namespace
) -> dict[str, Any]:
    """Draw what `geopage render` asks for and write it.

    Raises
    ------
    InputError
    """
    lat, lon, height_m = given.at
    lon_rad, lat_rad = math.radians(lon), math.radians(lat)
    if given.pick:
        require_pixel(given.pick, given.size)
    with Session(store, settings, finer(given.size), given.style) as session:
        if given.height_reference == "ground":
            height_m += session.surface.height_at(lon_rad, lat_rad)
        heading, pitch = (math.radians(angle) for angle in given.look)
        pose = Pose(lon_rad, lat_rad, height_m, heading, pitch)
        view = view_state(pose, given.size, math.radians(given.fov))
        drawn, stats = session.settle(view)
        write_png(given.out, session.renderer.read_rgb())
        if given.positions:
            save_points(given.positions, session.renderer.read_positions())
        extra = {"pick": pick(session, drawn, given.pick)} if given.pick else {}
        if session.styling:
            extra["style"] = session.styling.legend
        faults = list(session.pager.faults)
    return {
        "out": str(given.out),
        "eye_height_m": height_m,
        "terrain_tiles": len(drawn.terrain),
        "triangles": stats.triangles,
        "objects": stats.objects,
        "screen_error_px": stats.screen_error_px,
        "frame_ms": stats.frame_ms,
        "faults": faults,
        **extra,
    }


def finer(size_px: tuple[int, int]) -> Picture:
    """Return a picture drawn at twice its size, where GPUs can."""
    fits = max(size_px) * SUPERSAMPLE <= LARGEST
    return Picture(size_px, SUPERSAMPLE if fits else 1)


def save_points(path: Path, points: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Write drawn points, (h, w, 3) float64 ECEF m, NaN where sky.

    Raises
    ------
    InputError
    """
    try:
        with path.open("wb") as file:
            np.save(file, points)
    except OSError as error:
        reason = str(error.strerror or error)
        raise InputError(path, reason, "name a file in a folder that exists") from error
