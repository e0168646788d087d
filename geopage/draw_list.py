# SPDX-License-Identifier: Apache-2.0
"""The immutable content of one frame, free of any pose.

Rows are rows of the lane's `Forest`. A list stays right for a while as the eye turns
and moves: it is coarse in all directions and fine in a cone around the view axis; the
renderer culls it with its own newest pose.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geopage.screen_error import STILL, Sweep
from geopage.view import ViewState


@dataclass(frozen=True, slots=True)
class Fade:
    """When each entry of a list's `objects` comes and goes, on the flight's clock."""

    since_s: NDArray[np.float64]
    """(m,) -inf: long ago"""
    until_s: NDArray[np.float64]
    """(m,) inf: the list's own selection has it"""
    seconds: float
    """How long it takes to come, and to go."""

    @property
    def is_over(self) -> bool:
        """Whether every pixel shows every entry."""
        return not np.isfinite((self.since_s, self.until_s)).any()

    def shares(self, t_s: float) -> NDArray[np.float32]:
        """Return which part of the screen's pattern, 0 to 1, shows each entry.

        Returns
        -------
        shares : (m, 2) from and to; those of parts that replace each other join exactly
        """
        ages = (t_s - np.stack((self.until_s, self.since_s), axis=1)) / self.seconds
        return np.clip(ages, 0.0, 1.0).astype(np.float32)


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
    """(m,) forest rows of object tiles; while something fades, a row can be there again"""
    own: NDArray[np.bool_]
    """(m,) draw the cell's own objects above the object threshold"""
    proxies: NDArray[np.uint8]
    """(m,) bit k: draw the proxy that stands for child k"""
    threshold_px: float
    """Largest screen error that this list was made for (raised when memory is short)."""
    object_threshold_px: float
    settled: bool
    """Nothing was wanted now that was not uploaded; see `Pager.complete`."""
    sweep: Sweep = STILL
    """How the view moved: with a shutter, what moves fast was selected with less detail."""
    fade: Fade | None = None
    """None: every entry of `objects` is drawn at every pixel."""
    rung: NDArray[np.uint8] | None = None
    """(n,) which of a terrain tile's meshes is drawn; None: the whole ones"""

    def rungs(self) -> NDArray[np.uint8]:
        """Return `rung`, (n,); 0 is a whole mesh."""
        return np.zeros(len(self.terrain), np.uint8) if self.rung is None else self.rung

    def shares(self, t_s: float) -> NDArray[np.float32]:
        """Return `Fade.shares`, (m, 2), or (0, 2) when nothing fades."""
        return self.fade.shares(t_s) if self.fade else np.zeros((0, 2), np.float32)

    def solid(self) -> "DrawList":
        """Return the list as it is when the fades are over."""
        if self.fade is None:
            return self
        stay = np.isinf(self.fade.until_s)
        objects, own, proxies = self.objects[stay], self.own[stay], self.proxies[stay]
        return replace(self, objects=objects, own=own, proxies=proxies, fade=None)
