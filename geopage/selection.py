# SPDX-License-Identifier: Apache-2.0
"""What one view draws, wants and keeps, over both lanes. Pure: arrays in, arrays out."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage import object_selection as objects
from geopage import terrain_selection as terrain
from geopage.draw_list import DrawList
from geopage.screen_error import Lens, lens_of
from geopage.tree import F8, U1, Tree, tree_of
from geopage.view import ViewState
from tiles import cells
from tiles.forest import Forest, Rows, build_forest
from tiles.frames import Ecef
from tiles.index_tree import INDEX
from tiles.lanes import Lane

Flags = Mapping[Lane, U1]
"""For each lane, one byte for each row of its forest."""


@dataclass(frozen=True, slots=True)
class Thresholds:
    """What the selection is made for; raised together when memory is short."""

    terrain_px: float
    objects_px: float

    def times(self, factor: float) -> "Thresholds":
        """Return both thresholds, `factor` times as large."""
        return Thresholds(self.terrain_px * factor, self.objects_px * factor)


@dataclass(frozen=True, slots=True)
class Wants:
    """The missing tiles of one lane, in no order, each row once."""

    rows: Rows
    benefit: F8
    """(w,) screen error times area removed for each byte read; larger is better"""
    error_px: F8
    """(w,) screen error of what is drawn there now"""
    now: NDArray[np.bool_]
    """(w,) False: asked for a little before it will be drawn"""


@dataclass(frozen=True, slots=True)
class Selection:
    """Everything that one view decides."""

    terrain: Rows
    skirt_m: NDArray[np.float32]
    stand_in: NDArray[np.bool_]
    objects: Rows
    own: NDArray[np.bool_]
    proxies: U1
    wants: dict[Lane, Wants]
    keep: dict[Lane, Rows]
    """uploaded or not: rows that the view draws, or will draw when they come"""
    refined: U1
    """(n,) terrain rows below which it went on; input of the next selection"""
    needed_bytes: int
    """memory of what the view will draw when all is there"""

    def draw_list(
        self, number: int, view: ViewState, limits: Thresholds, *, settled: bool
    ) -> DrawList:
        """Return the part that the renderer draws."""
        return DrawList(
            number,
            view,
            self.terrain,
            self.skirt_m,
            self.stand_in,
            self.objects,
            self.own,
            self.proxies,
            limits.terrain_px,
            limits.objects_px,
            settled,
        )


def trees_of(forests: Mapping[Lane, Forest]) -> dict[Lane, Tree]:
    """Return the arrays that the selection walks, for each lane."""
    return {lane: tree_of(forest, lane) for lane, forest in forests.items()}


def select(
    trees: Mapping[Lane, Tree],
    lens: Lens,
    uploaded: Flags,
    limits: Thresholds,
    refined: U1 | None = None,
) -> Selection:
    """Choose what to draw now and what to load for later.

    Parameters
    ----------
    trees : both lanes
    lens : the view, with its cone widened by the turn rate
    uploaded : for each lane, (n,) 1 where the tile can be drawn
    limits : thresholds, px
    refined : the last selection's; with it detail changes with hysteresis and stays
        while coarser tiles are on their way
    """
    land, flags = trees[Lane.TERRAIN], uploaded[Lane.TERRAIN]
    before = np.zeros(len(land.parent), np.uint8) if refined is None else refined
    plan = terrain.refine(land, lens, limits.terrain_px, flags, before)
    _, by_children = terrain.cover(plan, flags)
    taken, stand = terrain.emit(plan, flags, by_children)
    wanted = terrain.want(land, lens, plan, flags, by_children, stand)
    drawn = plan.rows[taken]
    targets = plan.rows[plan.kind == terrain.TARGET]
    refined = np.zeros(len(land.parent), np.uint8)
    refined[plan.rows[plan.below >= 0]] = 1
    things = _select_objects(trees[Lane.OBJECTS], lens, uploaded[Lane.OBJECTS], limits)
    land_wants = Wants(*wanted, np.ones(len(wanted[0]), np.bool_))
    return Selection(
        drawn,
        terrain.skirts(land, drawn),
        plan.kind[taken] == terrain.REFINED,
        things.rows,
        things.own,
        things.proxies,
        {Lane.TERRAIN: land_wants, Lane.OBJECTS: things.wants},
        {Lane.TERRAIN: np.concatenate((drawn, targets)), Lane.OBJECTS: things.keep},
        refined,
        int(land.memory_bytes[targets].sum()) + things.needed_bytes,
    )


@dataclass(frozen=True, slots=True)
class _Things:
    """The objects' part of a selection."""

    rows: Rows
    own: NDArray[np.bool_]
    proxies: U1
    wants: Wants
    keep: Rows
    needed_bytes: int


