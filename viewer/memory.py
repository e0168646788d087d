# SPDX-License-Identifier: Apache-2.0
"""What the operating system counts: memory, and time without a core."""

import ctypes
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


class Preemption:
    """How long the thread that made this has been ready to run without a core.

    Reading it keeps the GIL: a frame that measures its waits must not make some.
    """

    def __init__(self) -> None:
        self._file = SCHEDSTAT.open("rb", buffering=0) if SCHEDSTAT.exists() else None
        self._text = ctypes.create_string_buffer(64)
        self._pread = ctypes.PyDLL(None).pread if self._file else None

    def ns(self) -> int:
        """Return the time so far, 0 where the system doesn't tell."""
        if self._pread is None or self._file is None:
            return 0
        size = self._pread(self._file.fileno(), self._text, 63, 0)
        return int(self._text.raw[: max(size, 0)].split()[1]) if size > 0 else 0

    def close(self) -> None:
        """Close the file."""
        if self._file:
            self._file.close()
