# SPDX-License-Identifier: Apache-2.0
"""geopage's own pager, flown dry through a city of boxes by a virtual clock."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geopage.draw_list import DrawList
from geopage.settings import PagerSettings
from geopage.view import ViewState
from tiles.frames import Ints
from tiles.lanes import Lane
from viewer.cull import eye_of
from viewer.experiments.city import HIGH_M, City, tile_of
from viewer.experiments.pages import Flown, Flyer
from viewer.experiments.walks import DEEP_M, STEP_S, Walk, in_frustum

LOOK_EVERY = 10


def depth_px(focal_px: float) -> float:
    """Return the object threshold at which a box is drawn up to `DEEP_M` away."""
    return focal_px * HIGH_M / DEEP_M


@dataclass(slots=True)
class Culled:
    """Boxes, at each step where they were counted."""

    held: list[int] = field(default_factory=list)
    """in memory"""
    sent: list[int] = field(default_factory=list)
    """of these, they go to the GPU"""
    seen: list[int] = field(default_factory=list)
    """of these, they are in the view"""


class CityPager(Flyer):
    """A dry pager on a city's index."""

    def __init__(
        self, store: Path, city: City, walk: Walk, policy: str, budget_bytes: int
    ) -> None:
        self.walk, self.city, self.culled = walk, city, Culled()
        px = depth_px(walk.view(0).focal_px)
        settings = PagerSettings(px, budget_bytes=budget_bytes, policy=policy, fade_s=0.0)
        super().__init__(store, settings)
        leaf, place = tile_of(city)
        forest = self.pager.forests[Lane.OBJECTS]
        self._order = np.argsort(place, kind="stable")
        self._first = np.searchsorted(place[self._order], np.arange(len(leaf) + 1))
        self._centre, self._radius_m = forest.centre, forest.radius_m
        self._leaf_of = np.full(len(forest.records), -1)
        self._leaf_of[forest.row_of(leaf)] = np.arange(len(leaf))

    def walk_through(self) -> Flown:
        """Page the walk, and count what culling leaves."""
        views = (self.walk.view(i) for i in range(len(self.walk.place)))
        return self.fly(views, STEP_S, self._count)

    def _count(self, i: int, drawn: DrawList, view: ViewState) -> None:
        if i % LOOK_EVERY:
            return
        self.culled.held.append(len(self._boxes(self.held(Lane.OBJECTS))))
        planes = eye_of(view).planes
        away = self._centre[drawn.objects] - view.eye
        outside = (away @ planes.T < -self._radius_m[drawn.objects, None]).any(axis=1)
        sent = self._boxes(drawn.objects[~outside].astype(np.int64))
        self.culled.sent.append(len(sent))
        low, high = self.city.low[sent], self.city.high[sent]
        heading = float(self.walk.heading_rad[i])
        seen = in_frustum(low, high, self.walk.place[i], heading)
        self.culled.seen.append(int(seen.sum()))

    def _boxes(self, rows: Ints) -> Ints:
        """Return the boxes of tiles."""
        leaves = self._leaf_of[rows]
        parts = [
            self._order[self._first[k] : self._first[k + 1]] for k in leaves[leaves >= 0]
        ]
        return np.concatenate(parts) if parts else np.zeros(0, np.int64)
