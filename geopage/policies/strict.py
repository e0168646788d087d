# SPDX-License-Identifier: Apache-2.0
"""Level by level, as today's tile engines refine: no level is skipped.

A tile's four children are asked for when the tile itself can be drawn and errs by more
than the threshold, the largest screen error first; nothing is asked for before a view
needs it. (They are drawn when all four are there: so it is for every policy.) Objects
are asked for as by `demand`.
"""

import numpy as np

from geopage.cell_error import error_px_per_m
from geopage.policies.demand import by_error
from geopage.policies.protocol import LeastRecentlyUsed, Plan, Situation, in_order
from geopage.tree import F8
from tiles.forest import Rows
from tiles.lanes import Lane


class Strict(LeastRecentlyUsed):
    """The children of what is drawn too coarsely, the largest screen error first."""

    def plan(self, seen: Situation) -> Plan:
        """Ask for the next level of what the newest view draws."""
        land, things = self._next_level(seen), seen.chosen.wants[Lane.OBJECTS]
        return Plan(
            {
                Lane.TERRAIN: in_order([land]),
                Lane.OBJECTS: in_order([(things.rows, by_error(things))]),
            }
        )

    def _next_level(self, seen: Situation) -> tuple[Rows, F8]:
        tree, uploaded = seen.trees[Lane.TERRAIN], seen.uploaded[Lane.TERRAIN]
        coarse = seen.chosen.terrain[seen.chosen.stand_in]
        lens = seen.lens(seen.view)
        error_px = np.array(
            [
                tree.error_m[row]
                * error_px_per_m(
                    lens,
                    tree.centre[row],
                    tree.radius_m[row],
                    tree.box_m[row],
                    tree.box_rad[row],
                )
                for row in coarse.tolist()
            ]
        )
        below = tree.children[coarse].ravel()
        keys = np.repeat(-np.log(np.maximum(error_px, 1e-6)), 4)
        absent = (below >= 0) & (uploaded[below] == 0)
        roots = tree.roots[uploaded[tree.roots] == 0]
        first = np.full(len(roots), keys.min(initial=0.0) - 1.0)
        rows = np.concatenate((roots, below[absent])).astype(np.int32)
        return rows, np.concatenate((first, keys[absent]))
