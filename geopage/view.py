# SPDX-License-Identifier: Apache-2.0
"""One view of the world: where the eye is, how it is turned, how sharp it sees."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Ecef


@dataclass(frozen=True, slots=True)
class ViewState:
    """An immutable pose; only the newest one matters."""

    t_s: float
    """Time of the pose on the flight's clock."""
    eye: Ecef
    """(3,) float64"""
    rotation: NDArray[np.float64]
    """(3, 3) rows right, up, backward in ECEF axes: camera = rotation @ (point - eye)"""
    focal_px: float
    """height_px / (2 tan(fov_y / 2)): pixels per radian on the axis"""
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        # Kernels would look for the cell of a place that is none. The sum of numbers is
        # finite only where all of them are.
        whole = self.t_s + self.focal_px + self.eye.sum() + self.rotation.sum()
        if not math.isfinite(whole):
            raise ValueError("view: expected finite numbers")

    @property
    def forward(self) -> NDArray[np.float64]:
        """(3,) unit vector along the view axis."""
        return np.asarray(-self.rotation[2])

    @property
    def corner_cos(self) -> float:
        """Cosine of the angle between the view axis and a corner of the picture."""
        half_px = float(np.hypot(self.width_px, self.height_px)) / 2
        return float(self.focal_px / np.hypot(self.focal_px, half_px))
