# SPDX-License-Identifier: Apache-2.0
"""A camera path over a store, ready to be asked in a frame: no tile is read then."""

import numpy as np

from geopage.view import ViewState
from tiles.surface import Surface
from viewer.camera import FOV_RAD, view_state
from viewer.camera_path import CameraPath

GROUND_HZ = 60


class Flight:
    """Poses of a path at any time, with the ground's height known beforehand."""

    def __init__(
        self, path: CameraPath, surface: Surface, size_px: tuple[int, int]
    ) -> None:
        self.path, self._size_px = path, size_px
        count = max(2, int(np.ceil(path.duration_s * GROUND_HZ)) + 1)
        self._times_s = np.linspace(0.0, path.duration_s, count)
        self._ground_m = np.zeros(count)
        if path.height_reference == "ground":
            poses = [path.pose_at(t, lambda lon, lat: 0.0) for t in self._times_s.tolist()]
            lon, lat = np.array([(p.lon_rad, p.lat_rad) for p in poses]).T
            self._ground_m = surface.heights(lon, lat)[0]

    def view(self, t_s: float) -> ViewState:
        """Return the view at a time of the flight."""
        ground_m = float(np.interp(t_s, self._times_s, self._ground_m))
        pose = self.path.pose_at(t_s, lambda lon, lat: ground_m)
        return view_state(pose, self._size_px, FOV_RAD, t_s)
