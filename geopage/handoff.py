# SPDX-License-Identifier: Apache-2.0
"""Handing the newest value from one thread to another, without ever waiting for it.

`TripleBuffer` holds three values at a time: the one that the taker still uses, the
newest complete one, and the one that the publisher is making. Values are immutable and
handing on is one reference assignment, which Python makes indivisible, so neither side
has a lock to wait for: both take constant time, and a value that nobody took in time is
replaced, never queued.

`ViewSlot` holds the newest view and the few before it, and wakes whoever waits for it.
"""

import contextlib
import math
import threading
import time
from collections import deque
from typing import Generic, TypeVar

import numpy as np

from geopage.view import ViewState

T = TypeVar("T")
HISTORY = 48
"""Views kept to tell velocity from: 0.3 s at 144 Hz."""


class TripleBuffer(Generic[T]):
    """The newest of a stream of immutable values. One publisher, one taker."""

    def __init__(self, first: T) -> None:
        self._newest = first
        self._in_use = first

    def publish(self, value: T) -> None:
        """Make `value` the newest."""
        self._newest = value

    def take(self) -> T:
        """Return the newest value; it stays in use until the next call."""
        self._in_use = self._newest
        return self._in_use

    def peek(self) -> T:
        """Return the newest value without taking it. Thread: any."""
        return self._newest


class Signal:
    """A flag that is raised by anybody and lowered by the one thread that waits.

    Raising takes no lock that another thread could hold while it has no core: the
    renderer raises flags between two frames and must not wait there.
    """

    def __init__(self) -> None:
        self._flag: deque[None] = deque(maxlen=1)
        self._gate = threading.Lock()
        self._gate.acquire()
        self._closed = False

    def set(self) -> None:
        """Raise the flag and wake the waiting thread.

        What is to be seen must be there before the call: a flag that is already up costs
        nothing, and who lowers it looks afterwards.
        """
        if not self._flag:
            self._flag.append(None)
            self._open()

    def _open(self) -> None:
        """Let the waiting thread look again; an open gate stays open."""
        with contextlib.suppress(RuntimeError):
            self._gate.release()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the flag; True when it is raised and nothing is closed."""
        end = math.inf if timeout_s is None else time.monotonic() + timeout_s
        while not (self._flag or self._closed):
            left_s = end - time.monotonic()
            if left_s <= 0:
                break
            self._gate.acquire(timeout=-1 if math.isinf(left_s) else left_s)
        return bool(self._flag) and not self._closed

    def clear(self) -> bool:
        """Lower the flag and say whether it was raised."""
        try:
            self._flag.pop()
        except IndexError:
            return False
        return True

    @property
    def closed(self) -> bool:
        """Whether every wait has ended for good."""
        return self._closed

    @property
    def raised(self) -> bool:
        """Whether there is something to do."""
        return bool(self._flag)

    def close(self) -> None:
        """End every wait, now and later."""
        self._closed = True
        self._open()


class ViewSlot:
    """The newest view. A view like the one before wakes nobody once it is dealt with."""

    def __init__(self, signal: Signal) -> None:
        self._signal = signal
        self._views: deque[ViewState] = deque(maxlen=HISTORY)
        self._rested: ViewState | None = None

    def publish(self, view: ViewState) -> None:
        """Hand on a view; never waits longer than a thread needs to raise a flag."""
        rested = self._rested
        self._views.append(view)
        if rested is None or not same_pose(rested, view):
            self._signal.set()

    def history(self) -> list[ViewState]:
        """Return the last views, oldest first."""
        return list(self._views)

    def rest(self, view: ViewState | None) -> None:
        """Say which pose has been dealt with at rest; None: the view moves."""
        self._rested = view


def same_pose(a: ViewState, b: ViewState) -> bool:
    """Say whether two views see the same, whenever they were taken."""
    sizes = (a.focal_px, a.width_px, a.height_px), (b.focal_px, b.width_px, b.height_px)
    same_eye = np.array_equal(a.eye, b.eye)
    return bool(
        sizes[0] == sizes[1] and same_eye and np.array_equal(a.rotation, b.rotation)
    )
