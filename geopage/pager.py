# SPDX-License-Identifier: Apache-2.0
"""The pager: views go in, draw lists and tiles to upload come out.

The caller's thread renders; it never waits here. Five threads do the rest, or `step`
does it all, once, in the caller's thread and by the caller's clock. `THREADS.md` says
who owns what.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from geopage import prediction
from geopage.draw_list import DrawList
from geopage.exchange import Exchange, Upload
from geopage.handoff import Signal, ViewSlot
from geopage.manager import TileManager
from geopage.policies.benefit import warm_up as warm_up_planner
from geopage.policies.registry import policy_of
from geopage.priority_queue import PriorityQueue
from geopage.residency import Residency
from geopage.scene import SceneInputs, SceneManager, empty_list
from geopage.selection import Thresholds, trees_of, warm_up
from geopage.servers import Supply, serve_until, servers_of
from geopage.settings import PagerSettings
from geopage.source import Line
from geopage.threads import Threads
from geopage.tile_state import State
from geopage.trace import TileTrace
from geopage.tree import U1, tree_bytes
from geopage.view import ViewState
from tiles.closing import Closing
from tiles.forest import build_forest
from tiles.frames import Ecef
from tiles.lanes import Lane
from tiles.store import Store


class Pager(Closing):
    """Pages the tiles of one store for one renderer.

    Parameters
    ----------
    store_path : path of a .geopage file
    settings : thresholds, budget, throttle, policy
    dry : read and decode nothing, for paging that nobody draws
    """

    def __init__(
        self,
        store_path: str | Path,
        settings: PagerSettings | None = None,
        *,
        dry: bool = False,
    ) -> None:
        self.settings = settings = settings or PagerSettings()
        with Store(store_path) as store:
            self.forests = {lane: build_forest(store.index(lane)) for lane in Lane}
        trees = trees_of(self.forests)
        limits = Thresholds(settings.threshold_px, settings.objects_px)
        self.faults: list[str] = []
        self._signal = Signal()
        self._views = ViewSlot(self._signal)
        self._queue = PriorityQueue(
            {lane: len(tree.parent) for lane, tree in trees.items()},
            one_line=settings.throttle is not None,
        )
        self.policy = policy_of(settings.policy)
        self._residency = Residency(
            trees, self._queue, settings.budget_bytes, self.policy.leaving
        )
        self._residency.charge_index(
            sum(f.nbytes + tree_bytes(trees[lane], f) for lane, f in self.forests.items())
            + self._queue.nbytes
        )
        self._managers = {
            lane: TileManager(lane, self._queue, self._residency, self._signal)
            for lane in Lane
        }
        self._exchange = Exchange(trees, self._queue, self._residency, self._signal)
        world = SceneInputs(self.forests, trees, settings.fade_s, settings.shutter_s)
        self._scene = SceneManager(
            world,
            self._views,
            self._signal,
            self._residency,
            self._managers,
            self.policy,
            limits,
        )
        warm_up()
        warm_up_planner()
        prediction.warm_up(self.forests[Lane.TERRAIN])
        self.line = Line(settings.throttle) if settings.throttle else None
        self._servers = servers_of(
            Supply(Path(store_path), self.line, dry),
            self.forests,
            self._queue,
            self._residency,
            self.faults,
        )
        nowhere = ViewState(0.0, Ecef(np.zeros(3)), np.eye(3), 1.0, 1, 1)
        self._first = empty_list(nowhere, limits)
        self._threads = Threads(
            self._scene, self._signal, self._managers, self._servers, self._queue
        )

    # What the renderer calls, in its own thread. None of these waits.

    def view(self, view: ViewState) -> None:
        """Say where the eye is now. Raises what a thread has raised."""
        self._threads.check()
        self._views.publish(view)

    def draw_list(self) -> DrawList:
        """Return the newest complete draw list; number 0 before all zones are there."""
        self._threads.check()
        return self._scene.lists.take() or self._first

    def take_uploads(self, max_bytes: int) -> list[Upload]:
        """Return decoded tiles, best rank first, of at most `max_bytes` (but one at least).

        Each must be answered by `uploaded`, or be given to `put_back`. Tiles that nobody
        wants any more are dropped.
        """
        return self._exchange.take_uploads(max_bytes)

    def put_back(self, items: Iterable[Upload]) -> None:
        """Give back tiles that were taken and not uploaded; they are ranked again."""
        self._exchange.put_back(items)

    def uploaded(self, lane: Lane, row: int) -> None:
        """Say that a tile can be drawn."""
        self._exchange.say(State.UPLOADED, lane, row)

    def releases(self, list_number: int) -> list[tuple[Lane, int]]:
        """Return the tiles that may be freed once list `list_number` is on the screen.

        Each must be answered by `released`.
        """
        return self._exchange.releases(list_number)

    def released(self, lane: Lane, row: int) -> None:
        """Say that a tile's slot is free."""
        self._exchange.say(State.ABSENT, lane, row)

    def set_limits(self, terrain_px: float, objects_px: float | None = None) -> None:
        """Draw with other thresholds from now on. Thread: any; the newest call counts.

        Parameters
        ----------
        terrain_px : largest screen error of terrain and of proxies
        objects_px : bounding dimension below which an object is left out; None: same
        """
        changed = replace(
            self.settings, threshold_px=terrain_px, object_threshold_px=objects_px
        )
        if changed == self.settings:
            return
        self.settings = changed
        self._scene.set_limits(Thresholds(changed.threshold_px, changed.objects_px))

    def set_policy(self, name: str) -> None:
        """Page by another policy from now on. Thread: any; the newest call counts.

        Parameters
        ----------
        name : one of `geopage.settings.POLICIES`
        """
        self.settings = replace(self.settings, policy=name)
        self.policy = policy_of(name)
        self._residency.leaving = self.policy.leaving
        self._scene.set_policy(self.policy)

    def destination(self, view: ViewState | None) -> None:
        """Say where the eye is going, so that it is loaded when nothing else is to be.

        None when it has arrived or goes elsewhere. Thread: any; the newest call counts.
        """
        self._scene.set_destination(view)

    def make_way_for(self, wants_gil: Callable[[], bool]) -> None:
        """Begin nothing while somebody needs the GIL; threads ask before each step."""
        self._threads.wants_gil = wants_gil

    def record(self, clock: Callable[[], float]) -> TileTrace:
        """Write down what becomes of each tile from now on; returns where.

        Parameters
        ----------
        clock : returns the flight's time, s; threads call it
        """
        counts = {lane: len(forest.records) for lane, forest in self.forests.items()}
        self._residency.trace = trace = TileTrace(counts, clock)
        return trace

    # What there is to know.

    @property
    def settled(self) -> bool:
        """Whether the newest view has all that it wants, and every fade is over."""
        complete, newest = self.complete, self._scene.lists.peek()
        return complete and newest is not None and newest.fade is None

    @property
    def complete(self) -> bool:
        """Whether the newest view has all that it wants, and nothing is on its way."""
        idle = self._scene.idle and not self._residency.in_flight
        newest = self._scene.lists.peek()  # last: it is of what made the manager idle
        return idle and newest is not None and newest.settled

    @property
    def counters(self) -> dict[str, int]:
        """Totals: tiles_loaded, bytes_read, tiles_cancelled, tiles_late, tiles_unused."""
        counted = self._residency.counters.as_dict()
        counted["tiles_unused"] += self._residency.unused_now()
        return counted

    @property
    def message(self) -> str:
        """One line while memory is too short for the threshold, else empty."""
        return self._scene.pressure.message

    def states(self, lane: Lane) -> U1:
        """Return where each tile of a lane is, (n,) `State`."""
        return self._residency.states(lane)

    def memory(self) -> dict[str, int]:
        """Return budget, index, resident, uploaded, in flight and peak, in bytes."""
        return self._residency.memory()

    # How it runs.

    def step(self, now_s: float) -> bool:
        """Do everything once, without threads; say whether anything was done."""
        done = self._think(now_s)
        waits = [server.step(now_s) for server in self._servers.values()]
        return done or any(wait_s is not None for wait_s in waits)

    def advance(self, now_s: float, end_s: float) -> None:
        """Do all that there is to do between two times of the caller's clock."""
        self._think(now_s)
        serve_until(self._servers.values(), now_s, end_s)

    def _think(self, now_s: float) -> bool:
        if self._threads.running:
            raise RuntimeError("step: expected a pager without threads, got a started one")
        done = self._scene.step(now_s)
        for manager in self._managers.values():
            manager.step()
        return done

    def start(self) -> None:
        """Start the five threads."""
        self._threads.start()

    @property
    def wake_ups(self) -> dict[str, int]:
        """How often each thread has had something to do."""
        return self._threads.wake_ups

    def close(self) -> None:
        """Stop the threads, in less than two seconds, and close the store."""
        self._threads.close()