def _select_objects(tree: Tree, lens: Lens, uploaded: U1, limits: Thresholds) -> _Things:
    """Draw at the thresholds, and ask for tiles a little earlier."""
    plan, covered, emitted = _plan_objects(tree, lens, uploaded, limits)
    taken, own, proxies, stand = emitted
    now = objects.want_objects(tree, lens, plan, uploaded, covered, stand)
    needed = plan.rows[((plan.own | plan.proxies) > 0) & (plan.held == 0)]
    early, covered, (_, _, _, stand) = _plan_objects(
        tree, lens, uploaded, limits.times(1 / objects.ASK_EARLIER)
    )
    soon = objects.want_objects(tree, lens, early, uploaded, covered, stand)
    asked = early.rows[((early.own | early.proxies) > 0) & (early.held == 0)]
    drawn = plan.rows[taken]
    return _Things(
        drawn,
        own > 0,
        proxies,
        _joined(now, soon),
        np.unique(np.concatenate((drawn, needed, asked))),
        int((tree.memory_bytes * tree.has_tile)[asked].sum()),
    )


def _plan_objects(
    tree: Tree, lens: Lens, uploaded: U1, limits: Thresholds
) -> tuple[objects.ObjectPlan, U1, tuple[Rows, U1, U1, Rows]]:
    plan = objects.visit(tree, lens, limits.terrain_px, limits.objects_px, uploaded)
    covered = objects.cover_objects(tree, plan, uploaded)
    return plan, covered, objects.emit_objects(tree, plan, uploaded, covered)


def _joined(now: tuple[Rows, F8, F8], soon: tuple[Rows, F8, F8]) -> Wants:
    """Join two lists of wants; a row that is in both counts as wanted now."""
    rows = np.concatenate((now[0], soon[0]))
    _, first = np.unique(rows, return_index=True)
    benefit, error_px = np.concatenate((now[1], soon[1])), np.concatenate((now[2], soon[2]))
    return Wants(rows[first], benefit[first], error_px[first], first < len(now[0]))


def everything(trees: Mapping[Lane, Tree]) -> dict[Lane, U1]:
    """Return flags that say that every tile can be drawn."""
    return {lane: tree.has_tile.copy() for lane, tree in trees.items()}


def ideal(
    forests: Mapping[Lane, Forest],
    view: ViewState,
    threshold_px: float,
    object_threshold_px: float,
) -> DrawList:
    """Return what a view draws when every tile is uploaded: the reference of holes."""
    trees = trees_of(forests)
    limits = Thresholds(threshold_px, object_threshold_px)
    chosen = select(trees, lens_of(view), everything(trees), limits)
    return chosen.draw_list(1, view, limits, settled=True)


def warm_up() -> None:
    """Compile every kernel, or load it from the cache, so that no frame has to."""
    record = np.zeros(1, INDEX)
    record["cell"], record["radius_m"] = cells.make(0, 0, 0, 0), 1.0
    forest = build_forest(record)
    view = ViewState(0.0, Ecef(np.array((1e7, 0.0, 0.0))), np.eye(3), 500.0, 640, 480)
    trees = trees_of(dict.fromkeys(Lane, forest))
    for flags in (everything(trees), {lane: np.zeros(1, np.uint8) for lane in Lane}):
        select(trees, lens_of(view), flags, Thresholds(1.0, 1.0), np.zeros(1, np.uint8))
