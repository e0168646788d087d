# SPDX-License-Identifier: Apache-2.0
"""A cell's mesh, refined, measured and mended until it is within its bound.

Insertion sees the places that a cell is made of; what is found too far elsewhere
(another post, or a line between posts) becomes a place, and the mesh is refined on. In
the same rounds an inner cell gives up vertices that its bound does not need.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import window_in
from ingest.deviation import Gaps
from ingest.pole import at_pole
from ingest.posts import bent_share
from ingest.removal import Holes
from ingest.terrain_mesh import Meshing, Places, Surface, snapped
from ingest.truth import Truth, points_at
from tiles.frames import Floats
from tiles.mesh import UV_ONE

ROUNDS = 32
"""Most rounds of mending"""
THINNINGS = 3
"""Rounds in which vertices of an inner cell are taken out: one more takes 4 % of its
triangles away, and an eighth more time"""
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
    begun : a coarser mesh of the same, to go on with, or one of all places

    Returns
    -------
    surface : of the round that came closest
    error_m : its largest distance from the truths
    """
    fitting = begun or Fitting(cell, places, truths, leaf=leaf)
    if leaf and not begun and fitting.roughness(bound_m) > NEARLY_ALL:
        fitting.take_all()
    best = fitting.within(bound_m, ROUNDS)
    enough_m = fitting.goal_m(bound_m) + fitting.slack_m if leaf else bound_m
    # A mesh that can't be mended may be better begun anew, or with all places.
    for whole in (False, True) if begun and not leaf else (True,):
        if best[1] > enough_m:
            again = Fitting(cell, places, truths, leaf=leaf)
            if whole:
                again.take_all()
            best = min(best, again.within(bound_m, ROUNDS), key=_error)
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
        # At a pole a triangle's distances depend on those around it.
        self._thinnings = 0 if leaf or at_pole(cell) else THINNINGS
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
        return bent_share(self._truths[0].points, self.goal_m(bound_m))

    def take_all(self) -> None:
        """Insert all places."""
        self._meshing.refine_wholly()

    def within(self, bound_m: float, rounds: int) -> Fitted:
        """Mesh, measure, mend and thin until the bound is kept, or after some rounds."""
        goal_m = self.goal_m(bound_m)
        self._insert(goal_m)
        best = last = self._measured()
        error_m, settled = best[1], False
        for n in range(rounds):
            gaps = self._gaps
            if error_m > bound_m and n >= self._thinnings:
                last = self._measured() if settled else last
                gaps, settled = self._looked_wider(last[0], bound_m), False
                error_m = gaps.largest_m
                best = min(best, (last[0], error_m), key=_error)
            mends = error_m > bound_m and self._add_too_far(gaps, last[0], goal_m)
            if mends:
                self._insert(goal_m)
            holes = self._meshing.lift(goal_m) if n < self._thinnings else None
            if not (mends or holes):
                break
            before, last = self._gaps, self._measured()
            settled = bool(before and holes)
            if before and holes:
                error_m = self._settle(holes, before, bound_m)
            else:
                best, error_m = min(best, last, key=_error), last[1]
        if settled:
            last = self._measured()
        if last[1] > bound_m:
            last = last[0], self._looked_wider(last[0], bound_m).largest_m
        return last if last[1] <= bound_m else min(best, last, key=_error)

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

    def _measured(self) -> Fitted:
        """Measure what has changed."""
        surface = self._meshing.surface()
        if self._gaps is None:
            surface.fresh[:] = True
        self._gaps = Gaps.begin(surface, self._gaps)
        for number, truth in enumerate(self._truths if surface.fresh.any() else ()):
            window = self._windows[number]
            self._gaps.add(surface, window, truth, number, upright=self._leaf)
        return surface, self._gaps.largest_m

    def _looked_wider(self, surface: Surface, bound_m: float) -> Gaps:
        """Return what was measured; of an inner cell, what is beyond its bound anew.

        The shortest way may lead to another triangle than the one at the same longitude and
        latitude. It changes with those around, so it is not kept from round to round.
        """
        gaps = self._gaps
        assert gaps
        over = gaps.far_m > bound_m
        if self._leaf or at_pole(self._cell) or not over.any():
            return gaps
        wide = Gaps(np.where(over, 0.0, gaps.far_m), gaps.uv.copy(), gaps.which.copy())
        there = replace(surface, fresh=over)
        for number, truth in enumerate(self._truths):
            wide.add(there, self._windows[number], truth, number, wide=True)
        return wide

    def _settle(self, holes: Holes, before: Gaps, bound_m: float) -> float:
        """Keep those holes whose triangles are within the bound; returns the error, m."""
        gaps = self._gaps
        assert gaps
        order, back = self._meshing.settle(holes, gaps.far_m > bound_m)
        old = np.flatnonzero(back)
        gaps.far_m[old], gaps.uv[old] = before.far_m[old], before.uv[old]
        gaps.which[old] = before.which[old]
        self._gaps = Gaps(gaps.far_m[order], gaps.uv[order], gaps.which[order])
        return self._gaps.largest_m

    def _add_too_far(self, gaps: Gaps | None, surface: Surface, goal_m: float) -> bool:
        """Add the place where each triangle is furthest from the truths, if it is too far.

        Where there is a vertex already, a rounding away, the middle of the triangle's
        longest edge instead. Beside the cell's edge the place on the edge becomes a vertex
        too, or ever thinner triangles would creep up to it. False when there is no room.
        """
        assert gaps
        slack_m = np.array([one.slack_m for one in self._truths])
        far = np.flatnonzero(gaps.far_m - slack_m[gaps.which] > goal_m)
        if not len(far):
            return False
        beside = far[is_beside_rim(gaps.uv[far])]
        rim = on_rim(gaps.uv[beside])
        at = snapped(np.concatenate([gaps.uv[far], rim]))
        which = np.concatenate([gaps.which[far], self.holding(rim)])
        taken = np.flatnonzero(np.isin(_keys(at[: len(far)]), _keys(surface.at)))
        at[taken] = _middles(surface, far[taken])
        which[taken] = self.holding(at[taken] / UV_ONE)
        points = np.empty((len(at), 3))
        for k in np.unique(which).tolist():
            truth, mine, window = self._truths[k], which == k, self._windows[k]
            uv = (at[mine] / UV_ONE - window[:2]) / window[2]
            points[mine] = points_at(truth, uv) + truth.centre
        return self._meshing.add(at, points, np.concatenate([far, beside]))

    def holding(self, uv: Floats) -> NDArray[np.int64]:
        """Return the truths that places, (n, 2), lie in: not those of places beside."""
        windows = np.array(self._windows)
        past = (uv[:, None] - windows[:, :2]) / windows[:, 2:]
        return np.asarray(((past >= 0) & (past <= 1)).all(axis=2).argmax(axis=1))


def _error(result: Fitted) -> float:
    return result[1]


def _keys(at: NDArray[np.int64]) -> NDArray[np.int64]:
    return at[:, 0] * (2 * UV_ONE) + at[:, 1]


def _middles(surface: Surface, which: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the middles of triangles' longest edges, as places, (n, 2)."""
    ends = surface.triangles[which]
    there = surface.points[ends]
    long_m = np.linalg.norm(there - np.roll(there, -1, axis=1), axis=2)
    k, n = long_m.argmax(axis=1), np.arange(len(which))
    return np.asarray(surface.at[ends[n, k]] + surface.at[ends[n, (k + 1) % 3]]) // 2


def is_beside_rim(uv: Floats) -> NDArray[np.bool_]:
    """Say which places, (n, 2), are near the cell's edge."""
    return np.asarray(((uv < BESIDE) | (uv > 1 - BESIDE)).any(axis=1))


def on_rim(uv: Floats) -> Floats:
    """Return the places on the cell's edges beside places near them, (n, 2)."""
    return np.asarray(np.where((uv < BESIDE) | (uv > 1 - BESIDE), np.round(uv), uv))
