# SPDX-License-Identifier: Apache-2.0
"""The prefetching of MMR: Aliaga et al., ACM Interactive 3D Graphics 1999, section 5.2.

- The eye's space is cut into cells. What the cell that the eye is in needs comes first.
- Moving slowly: then what the cells around it need, spiralling outwards. Moving fast:
  then the cells on the eye's path, and there only what will be in the view.
- The coarsest level comes first; a request for the appropriate level is appended.
- The queue stays as it is while the eye stays in its cell; turning by more than 30
  degrees makes it anew.
- Least recently used goes first (theirs were two caches, geometry and textured depth
  meshes; here is one budget).

Their cells are placed by hand, one metre wide, with what each can see worked out
beforehand. Here they are cubes in space, a quarter of the eye's height wide, and a
selection at the middle of a cube says what it needs. Textured depth meshes are absent.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from geopage.policies.coarser import on_the_way
from geopage.policies.protocol import (
    LeastRecentlyUsed,
    Plan,
    Requests,
    Situation,
    everywhere,
    height_of,
    in_order,
    velocity,
)
from geopage.prediction import LEAST_HEIGHT_M
from geopage.selection import Selection
from geopage.tree import F8
from geopage.view import ViewState
from tiles import geodesy
from tiles.forest import Rows
from tiles.frames import Ecef
from tiles.lanes import Lane

CELL_HEIGHTS = 1 / 4
CELLS_AHEAD = 6
FAST_CELLS_S = 1.0
"""More cells a second than this are fast; the paper does not say."""
TURN_RAD = math.radians(30)
AROUND = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class Cell:
    """A cube that the eye is in."""

    size_m: float
    place: tuple[int, ...]

    def middle(self, steps: F8) -> Ecef:
        """Return the middle of the cube so many cubes on, (3,)."""
        return Ecef((np.array(self.place) + 0.5 + steps) * self.size_m)


def cell_of(seen: Situation) -> Cell:
    """Return the cell that the eye is in; its size is a power of two."""
    size_m = 2.0 ** round(math.log2(height_of(seen) * CELL_HEIGHTS))
    return Cell(size_m, tuple(np.floor(seen.view.eye / size_m).astype(int).tolist()))


class Mmr(LeastRecentlyUsed):
    """Cells around the eye, or ahead of it."""

    def __init__(self) -> None:
        self._built: tuple[Cell, bool, ViewState] | None = None
        self._queue: list[Selection] = []

    def plan(self, seen: Situation) -> Plan:
        """Ask for the newest view's tiles, then for those of the queue's cells."""
        cell, speed_m = cell_of(seen), velocity(seen)
        fast = bool(np.linalg.norm(speed_m) > FAST_CELLS_S * cell.size_m)
        if self._is_stale(cell, seen.view, fast=fast):
            self._built = cell, fast, seen.view
            views = along(seen.view, cell, speed_m) if fast else around(seen, cell)
            self._queue = [
                seen.look(seen.lens(view) if fast else everywhere(seen, view))
                for view in views
            ]
        requests: Requests = {}
        for lane in Lane:
            looks = [seen.chosen, *self._queue]
            coarse, fine = zip(
                *(self._two(seen, lane, look) for look in looks), strict=True
            )
            groups = [coarse[0], fine[0], *coarse[1:], *fine[1:]]
            requests[lane] = in_order(groups, now=2)
        return Plan(requests, [look.keep for look in self._queue])

    def _is_stale(self, cell: Cell, view: ViewState, *, fast: bool) -> bool:
        if self._built is None or self._built[:2] != (cell, fast):
            return True
        return bool(self._built[2].forward @ view.forward < math.cos(TURN_RAD))

    @staticmethod
    def _two(
        seen: Situation, lane: Lane, look: Selection
    ) -> tuple[tuple[Rows, F8], tuple[Rows, F8]]:
        """Return the coarsest and the appropriate tiles, the nearest first."""
        tree, uploaded = seen.trees[lane], seen.uploaded[lane]
        rows = look.wants[lane].rows
        rows = rows[uploaded[rows] == 0]
        far_m = np.linalg.norm(tree.centre[rows] - seen.view.eye, axis=1)
        key = np.log(np.maximum(far_m - tree.radius_m[rows], LEAST_HEIGHT_M))
        way = on_the_way(tree, uploaded, rows)
        top = way[np.argmax(way >= 0, axis=0), np.arange(len(rows))]
        return (top, key), (rows, key)


def around(seen: Situation, cell: Cell) -> list[ViewState]:
    """Return the middles of the 26 cells around, the nearest first, above the ground."""
    middles = [cell.middle(step) for step in AROUND if step.any()]
    middles.sort(key=lambda middle: float(np.linalg.norm(middle - seen.view.eye)))
    heights_m = [float(geodesy.to_geodetic(middle)[2]) for middle in middles]
    return [
        replace(seen.view, eye=middle)
        for middle, height_m in zip(middles, heights_m, strict=True)
        if height_m > seen.floor_m
    ]


def along(view: ViewState, cell: Cell, velocity_m: Ecef) -> list[ViewState]:
    """Return the next cells on the eye's path, the nearest first."""
    step_m = velocity_m / np.linalg.norm(velocity_m) * cell.size_m
    return [
        replace(view, eye=Ecef(view.eye + i * step_m)) for i in range(1, CELLS_AHEAD + 1)
    ]
