# SPDX-License-Identifier: Apache-2.0
"""Our own: bytes go where they make pictures good, in the time that there is.

While the line keeps up, what the newest view misses comes first, by the screen error
that each byte removes, and what views ahead miss comes after it: every pixel keeps its
threshold. It looks as far ahead as loading takes, and no further: what is asked for sooner
than it must be is more often never seen.

A slow line is planned `AHEAD_S` on, along the predicted path, at the rate at which tiles
come (measured): what will be seen when the bytes have arrived is asked for, and not what
is seen now. Each picture ahead has goals: its terrain good by area, all its objects, and
for pictures that can't be good in time the same at a few times the threshold. Goals that
can be met are read in the order in which they are due; see `geopage.schedule`. Both lanes
share one line and one rank. The rest of what the newest view misses comes after that, and
what has been missed for longer than `AGE_S` comes forward, so that nothing starves. A line
with nothing else to do brings what the same place shows in all other directions.

Least recently used goes first.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from geopage.benefit import LATER, merged_ranks, ranks
from geopage.ground_needs import Needs, Work, ground_needs_of, work_of
from geopage.object_needs import object_needs_of
from geopage.outlook import Ahead, outlook
from geopage.policies.protocol import (
    LeastRecentlyUsed,
    PageRequests,
    Plan,
    Requests,
    Situation,
    everywhere,
)
from geopage.prediction import AHEAD, Motion, predict
from geopage.schedule import (
    STEP,
    UNMET,
    Line,
    Marks,
    choose,
    line_of,
    marks_of,
    ranked,
)
from geopage.screen_error import lens_of
from geopage.selection import Selection, Thresholds, Wants, select, trees_of
from geopage.tree import F8, are_among
from geopage.view import ViewState
from tiles import cells
from tiles.forest import Rows, build_forest
from tiles.frames import Ecef
from tiles.index_tree import INDEX
from tiles.lanes import Lane

AHEAD_S = np.array(
    (0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1, 1.3, 1.6, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8)
)
GOALS = 4
"""Of each picture: at 1, 4, 16 and 64 times the threshold."""
LAG_S = 0.05
"""From the last byte of a tile until it is drawn: decoding, upload, a list, a frame."""
SHARES = (0.9, 1.0, 1.0, 1.0)
"""Of the line that each goal may take: coarser pictures until then take the rest."""
OBJECT_SHARES = (0.5,) * GOALS
"""Likewise for objects: terrain that is not foreseen yet will need the line, too."""
TIGHT = 0.3
"""A line of which no goal takes more than this share keeps up."""
AGE_S = 10.0
AGING = 2.0
"""Pictures by which the rank of what is missed comes forward in a second after that."""
AGED = 1e20
"""Likewise on a line that keeps up: so many times the benefit, more than any other has."""
FAST_BYTES_S, FAST_S = 8e6, 0.02
"""A line that brings so many bytes a second, and all that is missing in so short a time,
keeps up."""
AROUND = 8 * UNMET
"""Rank of the first that only another direction shows"""
SOON = 0.2
"""A view ahead that can be loaded in this share of the time until then is soon enough."""


class Benefit(LeastRecentlyUsed):
    """What makes the most pictures good for the bytes that can be read."""

    def __init__(self) -> None:
        self._turn = 0
        self._later: dict[float, Selection] = {}
        self._work: Work | None = None
        self._marks: dict[Lane, Marks] = {}
        self._missed: dict[Lane, tuple[Rows, F8]] = {}

    def plan(self, seen: Situation) -> Plan:
        """Rank what is missing."""
        fast = seen.bytes_per_s >= FAST_BYTES_S and loading_s(seen, seen.chosen) <= FAST_S
        planned = None if fast else self._plan_line(seen)
        plan = planned or self._plan_spare(seen)
        if seen.destination:
            plan = _with(plan, seen.look(seen.lens(seen.destination)), 4 * UNMET)
        # A slow line that has nothing to do brings what a turn of the head will show.
        return plan if fast else _with(plan, seen.look(everywhere(seen, seen.view)), AROUND)

    def ahead(self, seen: Situation) -> Ahead:
        """Return the views of the next seconds."""
        return outlook(seen.view, seen.motion, seen.floor_m, AHEAD_S)

    def _plan_line(self, seen: Situation) -> Plan | None:
        """Plan a slow line; None when it keeps up."""
        if self._work is None:
            self._work = work_of(seen.trees[Lane.TERRAIN])
            self._marks = {lane: marks_of(len(t.parent)) for lane, t in seen.trees.items()}
        ahead, limits = self.ahead(seen), seen.limits
        land, town = seen.trees[Lane.TERRAIN], seen.trees[Lane.OBJECTS]
        needs = {
            Lane.TERRAIN: ground_needs_of(
                land,
                seen.uploaded[Lane.TERRAIN],
                ahead,
                limits.terrain_px,
                GOALS,
                self._work,
            ),
            Lane.OBJECTS: object_needs_of(
                town,
                seen.uploaded[Lane.OBJECTS],
                ahead,
                seen.lens(seen.view),
                limits.terrain_px,
                limits.objects_px,
                GOALS,
            ),
        }
        line = line_of(ahead.ahead_s, seen.bytes_per_s, LAG_S)
        self._choose(seen, needs, line)
        tight = bool((line.brought_bytes > TIGHT * line.room_bytes).any())
        requests: Requests = {}
        for lane, tree in seen.trees.items():
            found = ranked(needs[lane], tree.tile_bytes, line, self._marks[lane])
            requests[lane] = self._requests(seen, lane, *found)
            tight |= bool(found[1].max(initial=0.0) > UNMET / 2)
        keep = {lane: needs[lane].keep for lane in Lane}
        return Plan(requests, [keep]) if tight else None

    def _choose(self, seen: Situation, needs: dict[Lane, Needs], line: Line) -> None:
        """Choose terrain's goals, the finest first, then those of objects."""
        views = np.arange(len(line.room_bytes), dtype=np.int32)
        land, town = (seen.trees[lane].tile_bytes for lane in Lane)
        ground, things = needs[Lane.TERRAIN], needs[Lane.OBJECTS]
        for missing, size_bytes, due, shares in (
            (ground, land, self._marks[Lane.TERRAIN].due, SHARES),
            (things, town, self._marks[Lane.OBJECTS].due, OBJECT_SHARES),
        ):
            left = views
            for goal, share in enumerate(shares):
                met = choose(missing, left * GOALS + goal, share, size_bytes, line, due)
                left = left[~met]

    def _requests(self, seen: Situation, lane: Lane, rows: Rows, keys: F8) -> PageRequests:
        """Add the rest of what the newest view misses, what it misses long first."""
        wants = seen.chosen.wants[lane]
        old_s = seen.view.t_s - self._missed_since(lane, wants.rows, seen.view.t_s) - AGE_S
        aged = STEP * np.maximum(len(AHEAD_S) - AGING * old_s, 0.0)
        rest = np.where(old_s > 0, aged, 2 * UNMET + ranks(wants))
        return merged([(rows, keys), (wants.rows, rest)])

    def _missed_since(self, lane: Lane, rows: Rows, now_s: float) -> F8:
        """Return since when the views have missed each tile, (w,)."""
        before, since_s = self._missed.get(lane, (rows[:0], np.zeros(0)))
        order = np.argsort(rows)
        at = np.searchsorted(before, rows[order])
        known = np.append(before, -1)[at] == rows[order]
        found = np.where(known, np.append(since_s, now_s)[at], now_s)
        self._missed[lane] = rows[order], np.minimum(found, now_s)
        back = np.empty(len(rows))
        back[order] = found
        return back

    def _plan_spare(self, seen: Situation) -> Plan:
        later = self._look_ahead(seen)
        requests: Requests = {}
        for lane in Lane:
            now = self._aged(seen, lane)
            ahead = [(weight, sure_wants(one, lane)) for weight, one in later]
            requests[lane] = PageRequests(*merged_ranks(now, ahead), len(now.rows))
        return Plan(requests, [one.keep for _, one in later])

    def _aged(self, seen: Situation, lane: Lane) -> Wants:
        """Return what the newest view misses, with more to gain where it does for long."""
        wants, now_s = seen.chosen.wants[lane], seen.view.t_s
        old = now_s - self._missed_since(lane, wants.rows, now_s) > AGE_S
        return replace(wants, benefit=np.where(old, AGED, 1.0) * wants.benefit)

    def _look_ahead(self, seen: Situation) -> list[tuple[float, Selection]]:
        """Look at one of the predicted views each time, in turn: that is often enough."""
        if seen.motion is None:
            self._later = {}
            return []
        near = AHEAD[: self._reach(seen)]
        self._turn = (self._turn + 1) % len(near)
        ahead_s, weight = near[self._turn]
        soon = predict(seen.view, seen.motion, ahead_s)
        self._later[weight] = seen.look(seen.lens(soon))
        return [(w, self._later[w]) for _, w in near if w in self._later]

    def _reach(self, seen: Situation) -> int:
        """Return how many of the predicted views to look at: all, on a slow line."""
        if seen.bytes_per_s < FAST_BYTES_S:
            return len(AHEAD)
        for count, (ahead_s, weight) in enumerate(AHEAD, 1):
            one = self._later.get(weight)
            if one is None or loading_s(seen, one) < SOON * ahead_s:
                return count
        return len(AHEAD)


