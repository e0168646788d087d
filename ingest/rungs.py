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

from ingest.fitting import ROUNDS as MOST_ROUNDS
from ingest.fitting import Fitting, fitted
from ingest.terrain_mesh import Places, Surface, meshed
from ingest.terrain_tile import inner_bound_m
from ingest.truth import Truth
from tiles.mesh import STEPS, UV_ONE, Mesh
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
ROUGH_GOALS = (0.42,)
"""Goals of a rough leaf, shares of its parent's bound; 0.65 and 0.35 draw a sixth less
near by, for a twelfth more bytes of a leaf and 3 % more time."""
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

    Errors to reach are the parent's bound, or what is left of it on gentle ground, and
    half of that: the bound of an inner cell of the leaf's size.

    Returns
    -------
    surface, error_m : of the whole mesh
    rungs : finer first
    """
    most_m = min(2 * inner_bound_m(cell), (truths[0].high_m - truths[0].low_m) / 2)
    if len(truths) > 1 or most_m < LEAST * bound_m:
        return *fitted(cell, places, bound_m, truths, leaf=True), []
    fitting = Fitting(cell, places, truths, leaf=True)
    rough, posts = fitting.roughness(bound_m) > ROUGH, 2 * len(places.at)
    made: list[Rung] = []
    goals_m = [share * most_m for share in (ROUGH_GOALS if rough else (1.0, 0.5))]
    for goal_m in goals_m:
        if goal_m < LEAST * bound_m:
            break
        made.append(Rung(*fitting.roughly(goal_m, ROUNDS)))
        if len(made) == 2 and not rough and len(made[1].surface.triangles) < FEW * posts:
            goals_m.append(math.sqrt(goal_m * bound_m))
    whole, error_m = fitted(cell, places, bound_m, truths, leaf=True, begun=fitting)
    return whole, error_m, _kept(made, len(whole.triangles), error_m, SAVES)


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
    keys, steps, at = _key(whole.at), whole.steps, whole.at
    surfaces = [(whole.triangles, whole.border)]
    for rung in rungs:
        one = rung.surface
        order = np.argsort(keys)
        place = np.minimum(np.searchsorted(keys[order], _key(one.at)), len(keys) - 1)
        number = order[place]
        new = keys[number] != _key(one.at)
        number[new] = len(keys) + np.arange(int(new.sum()))
        more = np.rint(one.points[new] / whole.scale_m)
        if np.abs(more).max(initial=0.0) > STEPS:
            break
        keys = np.concatenate([keys, _key(one.at[new])])
        at = np.concatenate([at, one.at[new]])
        steps = np.concatenate([steps, more.astype(np.int16)])
        surfaces.append((number[one.triangles], number[one.border]))
    mesh, ends = meshed(whole.cell, (whole.centre, whole.scale_m), steps, at, surfaces)
    table = np.zeros(len(surfaces) - 1, RUNG)
    for row, rung, (triangles, _), first, end in zip(
        table, rungs, surfaces[1:], ends, ends[1:], strict=False
    ):
        row["error_m"] = np.nextafter(np.float32(rung.error_m), np.float32(np.inf))
        row["first_index"], row["surface_index_count"] = first, triangles.size
        row["index_count"] = end - first
    return mesh, table


def _key(at: NDArray[np.int64]) -> NDArray[np.int64]:
    return at[:, 0] * (2 * UV_ONE) + at[:, 1]
