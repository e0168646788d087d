# SPDX-License-Identifier: Apache-2.0
"""The immutable content of one frame, free of any pose.

Rows are rows of the lane's `Forest`. A list stays right for a while as the eye turns
and moves: it is coarse in all directions and fine in a cone around the view axis; the
renderer culls it with its own newest pose.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.view import ViewState


@dataclass(frozen=True, slots=True)
class DrawList:
    """What to draw until the next list comes."""

    number: int
    """Counts up; 0 is the empty list before the first selection."""
    view: ViewState
    """The view that it was made for; its age is measured, its pose is not drawn."""
    terrain: NDArray[np.int32]
    """(n,) forest rows; together they cover the globe, and none covers another"""
    skirt_m: NDArray[np.float32]
    """(n,) depth of each tile's skirt: own error plus the coarsest drawn neighbour's"""
    stand_in: NDArray[np.bool_]
    """(n,) coarser than wanted, drawn until the wanted tile is uploaded"""
    objects: NDArray[np.int32]
    """(m,) forest rows of object tiles"""
    own: NDArray[np.bool_]
    """(m,) draw the cell's own objects above the object threshold"""
    proxies: NDArray[np.uint8]
    """(m,) bit k: draw the proxy that stands for child k"""
    threshold_px: float
    """Largest screen error that this list was made for (raised when memory is short)."""
    object_threshold_px: float
    settled: bool
    """Nothing was wanted that was not uploaded, and nothing was in flight."""
