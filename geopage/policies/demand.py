# SPDX-License-Identifier: Apache-2.0
"""Strict order of screen error, on demand, without prediction.

As today's tile engines do it: what is drawn worst is asked for first, whatever it
costs; nothing is asked for before a view needs it. Least recently used goes first.
"""

import numpy as np

from geopage.policies.protocol import LeastRecentlyUsed, Plan, Situation, in_order
from geopage.selection import Wants
from geopage.tree import F8
from tiles.lanes import Lane

LEAST_PX = 1e-6


def by_error(wants: Wants) -> F8:
    """Return keys that put the largest screen error first, (w,)."""
    return np.asarray(-np.log(np.maximum(wants.error_px, LEAST_PX)))


class Demand(LeastRecentlyUsed):
    """The largest screen error first."""

    def plan(self, seen: Situation) -> Plan:
        """Ask for what the newest view misses, and for nothing else."""
        wants = seen.chosen.wants
        return Plan(
            {lane: in_order([(wants[lane].rows, by_error(wants[lane]))]) for lane in Lane}
        )
