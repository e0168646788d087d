# SPDX-License-Identifier: Apache-2.0
"""Work in several processes, in order and bounded; no process is left behind."""

import ctypes
import multiprocessing
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import Any, Self, TypeVar

from tiles.errors import InputError, interrupts_held

J = TypeVar("J")
R = TypeVar("R")
AHEAD = 2
"""Jobs on their way for each process, so that neither they nor their results pile up"""


class Workers:
    """Processes that are started when first used, or none where one is enough.

    Thread: the one that made it.
    """

    def __init__(self, count: int, subject: str) -> None:
        """Take the number of processes, 0 for one per core, and what they work on."""
        self.count = count or os.cpu_count() or 1
        self._subject = subject
        self._pool: ProcessPoolExecutor | None = None
        self._strangers = set(multiprocessing.active_children())

    def run(self, work: Callable[[J], R], jobs: Iterable[J]) -> Generator[R]:
        """Do jobs and yield their results in the same order.

        Raises
        ------
        InputError
            Also when a process dies.
        """
        left = iter(jobs)
        if self.count <= 1:
            yield from map(work, left)
            return
        try:
            pending = deque(self._submitted(work, islice(left, AHEAD * self.count)))
            while pending:
                done = pending.popleft().result()
                pending.extend(self._submitted(work, islice(left, 1)))
                yield done
        except BrokenProcessPool as error:
            raise InputError(
                self._subject, "a worker process died", "run again with more memory"
            ) from error

    def _submitted(self, work: Callable[[J], R], jobs: Iterable[J]) -> list[Future[R]]:
        """Start the workers, deaf to Ctrl-C: the parent hears it and ends them."""
        ready = list(jobs)
        with interrupts_held():
            if self._pool is None:
                spawn = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(
                    self.count, spawn, initializer=die_with_parent
                )
            heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                return [self._pool.submit(work, job) for job in ready]
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


def die_with_parent() -> None:
    """Ask Linux to end this worker when its parent is killed."""
    if sys.platform == "linux":
        set_death_signal = 1
        ctypes.CDLL(None).prctl(set_death_signal, signal.SIGKILL)
