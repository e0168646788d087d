# SPDX-License-Identifier: Apache-2.0
"""What a person may choose about paging."""

from dataclasses import dataclass

MIB = 2**20
POLICIES = ("benefit", "demand", "vgis", "vgis-centre", "mmr", "review", "berkeley")
"""Names of the ways to choose what is read next: see `geopage.policies`."""
REPLAYED = (*POLICIES, "vgis-stepwise", "strict", "oracle")
"""With those only to compare with: VGIS before it skipped levels, the way of today's
engines, and the one that has to know the flight beforehand."""
DETAILS = ("size", "size-and-speed")
"""What the screen error is held against: the threshold; or, where that is more, how far
things move across the screen in `SHUTTER_S`."""
SHUTTER_S = 0.1
"""About a frame of the Berkeley walkthrough, which measured speed in pixels a frame (its
frames took 0.10 to 0.34 s: Funkhouser, Sequin, Teller 1992, tables 3 and 4)."""
FADE_S = 0.25
LONGEST_FADE_S = 5.0
"""What fades out keeps its memory so long."""


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
    fade_s: float = FADE_S
    """How long objects take to turn into others; 0: they swap."""
    detail: str = DETAILS[0]

    def __post_init__(self) -> None:
        for name in ("threshold_px", "object_threshold_px"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name}: expected more than 0, got {value}")
        if not 0 <= self.fade_s <= LONGEST_FADE_S:
            raise ValueError(
                f"fade_s: expected 0 to {LONGEST_FADE_S:g} s, got {self.fade_s}"
            )
        if self.budget_bytes <= 0:
            raise ValueError(f"budget_bytes: expected more than 0, got {self.budget_bytes}")
        if self.policy not in REPLAYED:
            raise ValueError(f"policy: expected one of {REPLAYED}, got {self.policy!r}")
        if self.detail not in DETAILS:
            raise ValueError(f"detail: expected one of {DETAILS}, got {self.detail!r}")

    @property
    def shutter_s(self) -> float:
        """Time whose motion on the screen hides detail; 0 when speed does not count."""
        return SHUTTER_S if self.detail == "size-and-speed" else 0.0

    @property
    def objects_px(self) -> float:
        """The object threshold, whether stated or taken over."""
        stated = self.object_threshold_px
        return self.threshold_px if stated is None else stated
