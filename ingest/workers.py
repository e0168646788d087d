# SPDX-License-Identifier: Apache-2.0
"""Work in several processes, bounded; no process is left behind."""

import ctypes
import multiprocessing
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from itertools import islice
from typing import Any, Self, TypeVar

from tiles.errors import UnfinishedError, interrupts_held

J = TypeVar("J")
R = TypeVar("R")
AHEAD = 2
"""Jobs on their way for each process, so that neither they nor their results pile up"""


class Workers:
    """Processes that are started when first used, or none where one is enough.

    Thread: the one that made it.
    """

    def __init__(
        self, count: int, subject: str, equip: Callable[[], Any] | None = None
    ) -> None:
        """Take what to start.

        Parameters
        ----------
        count : processes, 0 for one per core
        subject : what they work on
        equip : makes what every job of a process is given besides; called once in each
        """
        self.count = count or os.cpu_count() or 1
        self._subject, self._equip = subject, equip
        self._pool: ProcessPoolExecutor | None = None
        self._strangers = set(multiprocessing.active_children())

    def run(
        self, work: Callable[..., R], jobs: Iterable[J], *, in_order: bool = True
    ) -> Generator[R]:
        """Do jobs and yield their results, in the same order or as they come.

        Raises
        ------
        UnfinishedError
            When a process dies.
        """
        left = iter(jobs)
        if self.count <= 1:
            tools = self._equip and cache(self._equip)
            yield from (_done(work, job, tools) for job in left)
            return
        try:
            pending = deque(self._submitted(work, islice(left, AHEAD * self.count)))
            while pending:
                one = pending[0] if in_order else _first_done(pending)
                done = one.result()
                pending.remove(one)
                pending.extend(self._submitted(work, islice(left, 1)))
                yield done
        except BrokenProcessPool as error:
            advice = "make more memory free and run the same command again to go on"
            raise UnfinishedError(self._subject, "a worker process died", advice) from error

    def _submitted(self, work: Callable[..., R], jobs: Iterable[J]) -> list[Future[R]]:
        """Start the workers, deaf to Ctrl-C: the parent hears it and ends them."""
        ready = list(jobs)
        with interrupts_held():
            if self._pool is None:
                spawn = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(
                    self.count, spawn, initializer=_begin, initargs=(self._equip,)
                )
            heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                return [self._pool.submit(_do, work, job) for job in ready]
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, heard)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: Any) -> None:
        if self._pool is None:
            return
        if kind is not None:
            for worker in set(multiprocessing.active_children()) - self._strangers:
                worker.terminate()
        self._pool.shutdown(cancel_futures=True)


def _first_done(pending: Iterable[Future[R]]) -> Future[R]:
    return next(iter(wait(pending, return_when=FIRST_COMPLETED).done))


_Tools = Callable[[], Any] | None
_kept: dict[str, _Tools] = {}
"""Of a worker: makes its tools at first, and then returns them"""


def _begin(equip: _Tools) -> None:
    """Begin as a worker."""
    die_with_parent()
    _kept["tools"] = equip and cache(equip)


def _do(work: Callable[..., R], job: J) -> R:
    """Do a job in a worker."""
    return _done(work, job, _kept["tools"])


def _done(work: Callable[..., R], job: J, tools: _Tools) -> R:
    return work(job, tools()) if tools else work(job)


def die_with_parent() -> None:
    """Ask Linux to end this worker when its parent is killed."""
    if sys.platform == "linux":
        set_death_signal = 1
        ctypes.CDLL(None).prctl(set_death_signal, signal.SIGKILL)
