# SPDX-License-Identifier: Apache-2.0
"""How fast tiles come, as measured by those who read them."""

import math

MEMORY_BYTES = 2e5
"""What came longer ago than so many bytes counts less than half."""


class LineRate:
    """Bytes a second while something is asked for.

    Thread: any; losing an update does no harm.
    """

    def __init__(self) -> None:
        self._bytes = self._seconds = 0.0
        self._last_s = -math.inf

    def timed(self, stored_bytes: int, asked_s: float, done_s: float) -> None:
        """Take in one tile: what is read side by side shares the time."""
        keep = math.exp(-stored_bytes / MEMORY_BYTES)
        busy_s = max(done_s - max(asked_s, self._last_s), 0.0)
        self._bytes = self._bytes * keep + stored_bytes
        self._seconds = self._seconds * keep + busy_s
        self._last_s = max(self._last_s, done_s)

    @property
    def bytes_per_s(self) -> float:
        """Return the rate, infinity before anything came or when it took no time."""
        return self._bytes / self._seconds if self._seconds else math.inf
