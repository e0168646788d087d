# SPDX-License-Identifier: Apache-2.0
"""The five threads of a pager: they only loop, the logic is in what they step."""

import sys
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial

from geopage.handoff import Signal
from geopage.manager import TileManager
from geopage.priority_queue import PriorityQueue
from geopage.scene import SceneManager
from geopage.server import TileServer
from tiles.lanes import Lane

SCENE_PERIOD_S = 1 / 40
LEAST_PAUSE_S = 2e-3
ASIDE_S = 3e-4
SWITCH_INTERVAL_S = 1e-3
"""Longer than other threads hold the GIL at a time; see THREADS.md."""
CLOSE_S = 2.0


class Threads:
    """Starts, runs and ends the threads."""

    def __init__(
        self,
        scene: SceneManager,
        signal: Signal,
        managers: Mapping[Lane, TileManager],
        servers: Mapping[Lane, TileServer],
        queue: PriorityQueue,
    ) -> None:
        self.closed = threading.Event()
        self.wake_ups: dict[str, int] = {}
        """How often each thread has had something to do."""
        self._scene = scene
        self._signal = signal
        self._managers = managers
        self._servers = servers
        self._queue = queue
        self._threads: list[threading.Thread] = []
        self._error: BaseException | None = None
        self._interval_s = 0.0
        self._turn = threading.Lock()
        """Who thinks. Several that want the GIL at once hand it round among themselves,
        and the renderer gets it back only when its turn comes."""
        self.wants_gil: Callable[[], bool] = lambda: False
        """Says that the renderer's Python runs or would: nothing new begins then."""

    @property
    def running(self) -> bool:
        """Whether there are threads."""
        return bool(self._threads)

    def start(self) -> None:
        """Start the five threads."""
        for server in self._servers.values():
            server.source.close()  # opened by `step`; each thread opens its own
        self._interval_s = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        jobs: dict[str, Callable[[str], None]] = {"scene-manager": self._run_scene}
        for lane in Lane:
            jobs[f"{lane.name.lower()}-manager"] = partial(self._run_manager, lane)
            jobs[f"{lane.name.lower()}-server"] = partial(self._run_server, lane)
        self.wake_ups = dict.fromkeys(jobs, 0)
        self._threads = [
            threading.Thread(target=self._guard, args=job, name=job[0], daemon=True)
            for job in jobs.items()
        ]
        for thread in self._threads:
            thread.start()

    def _guard(self, name: str, job: Callable[[str], None]) -> None:
        """Run a thread's job; what it raises, the caller's next call raises."""
        try:
            job(name)
        except BaseException as error:
            self._error = self._error or error
            self._stop()

    def _run_scene(self, name: str) -> None:
        while True:
            # One more step says that the view has come to rest, or that a fade is over.
            self._signal.wait(self._scene.wait_s(time.monotonic()))
            if self.closed.is_set():
                return
            self.wake_ups[name] += 1
            start_s = time.monotonic()
            with self._turn:
                self._stand_aside()
                self._scene.step(start_s)
            left_s = SCENE_PERIOD_S - (time.monotonic() - start_s)
            self.closed.wait(max(left_s, LEAST_PAUSE_S))

    def _run_manager(self, lane: Lane, name: str) -> None:
        while self._managers[lane].signal.wait():
            self.wake_ups[name] += 1
            with self._turn:
                self._stand_aside()
                self._managers[lane].step()

    def _run_server(self, lane: Lane, name: str) -> None:
        server = self._servers[lane]
        try:
            while not self.closed.is_set():
                self._stand_aside()
                wait_s = server.step(time.monotonic())
                if wait_s is None:
                    self._queue.wait(lane)
                    self.wake_ups[name] += 1
                elif wait_s > 0:
                    self.closed.wait(wait_s)
        finally:
            server.source.close()

    def _stand_aside(self) -> None:
        while self.wants_gil() and not self.closed.is_set():
            time.sleep(ASIDE_S)

    def check(self) -> None:
        """Raise what a thread has raised."""
        if self._error is not None:
            raise self._error

    def _stop(self) -> None:
        self.closed.set()
        self._queue.close()
        self._signal.close()
        for manager in self._managers.values():
            manager.signal.close()

    def close(self) -> None:
        """Stop the threads, in less than two seconds, and close the servers' files."""
        self._stop()
        until_s = time.monotonic() + CLOSE_S
        for thread in self._threads:
            thread.join(max(until_s - time.monotonic(), 0.0))
        if self._threads:
            sys.setswitchinterval(self._interval_s)
        else:
            for server in self._servers.values():
                server.source.close()
        self._threads = []
