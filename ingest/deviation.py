# SPDX-License-Identifier: Apache-2.0
"""How far a drawn surface is from the posts that it stands for: measured, in ECEF.

Two piecewise linear surfaces differ most at a vertex of their overlay: at the mesh's
vertices, at the posts, or where an edge of the mesh crosses a line between posts. All are
visited. There a leaf's height is compared with the true one. Of an inner cell, the shortest
distance of the true point from the mesh counts, and where an edge crosses also that of the
drawn point from the plane of the true triangle. On the rim, where neighbours must meet, it
is the distance of the two points with the same longitude and latitude.

Looked at wider, a true point may be near another drawn triangle, and a drawn point near
another true one: so it is at a pole, and where a triangle passes beneath a cliff.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ingest.deviation_kernels import add
from ingest.pole import at_pole
from ingest.terrain_mesh import Surface
from ingest.truth import Truth
from tiles.frames import Floats

Window = tuple[float, float, float]
"""u, v and size of a leaf in a surface's cell, fractions of it"""


@dataclass(frozen=True, slots=True)
class Gaps:
    """How far every triangle of a surface is from what was measured so far."""

    far_m: Floats
    """(t,) with what lies between a truth's posts"""
    uv: Floats
    """(t, 2) where, in fractions of the surface's cell"""
    which: NDArray[np.int64]
    """(t,) number of the truth"""

    @classmethod
    def begin(cls, surface: Surface, before: Self | None = None) -> Self:
        """Start with what is known of triangles that an older surface has too."""
        count = len(surface.triangles)
        gaps = cls(np.zeros(count), np.zeros((count, 2)), np.zeros(count, np.int64))
        if before:
            known = np.flatnonzero(~surface.fresh)
            gaps.far_m[known] = before.far_m[known]
            gaps.uv[known], gaps.which[known] = before.uv[known], before.which[known]
        return gaps

    @property
    def largest_m(self) -> float:
        """Return the largest distance."""
        return float(self.far_m.max(initial=0.0))

    def add(
        self,
        surface: Surface,
        window: Window,
        truth: Truth,
        number: int = 0,
        *,
        upright: bool = False,
        edges: bool = True,
        wide: bool = False,
    ) -> None:
        """Measure a surface's fresh triangles against the truth of a leaf in its cell.

        Parameters
        ----------
        upright : measure along the vertical instead of the shortest way
        edges : measure along edges too, not only at posts
        wide : look for the shortest way at the triangles around, too
        """
        wide = wide or at_pole(surface.cell)
        across = surface.across if wide else surface.nowhere
        ways = surface.triangles, surface.on_rim, across
        drawn = surface.points, surface.uv, *ways, surface.centre
        true = truth.points, truth.uv, truth.grid, truth.centre, truth.slack_m
        known = self.far_m, self.uv, self.which
        add(known, surface.fresh, drawn, true, window, (number, upright, edges))
