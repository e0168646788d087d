# SPDX-License-Identifier: Apache-2.0
"""The paging of VGIS: Davis et al., IEEE Visualization 1999, section 4.

- Requests lie in one priority queue and "are changed dynamically according to the
  importance of the associated request". Importance is here the screen error of what is
  drawn in the tile's place; the paper does not say.
- The quadtree is walked down: of the tiles between what is there and what is wanted,
  the coarsest is asked for, and the next when it is there. Flying in fast, "we can skip
  one or more levels": as many as the wanted level changes by while a page is on its way.
- "A predictive mechanism based on user navigational speed and viewing direction": what
  the view of `LEAD_S` ahead misses comes after what the newest view misses.
- As an option "more detail on buildings or other objects in the center of the screen":
  importance falls with the angle to the view axis. The thresholds stay, so this is order.

The paper does not say what goes first when memory is short: least recently used.
"""

import math

import numpy as np

from geopage.policies.coarser import next_down
from geopage.policies.demand import by_error
from geopage.policies.protocol import (
    LeastRecentlyUsed,
    Plan,
    Requests,
    Situation,
    height_of,
    in_order,
    velocity,
)
from geopage.prediction import predict
from geopage.selection import Selection
from geopage.tree import F8, Tree
from geopage.view import ViewState
from tiles.forest import Rows
from tiles.lanes import Lane

LEAD_S = 1.0
MOST_SKIPPED = 8


class Vgis(LeastRecentlyUsed):
    """Walk down by importance, skipping levels when the eye is fast.

    Parameters
    ----------
    centre : more for the centre of the screen
    skips : levels are skipped when the eye is fast
    """

    def __init__(self, *, centre: bool = False, skips: bool = True) -> None:
        self._centre, self._skips = centre, skips

    def plan(self, seen: Situation) -> Plan:
        """Ask for the next tiles down, of the newest view and of a predicted one."""
        views, looks = [seen.view], [seen.chosen]
        if seen.motion is not None:
            views.append(predict(seen.view, seen.motion, LEAD_S))
            looks.append(seen.look(seen.lens(views[1])))
        skip = levels_skipped(seen) if self._skips else 0
        requests: Requests = {}
        for lane in Lane:
            groups = [
                self._group(seen, lane, view, look, skip)
                for view, look in zip(views, looks, strict=True)
            ]
            requests[lane] = in_order(groups)
        return Plan(requests, [look.keep for look in looks[1:]])

    def _group(
        self, seen: Situation, lane: Lane, view: ViewState, look: Selection, skip: int
    ) -> tuple[Rows, F8]:
        wants, tree = look.wants[lane], seen.trees[lane]
        rows = next_down(tree, seen.uploaded[lane], wants.rows, skip)
        key = by_error(wants)
        return rows, key - np.log(in_the_centre(tree, rows, view)) if self._centre else key


def levels_skipped(seen: Situation) -> int:
    """Return how many levels the wanted level changes by in `LEAD_S`.

    One for each halving of the height; flying along, one for as many heights a second as
    a halving is of climb.
    """
    if seen.motion is None:
        return 0
    heights_s = float(np.linalg.norm(velocity(seen))) / height_of(seen)
    return min(round(heights_s * LEAD_S / math.log(2)), MOST_SKIPPED)


def in_the_centre(tree: Tree, rows: Rows, view: ViewState) -> F8:
    """Return a weight for each tile: 1 on the view axis, 1/2 at the picture's corner."""
    away = tree.centre[rows] - view.eye
    far_m = np.linalg.norm(away, axis=1)
    cosine = np.clip(away @ view.forward / np.maximum(far_m, 1e-3), -1, 1)
    near = np.arcsin(np.minimum(tree.radius_m[rows] / np.maximum(far_m, 1e-3), 1))
    angle = np.maximum(np.arccos(cosine) - near, 0)
    return np.asarray(1 / (1 + (angle / math.acos(view.corner_cos)) ** 2))
