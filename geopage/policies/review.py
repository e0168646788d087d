# SPDX-License-Identifier: Apache-2.0
"""The retrieval of REVIEW: Shou et al., VLDB 2001, section 3.

- A frustum cell is the box around the view frustum; a disk cell is `SCALE` times as
  large. What overlaps the disk cell is wanted, whether the view sees it or not, in the
  order of the index search. A new disk cell is made when the frustum cell leaves it.
- Complement search (3.1): what was fetched for an earlier cell is not asked for again.
  Here that is known of each tile, so the search itself has nothing to save.
- Prefetching (3.3): near the edge of the disk cell, the next one, around the middle F of
  the far clip plane moved on to F' = F + k velocity.
- Distance-priority-LRU (3.2), f = alpha pp + beta pd + gamma pl with the level, the
  block distance to the disk cell and the time since the last use; the largest f goes
  first. Theirs is for index blocks. Our index is always in memory, so this is on tiles,
  and ours.

Theirs has no levels of detail and a view 1 km deep. Here the view is `FAR_HEIGHTS` times
as deep as the eye is high, a selection that sees in all directions says which levels the
disk cell needs, and a cell is also made anew when the frustum cell has become far
smaller. What the view misses outside of the disk cell comes after the disk cell.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.policies.demand import by_error
from geopage.policies.protocol import (
    Numbers,
    Plan,
    Requests,
    Situation,
    everywhere,
    height_of,
    in_order,
    velocity,
)
from geopage.tree import F8, Tree
from geopage.view import ViewState
from tiles.forest import Rows
from tiles.lanes import Lane

SCALE = 1.5
FAR_HEIGHTS = 4.0
AHEAD_S = 1.0
"""k of F' = F + k velocity."""
NEAR_EDGE = 0.1
"""Share of the disk cell's size from its edge at which the next cell is prefetched."""
SMALLER = 2.5
"""A disk cell so many times as large as the frustum cell is made anew."""
WEIGHTS = np.full(3, 1 / 3)
"""alpha, beta and gamma, all alike as in the paper's section 5: level, distance, time"""


class Box(NamedTuple):
    """An axis-aligned box, ECEF m."""

    low: F8
    high: F8

    @property
    def size_m(self) -> float:
        """The longest edge."""
        return float((self.high - self.low).max())

    def around(self, middle: F8, scale: float) -> "Box":
        """Return the box `scale` times as large around a point."""
        half = (self.high - self.low) * scale / 2
        return Box(middle - half, middle + half)

    def holds(self, other: "Box", margin_m: float = 0.0) -> bool:
        """Say whether another box lies inside, by a margin."""
        low, high = self.low + margin_m <= other.low, self.high - margin_m >= other.high
        return bool(low.all() and high.all())

    def distance_m(self, tree: Tree, rows: Rows) -> F8:
        """Return the block distance to the boxes around tiles, (n,), 0 where they meet."""
        radius_m = tree.radius_m[rows, None]
        under = self.low - (tree.centre[rows] + radius_m)
        over = tree.centre[rows] - radius_m - self.high
        return np.asarray(np.maximum(np.maximum(under, over), 0).max(axis=1))


def frustum_cell(view: ViewState, far_m: float) -> tuple[Box, F8]:
    """Return the box around the view frustum, and the middle of its far clip plane."""
    x, y = view.width_px / 2 / view.focal_px, view.height_px / 2 / view.focal_px
    corners = [(i * x, j * y, -1.0) for i in (-1, 1) for j in (-1, 1)]
    far = view.eye + np.array(corners) @ view.rotation * far_m
    points = np.vstack((view.eye, far))
    return Box(points.min(axis=0), points.max(axis=0)), view.eye + view.forward * far_m


class Review:
    """Everything in a box around the view."""

    def __init__(self) -> None:
        self.disk: Box | None = None
        self.next: Box | None = None
        self._trees: dict[Lane, Tree] = {}
        self._number = 0

    def plan(self, seen: Situation) -> Plan:
        """Ask for the disk cell, and near its edge for the next one."""
        self._number, self._trees = seen.number, dict(seen.trees)
        self._move(seen)
        look = seen.look(everywhere(seen, seen.view))
        requests: Requests = {}
        for lane in Lane:
            tree, wants = seen.trees[lane], seen.chosen.wants[lane]
            rows = np.sort(np.concatenate((look.wants[lane].rows, wants.rows)))
            here, there = (rows[inside(box, tree, rows)] for box in (self.disk, self.next))
            searched = [(some, some / len(tree.parent)) for some in (here, there)]
            beyond = wants.rows, by_error(wants)
            requests[lane] = in_order([searched[0], beyond, searched[1]], now=2)
        return Plan(requests, [look.keep])

    def _move(self, seen: Situation) -> None:
        """Make a new disk cell when the frustum cell has left it, and the next one."""
        cell, far = frustum_cell(seen.view, FAR_HEIGHTS * height_of(seen))
        disk = self.disk
        too_large = disk is not None and disk.size_m > SMALLER * cell.size_m
        if disk is None or too_large or not disk.holds(cell):
            disk = cell.around((cell.low + cell.high) / 2, SCALE)
            if self.next is not None and self.next.holds(cell) and not too_large:
                disk = self.next
            self.disk, self.next = disk, None
        speed_m = velocity(seen)
        leaving = not disk.holds(cell, NEAR_EDGE * disk.size_m)
        if leaving and speed_m.any():
            self.next = cell.around(far + AHEAD_S * speed_m, SCALE)

    def leaving(self, lane: Lane, rows: Rows, last_used: Numbers) -> F8:
        """Order by distance-priority-LRU, the largest f first."""
        if self.disk is None or not len(rows):
            return last_used.astype(np.float64)
        tree = self._trees[lane]
        age = (self._number - last_used).astype(np.float64)
        away_m = self.disk.distance_m(tree, rows)
        parts = (
            tree.level[rows] / 28,
            away_m / (away_m + self.disk.size_m),
            age / (age + 60),
        )
        return np.asarray(-WEIGHTS @ np.stack(parts))


def inside(box: Box | None, tree: Tree, rows: Rows) -> NDArray[np.bool_]:
    """Say which tiles overlap a box, (n,)."""
    if box is None:
        return np.zeros(len(rows), np.bool_)
    return np.asarray(box.distance_m(tree, rows) == 0)
