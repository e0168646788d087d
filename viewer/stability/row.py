# SPDX-License-Identifier: Apache-2.0
"""A row of the stability table, and what was found for it."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from viewer.stability.place import Place

HOLDS, FAILS = "holds", "FAILS"


@dataclass(frozen=True, slots=True)
class Finding:
    """What was measured for one row, now and here."""

    practical: float
    """Stress of the worst practical case"""
    ours: float
    """The measure there"""
    breaks_at: float = math.nan
    """Stress at which the method stops being right; NaN: it did not"""
    looked_to: float = math.nan
    """How far was looked, where it did not"""
    others: float = math.nan
    """The measure of the method that fails, in the same case; NaN: not measured"""
    note: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """One known way to fail."""

    name: str
    fails: str
    """What goes wrong, and in which method"""
    stress: str
    """What is made harder until it breaks, with its unit"""
    measure: str
    """What is measured meanwhile, with its unit"""
    allowed: float
    """The largest that is right"""
    find: Callable[[Place], Finding]
    more_is_harder: bool = True

    def margin(self, found: Finding) -> float:
        """Return how many times harder than the worst practical case it may get.

        Where it did not break: how many times harder was tried.
        """
        far = found.looked_to if math.isnan(found.breaks_at) else found.breaks_at
        near, far = (
            (found.practical, far) if self.more_is_harder else (far, found.practical)
        )
        return far / near if near else math.inf

    def verdict(self, found: Finding) -> str:
        """Say whether the method is right in the worst practical case."""
        right = found.ours <= self.allowed and not self.margin(found) < 1.0
        return HOLDS if right else FAILS


def first_bad(
    is_good: Callable[[float], bool], good: float, bad: float, steps: int = 12
) -> float:
    """Return, by bisection of logarithms, where something stops being good.

    Parameters
    ----------
    good, bad : from where, where it is known or hoped to be good, to where is looked

    Returns
    -------
    The least stress found to be bad; NaN where `bad` is good, `good` where that is bad
    """
    if is_good(bad):
        return math.nan
    if not is_good(good):
        return good
    low, high = math.log(good), math.log(bad)
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if is_good(math.exp(middle)) else (low, middle)
    return math.exp(high)
