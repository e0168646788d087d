# SPDX-License-Identifier: Apache-2.0
"""Keep Python's lock while a frame's own Python runs, share it while GL works.

A thread that wants the lock can force its holder to let go after one switch interval.
A long interval lets the render thread finish its few hundred lines undisturbed; a short
one, while GL works without the lock, brings the lock back quickly afterwards. Threads
that ask `is_kept` before they begin something do not even take it in between.
"""

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager

KEEP_S = 2e-3
SHARE_S = 2e-5
_kept = [False]
PR_SET_TIMERSLACK, SLACK_NS = 29, 1000


def be_prompt() -> None:
    """Let this thread's waits for the lock end when they should.

    Linux may end a wait 50 us late, to save power: more than the interval itself.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, SLACK_NS, 0, 0, 0)


def is_kept() -> bool:
    """Say whether a frame's own Python runs now. Thread: any."""
    return _kept[-1]


@contextmanager
def interval(seconds: float) -> Iterator[None]:
    """Set the switch interval for a while; KEEP_S says that a frame's Python runs."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(seconds)
    _kept.append(seconds == KEEP_S)
    try:
        yield
    finally:
        _kept.pop()
        sys.setswitchinterval(before)
