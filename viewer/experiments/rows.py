# SPDX-License-Identifier: Apache-2.0
"""What an experiment finds: rows of one table, charts, and a few sentences."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

LESS, MORE, SAME = "less", "more", "same"
ALIKE = 0.1
"""Within this share of the paper's value, ours is called alike."""


@dataclass(frozen=True, slots=True)
class Row:
    """One quantity under one condition: what the paper printed, and what we found."""

    experiment: str
    condition: str
    quantity: str
    unit: str
    paper: float | None
    """None: the paper does not give it"""
    source: str
    """section or table of the paper"""
    ours: float | None
    """None: it can't be had here; the note says why"""
    note: str = ""
    good: str = ""
    """LESS or MORE is better, or SAME is aimed at; empty where the two don't compare"""
    timed: bool = False
    """It depends on this machine's speed, so it differs from run to run"""

    @property
    def against(self) -> str:
        """Say how ours stands against the paper, where the two compare."""
        if self.paper is None or self.ours is None or not self.good:
            return ""
        if abs(self.ours - self.paper) <= ALIKE * abs(self.paper):
            return "alike"
        if self.good == SAME:
            return "differs"
        return "better" if (self.ours < self.paper) == (self.good == LESS) else "worse"


@dataclass(frozen=True, slots=True)
class Series:
    """One curve."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    paper: bool = False
    """The paper's own values"""


@dataclass(frozen=True, slots=True)
class Chart:
    """One chart, as `chart.draw` takes it."""

    name: str
    title: str
    x: str
    y: str
    series: Sequence[Series]
    log_x: bool = False
    log_y: bool = False
    bars: Sequence[str] = ()
    """names along x, where the series are bars"""


@dataclass(slots=True)
class Found:
    """All that one experiment comes to."""

    rows: list[Row] = field(default_factory=list)
    charts: list[Chart] = field(default_factory=list)
    says: list[str] = field(default_factory=list)
    """sentences that read the figures"""


Progress = Callable[[float], None]
"""Takes how many per cent of an experiment are done."""
