# SPDX-License-Identifier: Apache-2.0
"""The scene manager: the newest view becomes a draw list and two lists of wants."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geopage.draw_list import DrawList
from geopage.handoff import Signal, TripleBuffer, ViewSlot
from geopage.manager import TileManager
from geopage.policies.protocol import PageRequests, Plan, Policy, Situation
from geopage.prediction import (
    Motion,
    ground_under,
    height_of,
    motion_of,
    predict,
    sweep_of,
)
from geopage.pressure import MemoryPressure
from geopage.residency import Residency
from geopage.screen_error import TURN_AHEAD_S, Lens, lens_of
from geopage.selection import Flags, Selection, Thresholds, select
from geopage.transitions import Transitions
from geopage.tree import U1, Tree
from geopage.view import ViewState
from tiles.forest import Forest, Rows
from tiles.lanes import Lane

REST_S = 0.3
"""A view that nobody replaces for so long has come to rest."""
LIST_AGE_S = 0.08
"""How old a list may be while it is drawn: a few frames."""


@dataclass(frozen=True, slots=True)
class SceneInputs:
    """What is selected from; does not change while a pager lives."""

    forests: Mapping[Lane, Forest]
    trees: Mapping[Lane, Tree]
    fade_s: float
    """how long objects take to turn into others"""
    shutter_s: float
    """time whose motion on the screen hides detail; 0: none"""


class SceneManager:
    """Selects for the newest view and for predicted ones. Thread: scene manager."""

    def __init__(
        self,
        world: SceneInputs,
        views: ViewSlot,
        signal: Signal,
        residency: Residency,
        managers: Mapping[Lane, TileManager],
        policy: Policy,
        limits: Thresholds,
    ) -> None:
        self.lists: TripleBuffer[DrawList | None] = TripleBuffer(None)
        room_bytes = residency.budget_bytes - residency.index_bytes - residency.pinned_bytes
        self.pressure = MemoryPressure(room_bytes)
        self._world = world
        self._views = views
        self._signal = signal
        self._residency = residency
        self._managers = managers
        self._policy = policy
        self._limits = self._limits_before = limits
        self._previous: Selection | None = None
        self._newest: ViewState | None = None
        self._newest_s = 0.0
        self._transitions = Transitions(world.fade_s)
        self._moving = False
        self._busy = False
        self._whole = False
        self._destination: ViewState | None = None

    def set_policy(self, policy: Policy) -> None:
        """Plan by another policy from now on; the newest counts. Thread: any."""
        self._policy = policy
        self._signal.set()

    def set_destination(self, view: ViewState | None) -> None:
        """Say where the eye is going, or that nobody knows. Thread: any."""
        self._destination = view
        self._signal.set()

    def set_limits(self, limits: Thresholds) -> None:
        """Select for other thresholds from now on; the newest counts. Thread: any."""
        self._limits = limits
        self._signal.set()

    def step(self, now_s: float) -> bool:
        """Publish a draw list for the newest view, if anything has changed.

        Parameters
        ----------
        now_s : any clock; a view that is not replaced for `REST_S` has come to rest
        """
        stopped = self._moving and now_s - self._newest_s >= REST_S
        faded = now_s >= self._transitions.ends_s
        self._busy = True  # before the flag goes down
        try:
            asked = self._signal.clear() or stopped or faded
            history = self._views.history() if asked else []
            if history:
                self._select(history, now_s)
            return bool(history)
        finally:
            self._busy = False

    @property
    def idle(self) -> bool:
        """Whether the newest list is of all that has been said. Thread: any."""
        return not (self._signal.raised or self._busy)

    def _select(self, history: list[ViewState], now_s: float) -> None:
        view = history[-1]
        if view is not self._newest:
            self._newest, self._newest_s = view, now_s
        floor_m = ground_under(self._world.forests[Lane.TERRAIN], view.eye)
        rests = now_s - self._newest_s >= REST_S
        motion = None if rests else motion_of(history, floor_m)
        self._moving = motion is not None
        number, uploaded = self._residency.snapshot()
        limits = self._thresholds()
        chosen = self._choose(view, motion, uploaded, limits)
        world = self._world
        plan = self._policy.plan(
            Situation(
                history,
                motion,
                floor_m,
                number,
                world.trees,
                uploaded,
                limits,
                world.shutter_s,
                chosen,
                self._destination,
                self._residency.rate.bytes_per_s,
            )
        )
        self._book(number, chosen, plan)
        waiting = self._request(plan)
        adjusted = self.pressure.update(chosen.needed_bytes, view)
        settled = not (waiting or adjusted or motion)
        if self._has_globe(uploaded):
            self._book_drawn(chosen)
            sweep = sweep_of(view, motion, self._world.shutter_s)
            newest = chosen.draw_list(number, view, limits, sweep, settled=settled)
            self._publish(newest, uploaded[Lane.OBJECTS], now_s)
        else:
            self._residency.undrawn = number
        self._views.rest(None if motion else view)
        if adjusted:
            self._signal.set()

    def _thresholds(self) -> Thresholds:
        """Return the newest thresholds, raised when memory is short."""
        limits = self._limits
        if limits is not self._limits_before:
            self._limits_before = limits
            self.pressure.try_again()
        return limits.times(self.pressure.factor)

    def wait_s(self, now_s: float) -> float | None:
        """Return after which time to step again although nothing new was said."""
        ends_s = (self._newest_s + REST_S) if self._moving else math.inf
        left_s = min(ends_s, self._transitions.ends_s) - now_s
        return None if math.isinf(left_s) else max(left_s, 0.0)

    def _publish(self, newest: DrawList, uploaded: U1, now_s: float) -> None:
        """Hand on the list; what fades out in it may go as soon as a prediction may."""
        drawn = self._transitions.blend(newest, uploaded, now_s)
        self._residency.used(Lane.OBJECTS, drawn.objects, drawn.number - 1)
        self.lists.publish(drawn)

    def _choose(
        self, view: ViewState, motion: Motion | None, uploaded: Flags, limits: Thresholds
    ) -> Selection:
        # Stuck: finer tiles from before fill the memory that the coarser ones need.
        stuck = any(self._residency.stuck.values())
        before = None if stuck or self._previous is None else self._previous.made
        lens = self._lens(view, motion)
        ahead = self._when_drawn(view, motion)
        self._previous = select(self._world.trees, lens, uploaded, limits, before, ahead)
        return self._previous

    def _lens(self, view: ViewState, motion: Motion | None, aside_rad: float = 0.0) -> Lens:
        sweep = sweep_of(view, motion, self._world.shutter_s)
        turn_rad_s = motion.turn_rad_s if motion else 0.0
        return lens_of(view, turn_rad_s + aside_rad / TURN_AHEAD_S, sweep=sweep)

    def _when_drawn(self, view: ViewState, motion: Motion | None) -> Lens | None:
        """Return the view while its list is drawn, where things grow until then.

        What is in the newest picture must not be outside of that view's cone.
        """
        if motion is None:
            return None
        soon = predict(view, motion, LIST_AGE_S)
        closer = np.linalg.norm(soon.eye) < np.linalg.norm(view.eye)
        if not closer:
            return None
        moved_m = float(np.linalg.norm(soon.eye - view.eye))
        return self._lens(soon, motion, moved_m / height_of(view, motion.floor_m))

    def _book(self, number: int, chosen: Selection, plan: Plan) -> None:
        """Tell the residency what this list uses; predictions count as one list older."""
        for lane in Lane:
            self._residency.used(lane, chosen.keep[lane], number)
            for ahead in plan.keep:
                self._residency.used(lane, ahead[lane], number - 1)

    def _book_drawn(self, chosen: Selection) -> None:
        for lane, rows in ((Lane.TERRAIN, chosen.terrain), (Lane.OBJECTS, chosen.objects)):
            self._residency.drew(lane, rows, chosen.wants[lane].rows)

    def _request(self, plan: Plan) -> bool:
        """Hand each lane's wants to its manager; say whether the newest view has any."""
        waiting = False
        for lane, manager in self._managers.items():
            wants = self._possible(lane, plan.requests[lane])
            manager.inbox.publish(wants)
            manager.signal.set()
            waiting |= wants.now > 0
        return waiting

    def _possible(self, lane: Lane, wants: PageRequests) -> PageRequests:
        """Leave out tiles that have failed."""
        if not self._residency.has_failures:
            return wants
        possible = ~self._residency.failed(lane, wants.rows)
        now = int(possible[: wants.now].sum())
        return PageRequests(wants.rows[possible], wants.ranks[possible], now)

    def _has_globe(self, uploaded: Flags) -> bool:
        """Say whether all zones can be drawn, as far as they can be had at all."""
        if not self._whole:  # then it stays so: they are pinned
            roots: Rows = self._world.trees[Lane.TERRAIN].roots
            there = uploaded[Lane.TERRAIN][roots] > 0
            there |= self._residency.failed(Lane.TERRAIN, roots)
            self._whole = bool(there.all())
        return self._whole


def empty_list(view: ViewState, limits: Thresholds) -> DrawList:
    """Return the list before the first one, number 0."""
    rows, bits = np.zeros(0, np.int32), np.zeros(0, np.uint8)
    no, none_m = np.zeros(0, np.bool_), np.zeros(0, np.float32)
    both = limits.terrain_px, limits.objects_px
    return DrawList(0, view, rows, none_m, no, rows, no, bits, *both, settled=False)
