# SPDX-License-Identifier: Apache-2.0
"""A cell's rungs: coarser meshes for errors between its own and its parent's.

A leaf's are greedy insertion over its posts, closed between them and measured like the
leaf itself. An inner cell's is a state of its own mesh on the way, measured against all
posts below like the whole.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.fitting import NEARLY_ALL, Fitting, fitted
from ingest.fitting import ROUNDS as MOST_ROUNDS
from ingest.terrain_mesh import Places, Surface, meshed
from ingest.terrain_tile import inner_bound_m
from ingest.truth import Truth
from tiles.mesh import STEPS, Mesh
from tiles.terrain import RUNG

LEAST = 2.0
"""A rung's error is at least so many times the leaf's."""
FEW = 0.2
"""Where the second rung has fewer of a leaf's triangles, there is one between the two."""
FEWEST = 32
"""A cell of fewer triangles has no rungs."""
SAVES = 0.7
"""A rung has at most this share of the triangles of the next finer one."""
ROUGH = 0.3
"""Share of its posts that a rough leaf takes"""
GOALS, ROUGH_GOALS, ROUGHEST_GOALS = (1.0, 0.5), (0.9, 0.4), (0.9, 0.45, 0.25)
"""Goals of a leaf, of a rough one, and of one that takes nearly all its posts: shares of
its parent's bound. The finest of three takes as long as the others together, so only those
have it whose whole meshes are largest."""
INNER_GOAL = math.sqrt(2)
"""Goal of an inner cell, in its own bounds: half way to its parent's"""
INNER_SAVES = 0.9
"""`SAVES` of an inner cell, whose rung adds few vertices"""
ROUNDS = 4


class Rung(NamedTuple):
    """A coarser surface of a cell."""

    surface: Surface
    error_m: float


def laddered(
    cell: int, places: Places, bound_m: float, truths: Sequence[Truth]
) -> tuple[Surface, float, list[Rung]]:
    """Mesh a leaf as `fitted` does, and its rungs on the way.

    Errors to reach are shares of `_most_m`; half of the parent's bound is the bound of an
    inner cell of the leaf's size.

    Returns
    -------
    surface, error_m : of the whole mesh
    rungs : finer first
    """
    most_m = _most_m(cell, bound_m, truths[0])
    if len(truths) > 1 or most_m < LEAST * bound_m:
        return *fitted(cell, places, bound_m, truths, leaf=True), []
    fitting = Fitting(cell, places, truths, leaf=True)
    share = fitting.roughness(bound_m)
    made = _on_the_way(fitting, share, (most_m, bound_m), 2 * len(places.at))
    if share > NEARLY_ALL:
        fitting.take_all()
    whole, error_m = fitted(cell, places, bound_m, truths, leaf=True, begun=fitting)
    return whole, error_m, _kept(made, len(whole.triangles), error_m, SAVES)


def _most_m(cell: int, bound_m: float, truth: Truth) -> float:
    """Return its parent's bound, or what is left of it on gentle ground.

    On ground that is flat but for the earth's curve it is all of it.
    """
    half_m = (truth.high_m - truth.low_m) / 2
    most_m = 2 * inner_bound_m(cell)
    return min(most_m, half_m) if half_m >= LEAST * bound_m else most_m


def _on_the_way(
    fitting: Fitting, share: float, span_m: tuple[float, float], posts: int
) -> list[Rung]:
    """Return what a leaf's mesh is at some errors, coarser first.

    Parameters
    ----------
    share : of its posts that it takes, about
    span_m : its parent's bound, or what is left of it, and its own
    posts : triangles of a mesh of all of them
    """
    most_m, bound_m = span_m
    rough = ROUGHEST_GOALS if share > NEARLY_ALL else ROUGH_GOALS
    made, goals_m = [], [goal * most_m for goal in (rough if share > ROUGH else GOALS)]
    for goal_m in goals_m:
        if goal_m < LEAST * bound_m:
            break
        made.append(Rung(*fitting.roughly(goal_m, ROUNDS)))
        few = share <= ROUGH and len(made[-1].surface.triangles) < FEW * posts
        if few and len(made) == len(GOALS):
            goals_m.append(math.sqrt(goal_m * bound_m))
    return made


def laddered_inner(
    cell: int, places: Places, bound_m: float, truths: Sequence[Truth]
) -> tuple[Surface, float, list[Rung]]:
    """Mesh an inner cell as `fitted` does, and its rung on the way; see `laddered`."""
    fitting = Fitting(cell, places, truths, leaf=False)
    rung = Rung(*fitting.within(INNER_GOAL * bound_m, MOST_ROUNDS))
    whole, error_m = fitted(cell, places, bound_m, truths, leaf=False, begun=fitting)
    return whole, error_m, _kept([rung], len(whole.triangles), error_m, INNER_SAVES)


def _kept(made: list[Rung], triangles: int, error_m: float, saves: float) -> list[Rung]:
    """Return the rungs that are worth it, finer first."""
    kept: list[Rung] = []
    for rung in reversed(made if triangles >= FEWEST else []):
        count = len(rung.surface.triangles)
        if count <= saves * triangles and rung.error_m > error_m:
            kept.append(rung)
            triangles, error_m = count, rung.error_m
    return kept


def joined_mesh(whole: Surface, rungs: list[Rung]) -> tuple[Mesh, NDArray[np.void]]:
    """Put a leaf's meshes over one set of vertices.

    Returns
    -------
    mesh : the whole one's surface and skirt, then each rung's
    table : (r,) RUNG
    """
    steps, at = whole.steps, whole.at
    most = max(int(one.used.max()) for one in (whole, *(rung.surface for rung in rungs)))
    number = np.full(most + 1, -1)
    number[whole.used] = np.arange(len(at))
    surfaces = [whole.shown]
    for rung in rungs:
        one = rung.surface
        # A whole mesh that was begun anew may have given a number to another place.
        new = (number[one.used] < 0) | (at[number[one.used]] != one.at).any(axis=1)
        aside_m = one.centre - whole.centre  # at a pole
        more = np.rint((one.points[new] + aside_m) / whole.scale_m)
        if np.abs(more).max(initial=0.0) > STEPS:
            break
        number[one.used[new]] = len(at) + np.arange(len(more))
        at = np.concatenate([at, one.at[new]])
        steps = np.concatenate([steps, more.astype(np.int16)])
        triangles, border = (number[one.used][rows] for rows in one.shown)
        surfaces.append((triangles, border))
    mesh, ends = meshed(whole.cell, (whole.centre, whole.scale_m), steps, at, surfaces)
    table = np.zeros(len(surfaces) - 1, RUNG)
    for row, rung, (triangles, _), first, end in zip(
        table, rungs, surfaces[1:], ends, ends[1:], strict=False
    ):
        row["error_m"] = np.nextafter(np.float32(rung.error_m), np.float32(np.inf))
        row["first_index"], row["surface_index_count"] = first, triangles.size
        row["index_count"] = end - first
    return mesh, table
