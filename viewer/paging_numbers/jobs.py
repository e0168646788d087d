# SPDX-License-Identifier: Apache-2.0
"""Replays of flights, several at a time."""

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeVar

from geopage.settings import PagerSettings, Throttle
from tiles.errors import InputError, interrupts_held
from tiles.store import Store
from tiles.surface import Surface
from viewer.paging import ideal_bytes, needed_mib_per_s, page_flight
from viewer.paging_numbers.routes import Route
from viewer.poses import Flight
from viewer.recorded import read_flight

J = TypeVar("J")
R = TypeVar("R")
Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Job:
    """A flight under one policy, over a line of one speed."""

    route: Route
    size_px: tuple[int, int]
    settings: PagerSettings
    frame_s: float
    times: float | None = None
    """of the line that the flight needs; None: as fast as can be"""
    ideal_bytes: int = 0


@lru_cache(maxsize=1)
def flight_of(route: Route, size_px: tuple[int, int]) -> Flight:
    """Return a route, ready to be flown.

    Raises
    ------
    InputError
    """
    path = read_flight(route.path)
    with Store(route.store) as store:
        surface = Surface(store)
        if not len(surface.forest.records):
            advice = "run `geopage ingest terrain` first"
            raise InputError(route.store, "holds no terrain", advice)
        return Flight(path, surface, size_px)


def ideal_of(job: Job) -> int:
    """Return the bytes of the distinct tiles that a flight's views draw."""
    return ideal_bytes(job.route.store, flight_of(job.route, job.size_px), job.settings)


def replay(job: Job) -> Json:
    """Page a flight; return its figures, JSON-ready."""
    flight = flight_of(job.route, job.size_px)
    settings = job.settings
    if job.times:
        needed = needed_mib_per_s(job.ideal_bytes, flight.path.duration_s)
        settings = replace(settings, throttle=Throttle(needed * job.times))
    found = page_flight(
        job.route.store, flight, settings, lambda t_s: None, frame_s=job.frame_s
    )
    found |= {"flight": job.route.title, "times": job.times, "ideal_bytes": job.ideal_bytes}
    found |= {"threshold_px": settings.threshold_px, "store": job.route.store.stem}
    if job.ideal_bytes:
        found["bytes_over_ideal"] = found["bytes_read"] / job.ideal_bytes
    return found


def each(
    work: Callable[[J], R], jobs: Sequence[J], progress: Callable[[float], None]
) -> list[R]:
    """Do jobs, one for each core at a time; return what they found, in their order.

    Raises
    ------
    InputError
        Also when a process dies.
    """
    found: dict[int, R] = {}
    for i, one in _done(work, jobs):
        found[i] = one
        progress(len(found))
    return [found[i] for i in range(len(jobs))]


def _done(work: Callable[[J], R], jobs: Sequence[J]) -> Iterator[tuple[int, R]]:
    """Yield numbers and results of jobs as they come."""
    count = min(os.cpu_count() or 1, len(jobs))
    if count <= 1:
        yield from enumerate(map(work, jobs))
        return
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, spawn, initializer=bound)
    strangers = set(multiprocessing.active_children())
    try:
        with interrupts_held():
            numbers = {pool.submit(work, job): i for i, job in enumerate(jobs)}
        for one in as_completed(numbers):
            yield numbers[one], one.result()
    except BrokenProcessPool as error:
        advice = "run again with more memory"
        raise InputError("replays", "a worker process died", advice) from error
    except BaseException:
        for worker in set(multiprocessing.active_children()) - strangers:
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def bound() -> None:
    """Let the parent alone hear Ctrl-C, and end this worker when the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        set_death_signal = 1
        ctypes.CDLL(None).prctl(set_death_signal, signal.SIGKILL)
