# SPDX-License-Identifier: Apache-2.0
"""What one view draws, wants and keeps, over both lanes. Pure: arrays in, arrays out."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.object_selection import select_objects
from geopage.screen_error import STILL, Lens, Sweep, lens_of
from geopage.terrain_selection import select_terrain
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
    """The missing tiles of one lane, each row once."""

    rows: Rows
    benefit: F8
    """(w,) screen error times area removed for each byte read; larger is better"""
    error_px: F8
    """(w,) screen error of what is drawn there now"""


@dataclass(frozen=True, slots=True)
class Selection:
    """Everything that one view decides."""

    terrain: Rows
    rung: U1
    skirt_m: NDArray[np.float32]
    stand_in: NDArray[np.bool_]
    objects: Rows
    own: NDArray[np.bool_]
    proxies: U1
    wants: dict[Lane, Wants]
    keep: dict[Lane, Rows]
    """uploaded or not: rows that the view draws, or will draw when they come, and uploaded
    object tiles that stand in for others when the view moves on"""
    made: Mapping[Lane, U1]
    """(n,) what it made of each cell; input of the next selection"""
    needed_bytes: int
    """memory of what the view will draw when all is there"""

    def draw_list(
        self,
        number: int,
        view: ViewState,
        limits: Thresholds,
        sweep: Sweep = STILL,
        *,
        settled: bool,
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
            sweep,
            rung=self.rung,
        )


def trees_of(forests: Mapping[Lane, Forest]) -> dict[Lane, Tree]:
    """Return the arrays that the selection walks, for each lane."""
    return {lane: tree_of(forest, lane) for lane, forest in forests.items()}


def select(
    trees: Mapping[Lane, Tree],
    lens: Lens,
    uploaded: Flags,
    limits: Thresholds,
    before: Mapping[Lane, U1] | None = None,
    ahead: Lens | None = None,
) -> Selection:
    """Choose what to draw now and what to load for later.

    Parameters
    ----------
    trees : both lanes
    lens : the view, with its cone widened by the turn rate
    uploaded : for each lane, (n,) 1 where the tile can be drawn
    limits : thresholds, px
    before : what the last selection made; with it detail changes with hysteresis and stays
        while coarser tiles are on their way
    ahead : where the view will be while the list is drawn, for the objects: what grows
        above the threshold meanwhile is then in the list; by default the same as `lens`
    """
    land, town = trees[Lane.TERRAIN], trees[Lane.OBJECTS]
    made = before or {
        lane: np.zeros(len(tree.parent), np.uint8) for lane, tree in trees.items()
    }
    ground = select_terrain(
        land, lens, limits.terrain_px, uploaded[Lane.TERRAIN], made[Lane.TERRAIN]
    )
    things = select_objects(
        town,
        ahead or lens,
        limits.terrain_px,
        limits.objects_px,
        uploaded[Lane.OBJECTS],
        made[Lane.OBJECTS],
    )
    terrain_wants = Wants(ground.wanted, ground.benefit, ground.error_px)
    object_wants = Wants(things.wanted, things.benefit, things.error_px)
    needed_bytes = land.memory_bytes[ground.targets].sum()
    needed_bytes += town.memory_bytes[things.needed].sum()
    return Selection(
        ground.drawn,
        ground.rung,
        ground.skirt_m,
        ground.stand_in.view(np.bool_),
        things.drawn,
        things.own.view(np.bool_),
        things.proxies,
        {Lane.TERRAIN: terrain_wants, Lane.OBJECTS: object_wants},
        {
            Lane.TERRAIN: np.concatenate((ground.drawn, ground.targets)),
            Lane.OBJECTS: np.concatenate((things.drawn, things.needed, things.above)),
        },
        {Lane.TERRAIN: ground.refined, Lane.OBJECTS: things.made},
        int(needed_bytes),
    )


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
    record["cell"], record["centre"] = cells.make(0, 0, 0, 0), (6.4e6, 0.0, 0.0)
    record["radius_m"] = 1.0
    forest = build_forest(record)
    view = ViewState(0.0, Ecef(np.array((1e7, 0.0, 0.0))), np.eye(3), 500.0, 640, 480)
    trees = trees_of(dict.fromkeys(Lane, forest))
    for flags in (everything(trees), {lane: np.zeros(1, np.uint8) for lane in Lane}):
        select(trees, lens_of(view), flags, Thresholds(1.0, 1.0))