def _with(plan: Plan, there: Selection, first: float) -> Plan:
    """Add what another view misses and will surely draw, after everything else."""
    requests: Requests = {}
    for lane, asked in plan.requests.items():
        wants = there.wants[lane]
        last = first + LATER + ranks(wants)
        more = merged([(asked.rows, asked.ranks), (wants.rows, last)])
        requests[lane] = PageRequests(more.rows, more.ranks, asked.now)
    return Plan(requests, [*plan.keep, there.keep])


def sure_wants(one: Selection, lane: Lane) -> Wants:
    """Return what a view ahead misses and will surely draw.

    Not what would stand in for others while they load, nor coarser tiles where finer ones
    are drawn already: nobody may ever see those.
    """
    wants = one.wants[lane]
    sure = are_among(len(one.made[lane]), wants.rows, one.keep[lane])
    sure &= wants.benefit > 0
    return Wants(wants.rows[sure], wants.benefit[sure], wants.error_px[sure])


def loading_s(seen: Situation, chosen: Selection) -> float:
    """Return how long it takes to load what a view misses."""
    missing = sum(
        int(seen.trees[lane].tile_bytes[wants.rows].sum())
        for lane, wants in chosen.wants.items()
    )
    return missing / seen.bytes_per_s


def merged(groups: Sequence[tuple[Rows, F8]]) -> PageRequests:
    """Return the rows of groups by rank, each once, by its best rank."""
    rows = np.concatenate([rows for rows, _ in groups])
    keys = np.concatenate([keys for _, keys in groups])
    order = np.lexsort((rows, keys))
    _, first = np.unique(rows[order], return_index=True)
    order = order[np.sort(first)]
    return PageRequests(rows[order], keys[order], len(order))


@cache
def warm_up() -> None:
    """Compile the planner's kernels, or load them, so that no flight has to."""
    record = np.zeros(1, INDEX)
    record["cell"], record["centre"] = cells.make(0, 0, 0, 0), (6.4e6, 0.0, 0.0)
    record["radius_m"] = 1.0
    trees = trees_of(dict.fromkeys(Lane, build_forest(record)))
    view = ViewState(0.0, Ecef(np.array((1e7, 0.0, 0.0))), np.eye(3), 500.0, 640, 480)
    flags = {lane: np.zeros(1, np.uint8) for lane in Lane}
    chosen = select(trees, lens_of(view), flags, Thresholds(1.0, 1.0))
    motion = Motion(0.0, 0.0, 0.0, np.zeros(3), 0.0)
    limits = Thresholds(1.0, 1.0)
    seen = Situation([view], motion, 0.0, 1, trees, flags, limits, 0.0, chosen)
    Benefit().plan(replace(seen, bytes_per_s=1.0))
