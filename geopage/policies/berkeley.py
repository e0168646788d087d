# SPDX-License-Identifier: Apache-2.0
"""The lookahead of the Berkeley walkthrough: Funkhouser 1996, section 4.

- Observer range: the ball that the eye can reach during the next N frames, and the view
  directions that it can turn to, by the most speed that it is allowed.
- Lookahead set: what may be seen from somewhere in the range, at all levels of detail up
  to the finest that may be drawn from there.
- Read set of a frame: lookahead tiles "in order of LOD (lowest to highest) and when they
  can possibly become visible", up to the bytes that can be read in a frame; what the
  newest view misses is always in it.
- Cache in the order of the lookahead: what has not been in the lookahead set for longest
  goes first.

Cell-to-object visibility, worked out beforehand through the portals of a building, has
no like in the open. In its place a selection in which every tile is as near as it can
get while the eye stays in the range: conservative, but nothing hides anything except the
planet. Their speed limit was that of the user interface; here it is a little more than
the present speed, or a share of the height a second.
"""

import math

import numpy as np

from geopage.policies.coarser import on_the_way
from geopage.policies.protocol import (
    LeastRecentlyUsed,
    Numbers,
    PageRequests,
    Plan,
    Requests,
    Situation,
    height_of,
    velocity,
)
from geopage.screen_error import TURN_AHEAD_S, lens_of
from geopage.selection import Selection
from geopage.tree import F8
from tiles.forest import Rows
from tiles.lanes import Lane

FRAME_S = 1 / 16
"""Theirs took 0.063 s on average, and looked 16 frames ahead."""
FRAMES = (4, 8, 16)
SPEED_SHARE = 1.25
LEAST_HEIGHTS_S = 1 / 8
LEAST_TURN_RAD_S = math.radians(30)
READ_BYTES = 2**18
"""The most bytes read in a frame, beyond what the newest view misses."""


class Berkeley(LeastRecentlyUsed):
    """What may be seen soon, from anywhere near."""

    def plan(self, seen: Situation) -> Plan:
        """Ask for the read set of a frame."""
        looks = [seen.chosen, *(within(seen, frames * FRAME_S) for frames in FRAMES)]
        requests: Requests = {}
        for lane in Lane:
            tree = seen.trees[lane]
            groups: list[tuple[Rows, F8]] = []
            for i, look in enumerate(looks):
                rows = all_levels(seen, lane, look)
                key = tree.level[rows].astype(np.float64) + i / len(looks)
                groups.append((rows, key))
            requests[lane] = read_set(groups, tree.tile_bytes)
        return Plan(requests, [look.keep for look in looks[1:]])


def within(seen: Situation, ahead_s: float) -> Selection:
    """Select what may be needed from anywhere in the observer range."""
    speed_m = float(np.linalg.norm(velocity(seen))) * SPEED_SHARE
    reach_m = max(speed_m, LEAST_HEIGHTS_S * height_of(seen)) * ahead_s
    turn_rad_s = seen.motion.turn_rad_s * SPEED_SHARE if seen.motion else 0.0
    turn_rad = max(turn_rad_s, LEAST_TURN_RAD_S) * ahead_s
    trees = {
        lane: tree._replace(
            radius_m=tree.radius_m + reach_m,
            box_m=tree.box_m + np.float32(reach_m),
            box_rad=np.zeros_like(tree.box_rad),
        )
        for lane, tree in seen.trees.items()
    }
    return seen.look(lens_of(seen.view, turn_rad / TURN_AHEAD_S), trees)


def all_levels(seen: Situation, lane: Lane, look: Selection) -> Rows:
    """Return what a selection misses, and all coarser tiles that are missing above it."""
    rows = look.wants[lane].rows
    way = on_the_way(seen.trees[lane], seen.uploaded[lane], rows)
    return np.unique(way[way >= 0])


def read_set(groups: list[tuple[Rows, F8]], tile_bytes: Numbers) -> PageRequests:
    """Return what is read in one frame: what the first group has, and a little more."""
    rows = np.concatenate([rows for rows, _ in groups])
    keys = np.concatenate([key for _, key in groups])
    visible = np.isin(rows, groups[0][0])
    order = np.lexsort((rows, keys))
    _, first = np.unique(rows[order], return_index=True)
    order = order[np.sort(first)]
    more = np.cumsum(tile_bytes[rows[order]] * ~visible[order]) <= READ_BYTES
    order = order[visible[order] | more]
    now = int(np.flatnonzero(visible[order]).max(initial=-1)) + 1
    return PageRequests(rows[order], keys[order], now)
