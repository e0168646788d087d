# SPDX-License-Identifier: Apache-2.0
"""A spot with detail, how to look at it, and how fast its tiles come."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geopage.settings import MIB, Throttle
from geopage.view import ViewState
from tiles.lanes import Lane
from tiles.store import Store
from viewer.camera import Pose, view_state
from viewer.flight import FRAME_S

SIZE_PX = (1280, 720)
DOWN_RAD = -math.pi / 2


@dataclass(frozen=True, slots=True)
class Site:
    """A spot with detail."""

    lon_rad: float
    lat_rad: float
    ground_m: float = 0.0
    """height above the ellipsoid"""

    def view(
        self,
        above_m: float,
        pitch_rad: float = DOWN_RAD,
        east_rad: float = 0.0,
        t_s: float = 0.0,
    ) -> ViewState:
        """Return a view from above the site, or from the east of it."""
        lon, height_m = self.lon_rad + east_rad, self.ground_m + above_m
        pose = Pose(lon, self.lat_rad, height_m, 0.0, pitch_rad)
        return view_state(pose, SIZE_PX, t_s=t_s)


def tiles_a_frame(store: Path, tiles: float) -> Throttle:
    """Return a line that carries so many average tiles a frame."""
    with Store(store) as opened:
        sizes = np.concatenate([opened.index(lane)["tile_bytes"] for lane in Lane])
    return Throttle(tiles * float(sizes[sizes > 0].mean()) / FRAME_S / MIB)
