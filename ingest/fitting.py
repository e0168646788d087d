# SPDX-License-Identifier: Apache-2.0
"""A cell's mesh, refined, measured and mended until it is within its bound.

Insertion sees the places that a cell is made of; what is found too far elsewhere
(another post, or a line between posts) becomes a place, and the mesh is refined on.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import window_in
from ingest.deviation import Gaps
from ingest.terrain_mesh import Meshing, Places, Surface, at_pole, snapped
from ingest.truth import Truth, points_at
from tiles.frames import Floats
from tiles.mesh import UV_ONE

ROUNDS = 16
"""Most rounds of mending"""
BESIDE = 1 / 64
"""Fraction of a cell within which a place is beside its edge"""
NEARLY_ALL = 0.75
"""A leaf that needs more of its posts than this takes all: then nothing is missed."""
Fitted = tuple[Surface, float]
"""A surface and its largest distance from what its cell stands for, m"""


def fitted(
    cell: int,
    places: Places,
    bound_m: float,
    truths: Sequence[Truth],
    *,
    leaf: bool,
    begun: "Fitting | None" = None,
) -> Fitted:
    """Mesh a cell so that all it stands for is within a bound, and measure it.

    Parameters
    ----------
    truths : of all leaves in the cell
    leaf : every post of the truths is among the places; errors are measured along the
        vertical, so that a height read from the mesh is off by no more
    begun : a coarser mesh of the same, to go on with

    Returns
    -------
    surface : of the round that came closest
    error_m : its largest distance from the truths
    """
    fitting = begun or Fitting(cell, places, truths, leaf=leaf)
    if leaf and not begun and fitting.roughness(bound_m) > NEARLY_ALL:
        fitting.take_all()
    best = fitting.within(bound_m, ROUNDS)
    if leaf and best[1] > fitting.goal_m(bound_m) + fitting.slack_m and not at_pole(cell):
        whole = Fitting(cell, places, truths, leaf=leaf)
        whole.take_all()
        best = min(best, whole.within(bound_m, ROUNDS), key=_error)
    return best


class Fitting:
    """A cell's mesh while it is fitted to what the cell stands for."""

    def __init__(
        self, cell: int, places: Places, truths: Sequence[Truth], *, leaf: bool
    ) -> None:
        self._cell, self._leaf = cell, leaf
        self._meshing = Meshing(cell, places, upright=leaf)
        self._truths = truths
        self._gaps: Gaps | None = None
        self._closes = leaf and len(truths) == 1 and not at_pole(cell)
        self._windows = [window_in(cell, one.cell) for one in truths]
        self.slack_m = max(truth.slack_m for truth in truths)
        # A finer mesh cures nothing of what a leaf's posts miss, and a cell above has room.
        self._unknown_m = max(one.slack_m - leaf * one.missed_m for one in truths)

    def goal_m(self, bound_m: float) -> float:
        """Return how close posts must be: closer than half of what is unknown is wasted."""
        return max(bound_m - self._unknown_m, bound_m / 2, self._unknown_m / 2)

    def roughness(self, bound_m: float) -> float:
        """Return the share of a leaf's posts that are too far from between others."""
        if len(self._truths) > 1:
            return 0.0
        posts, goal_m = self._truths[0].points, self.goal_m(bound_m)
        east = posts[1:-1, 1:-1] - (posts[1:-1, 2:] + posts[1:-1, :-2]) / 2
        north = posts[1:-1, 1:-1] - (posts[2:, 1:-1] + posts[:-2, 1:-1]) / 2
        squared = (np.einsum("rck,rck->rc", one, one) for one in (east, north))
        return float((np.maximum(*squared) > goal_m**2).mean())

    def take_all(self) -> None:
        """Insert all places."""
        self._meshing.refine_wholly()
        self._closes = False  # hardly anything is left to find

    def within(self, bound_m: float, rounds: int) -> Fitted:
        """Mesh, measure and mend until the bound is kept, or after some rounds."""
        goal_m = self.goal_m(bound_m)
        best = self._refined(goal_m)
        for _ in range(rounds):
            if best[1] <= bound_m or not self._add_too_far(goal_m):
                break
            best = min(best, self._refined(goal_m), key=_error)
        return best

    def roughly(self, bound_m: float, rounds: int) -> Fitted:
        """Do the same for less: what insertion knows of edges is not measured again."""
        kept_m = self._insert(self.goal_m(bound_m))
        if kept_m == np.inf:
            return self.within(bound_m, rounds)
        surface = self._meshing.surface()
        gaps = Gaps.begin(surface)
        whole, truth = replace(surface, fresh=np.ones_like(surface.fresh)), self._truths[0]
        gaps.add(whole, self._windows[0], truth, upright=self._leaf, edges=False)
        self._gaps = None
        return surface, max(gaps.largest_m, kept_m + truth.slack_m)

    def _insert(self, goal_m: float) -> float:
        """Insert places; returns an error that is kept between them, m, if it knows."""
        if not self._closes:
            self._meshing.refine(goal_m)
            return np.inf
        one = self._truths[0]
        return self._meshing.close(goal_m, one.points, one.grid, one.centre)

    def _refined(self, goal_m: float) -> Fitted:
        """Insert places, and measure what has changed."""
        self._insert(goal_m)
        surface = self._meshing.surface()
        if self._gaps is None:
            surface.fresh[:] = True
        self._gaps = Gaps.begin(surface, self._gaps)
        for number, truth in enumerate(self._truths):
            window = self._windows[number]
            self._gaps.add(surface, window, truth, number, upright=self._leaf)
        return surface, self._gaps.largest_m

    def _add_too_far(self, goal_m: float) -> bool:
        """Add the place where each triangle is furthest from the truths, if it is too far.

        Beside the cell's edge the place on the edge becomes a vertex too, or ever thinner
        triangles would creep up to it. False when there is no room for more.
        """
        gaps = self._gaps
        assert gaps
        slack_m = np.array([one.slack_m for one in self._truths])
        far = gaps.far_m - slack_m[gaps.which] > goal_m
        at, points, near = [], [], []
        for k in np.unique(gaps.which[far]).tolist():
            truth, mine = self._truths[k], np.flatnonzero(far & (gaps.which == k))
            uv, beside = gaps.uv[mine], np.flatnonzero(is_beside_rim(gaps.uv[mine]))
            at.append(snapped(np.concatenate([uv, on_rim(uv[beside])])))
            near.append(np.concatenate([mine, mine[beside]]))
            window = self._windows[k]
            there = points_at(truth, (at[-1] / UV_ONE - window[:2]) / window[2])
            points.append(there + truth.centre)
        if not at:
            return False
        found = np.concatenate(at), np.concatenate(points), np.concatenate(near)
        return self._meshing.add(*found)


def _error(result: Fitted) -> float:
    return result[1]


def is_beside_rim(uv: Floats) -> NDArray[np.bool_]:
    """Say which places, (n, 2), are near the cell's edge."""
    return np.asarray(((uv < BESIDE) | (uv > 1 - BESIDE)).any(axis=1))


def on_rim(uv: Floats) -> Floats:
    """Return the places on the cell's edges beside places near them, (n, 2)."""
    return np.asarray(np.where((uv < BESIDE) | (uv > 1 - BESIDE), np.round(uv), uv))
