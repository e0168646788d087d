# SPDX-License-Identifier: Apache-2.0
"""How far a drawn surface is from the posts that it stands for: measured, in ECEF.

Two piecewise linear surfaces differ most at a vertex of their overlay: at the mesh's
vertices, at the posts, or where an edge of the mesh crosses a line between posts. All are
visited. There a leaf's height is compared with the true one. Of an inner cell, the shortest
distance of the true point from the mesh counts, and where an edge crosses also that of the
drawn point from the plane of the true triangle. On the rim, where neighbours must meet, it
is the distance of the two points with the same longitude and latitude.
"""

from dataclasses import dataclass

import numpy as np

from ingest.deviation_kernels import framed, measure, only_in
from ingest.distance import Found, Mesh, Posts
from ingest.terrain_mesh import Surface
from ingest.truth import Truth
from tiles.frames import Floats
from tiles.mesh import UV_ONE


@dataclass(frozen=True, slots=True)
class Deviation:
    """Of every triangle of a surface, from one truth."""

    squared: Floats
    """(t,) m2"""
    uv: Floats
    """(t, 2) where, in fractions of the surface's cell"""
    truth: Truth

    @property
    def largest_m(self) -> float:
        """Return the largest distance, with what lies between the truth's posts."""
        return float(np.sqrt(self.squared.max(initial=0.0))) + self.truth.slack_m


def deviation_of(
    surface: Surface,
    window: tuple[float, float, float],
    truth: Truth,
    before: "Deviation | None" = None,
    *,
    upright: bool = False,
    least_m: float = 0.0,
) -> Deviation:
    """Measure a surface against the truth of a leaf in its cell.

    Parameters
    ----------
    window : (u, v, size) of the leaf in the surface's cell, fractions of it
    before : what was found for the surface before this one; triangles that they share
        are not measured again
    upright : measure along the vertical instead of the shortest way
    least_m : shorter distances need not be found; they are said to be as long
    """
    low, size, count = np.array(window[:2]), window[2], len(surface.triangles)
    least = max(least_m - truth.slack_m, 0.0) ** 2
    found = Found(np.full(count, least), np.zeros((count, 2)))
    todo = surface.fresh.copy() if before else np.ones(count, np.bool_)
    meets = only_in(todo, surface.uv, surface.triangles, window)
    if before:
        known = np.flatnonzero(~surface.fresh)
        found.squared[known], found.uv[known] = before.squared[known], before.uv[known]
        if not meets:
            return Deviation(found.squared, found.uv, truth)
        found.uv[known] = (found.uv[known] - low) / size
    offset = surface.centre - truth.centre
    points, at, xy = framed(surface.points, surface.uv, offset, window, truth.grid)
    rim = ((surface.at == 0) | (surface.at == UV_ONE)).any(axis=1)
    x, y, z = (float(one) * upright for one in truth.centre)
    mesh = Mesh(points, at, xy, surface.triangles, rim, surface.across, (x, y, z))
    bend = 0.05 + float(np.abs(truth.grid[:, 3:]).sum())
    measure(mesh, Posts(truth.points, truth.uv, truth.grid, bend), todo, found)
    return Deviation(found.squared, low + found.uv * size, truth)
