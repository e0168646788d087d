# SPDX-License-Identifier: Apache-2.0
"""What the operating system counts: memory, and time without a core."""

import os
import sys
from pathlib import Path

STATM = Path("/proc/self/statm")
SCHEDSTAT = Path("/proc/thread-self/schedstat")


def resident_bytes() -> int:
    """Return the process's resident bytes now, or its peak where only that is known."""
    if STATM.exists():
        return int(STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    if sys.platform == "win32":
        return 0
    import resource  # noqa: PLC0415  (not on Windows)

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def preempted_ns() -> int:
    """Return how long this thread has been ready to run without a core; 0 if not known."""
    try:
        with SCHEDSTAT.open("rb", buffering=0) as file:
            return int((file.read(64) or b"0 0").split()[1])
    except OSError:
        return 0
