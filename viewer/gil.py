# SPDX-License-Identifier: Apache-2.0
"""Keep Python's lock while a frame's own Python runs, share it while GL works.

A thread that wants the lock can force its holder to let go after one switch interval.
A long interval lets the render thread finish its few hundred lines undisturbed; a short
one, while GL works without the lock, brings the lock back quickly afterwards.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

KEEP_S = 2e-3
SHARE_S = 1e-4


@contextmanager
def interval(seconds: float) -> Iterator[None]:
    """Set the switch interval for a while."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(seconds)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
