# SPDX-License-Identifier: Apache-2.0
"""What a person may choose about paging."""

from dataclasses import dataclass

MIB = 2**20
POLICIES = ("benefit",)
"""Names of the ways to choose what is read next."""


@dataclass(frozen=True, slots=True)
class Throttle:
    """A slow disk or line, shared by both lanes."""

    mib_per_s: float
    latency_ms: float = 0.0

    def __post_init__(self) -> None:
        if not self.mib_per_s > 0:
            raise ValueError(f"throttle: expected more than 0 MiB/s, got {self.mib_per_s}")
        if not self.latency_ms >= 0:
            raise ValueError(f"throttle: expected 0 ms or more, got {self.latency_ms}")


@dataclass(frozen=True, slots=True)
class PagerSettings:
    """Thresholds, budget and reading, checked when made."""

    threshold_px: float = 2.0
    """Largest screen error of terrain and of proxies."""
    object_threshold_px: float | None = None
    """Bounding dimension on the screen below which an object is left out; None: same."""
    budget_bytes: int = 512 * MIB
    """Ceiling for indexes, tiles in flight, resident tiles and uploaded tiles together."""
    throttle: Throttle | None = None
    policy: str = "benefit"

    def __post_init__(self) -> None:
        for name in ("threshold_px", "object_threshold_px"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name}: expected more than 0, got {value}")
        if self.budget_bytes <= 0:
            raise ValueError(f"budget_bytes: expected more than 0, got {self.budget_bytes}")
        if self.policy not in POLICIES:
            raise ValueError(f"policy: expected one of {POLICIES}, got {self.policy!r}")

    @property
    def objects_px(self) -> float:
        """The object threshold, whether stated or taken over."""
        stated = self.object_threshold_px
        return self.threshold_px if stated is None else stated
