# SPDX-License-Identifier: Apache-2.0
"""The methods that `geopage bench` compares, all on the same engine and data.

A method says what to draw for a view and a threshold. Settled, that is what it selects
when every tile is there; paced, the pager flies it. A method that the engine can't fly
has no paced mode, and one that differs only in motion has no settled one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from geopage.draw_list import DrawList
from geopage.selection import ideal
from geopage.settings import DETAILS, PagerSettings
from geopage.view import ViewState
from tiles.forest import Forest
from tiles.lanes import Lane

SETTLED, PACED = "settled", "paced"
Forests = Mapping[Lane, Forest]


@dataclass(frozen=True, slots=True)
class Method:
    """One way to choose what is drawn."""

    name: str
    about: str
    object_ratio: float = 1.0
    """Object threshold / threshold"""
    has_proxies: bool = True
    detail: str = DETAILS[0]

    @property
    def modes(self) -> tuple[str, ...]:
        """In which modes the method can be measured."""
        settled = (SETTLED,) if self.detail == DETAILS[0] else ()
        return (*settled, PACED) if self.has_proxies else settled

    def settings(self, threshold_px: float, budget_bytes: int) -> PagerSettings:
        """Return what the pager needs to fly the method."""
        objects_px = self.object_ratio * threshold_px
        return PagerSettings(threshold_px, objects_px, budget_bytes, detail=self.detail)

    def draw_list(self, forests: Forests, view: ViewState, threshold_px: float) -> DrawList:
        """Return what the method draws when every tile is there."""
        chosen = forests if self.has_proxies else without_proxies(forests)
        return ideal(chosen, view, threshold_px, self.object_ratio * threshold_px)


METHODS = (
    Method("geopage", "terrain, proxies and buildings at the same threshold"),
    Method(
        "buildings at 10 x",
        "buildings only where they span 10 thresholds, their proxies before: Davis and"
        " others, 1999, used 1 px for proxies and 10 px for buildings",
        object_ratio=10.0,
    ),
    Method(
        "without proxies",
        "buildings that span the threshold, and nothing for those that don't",
        has_proxies=False,
    ),
    Method(
        "by size and speed",
        "less detail where things move fast across the screen: Funkhouser, Sequin and"
        " Teller, 1992, section 5.1; when nothing moves it is geopage",
        detail=DETAILS[1],
    ),
)


def that_differ(methods: Sequence[Method], forests: Forests) -> list[Method]:
    """Return the methods but those about buildings where there are none."""
    if len(forests[Lane.OBJECTS].records):
        return list(methods)
    return [one for one in methods if one.has_proxies and one.object_ratio == 1.0]


def without_proxies(forests: Forests) -> dict[Lane, Forest]:
    """Return forests in which no object tile has a proxy to draw."""
    objects = forests[Lane.OBJECTS]
    records = objects.records.copy()
    records["proxies"], records["proxy_dimension_m"] = 0, 0.0
    return {**forests, Lane.OBJECTS: replace(objects, records=records)}
