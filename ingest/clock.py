# SPDX-License-Identifier: Apache-2.0
"""Where the time of an ingest goes."""

import time
from typing import Any


class Clock:
    """Wall-clock seconds by stage."""

    def __init__(self) -> None:
        self._start_s = self._lap_s = time.perf_counter()
        self.seconds_by_stage: dict[str, float] = {}

    def lap(self, stage: str) -> None:
        """End a stage that began where the one before ended."""
        now_s = time.perf_counter()
        before_s = self.seconds_by_stage.get(stage, 0.0)
        self.seconds_by_stage[stage] = round(before_s + now_s - self._lap_s, 2)
        self._lap_s = now_s

    def report(self, posts: int) -> dict[str, Any]:
        """Return seconds, seconds by stage, and posts per second of it all."""
        seconds = max(time.perf_counter() - self._start_s, 1e-3)
        return {
            "seconds": round(seconds, 2),
            "seconds_by_stage": self.seconds_by_stage,
            "posts_per_s": round(posts / seconds),
        }
