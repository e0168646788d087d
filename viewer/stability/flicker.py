# SPDX-License-Identifier: Apache-2.0
"""Detail that comes and goes while the eye hardly moves."""

import math
from itertools import pairwise

import numpy as np

from geopage.screen_error import lens_of
from geopage.selection import Selection, Thresholds, everything, select
from geopage.view import ViewState
from tiles.lanes import Lane
from viewer import cull
from viewer.camera import FOV_RAD, Pose, view_state
from viewer.stability.place import SCREEN_PX, SIZE_PX, Place
from viewer.stability.row import Finding, Row, first_bad

LIMITS = Thresholds(2.0, 2.0)
STEPS = 24
"""Poses in one swing up and down"""
LOWEST_M, HIGHEST_M = 100.0, 1e6
SWING, WIDEST = 0.005, 0.5
LINES = round(SIZE_PX[0] * SCREEN_PX[1] / SCREEN_PX[0])
CROP = np.s_[(SIZE_PX[1] - LINES) // 2 : (SIZE_PX[1] + LINES) // 2]
"""Lines of the small picture that show what the screen does"""
WIDE_RAD = 2.0 * math.atan(math.tan(FOV_RAD / 2) * SIZE_PX[1] / LINES)
Parts = dict[int, int]


def ground(chosen: Selection) -> Parts:
    """Return the tiles of the ground that are drawn, each with what of it."""
    return dict.fromkeys(chosen.terrain.tolist(), 1)


def buildings(chosen: Selection) -> Parts:
    """Return the object tiles that are drawn, each with what of it."""
    parts = 2 * chosen.proxies.astype(np.int64) + chosen.own
    return dict(zip(chosen.objects.tolist(), parts.tolist(), strict=True))


class Swings:
    """An eye that goes up and down once a second, above the finest ground."""

    def __init__(self, place: Place, lane: Lane) -> None:
        self._place, self._lane = place, lane
        self._key = {Lane.TERRAIN: ground, Lane.OBJECTS: buildings}[lane]
        self._flags = everything(place.trees)
        self._ground_m = place.session.surface.height_at(*place.finest)

    def view(self, above_m: float) -> ViewState:
        """Return a view straight down."""
        return view_state(self._pose(above_m), SCREEN_PX)

    def _pose(self, above_m: float) -> Pose:
        return Pose(*self._place.finest, self._ground_m + above_m, 0.0, -math.pi / 2)

    def choose(self, above_m: float, before: Selection | None) -> Selection:
        """Select as the scene manager does, with the last selection's memory or without."""
        made = before.made if before else None
        lens = lens_of(self.view(above_m))
        return select(self._place.trees, lens, self._flags, LIMITS, made)

    def switches(self, above_m: float, swing: float, *, remembers: bool = True) -> int:
        """Count how often the picture's tiles change in one swing, after a first one."""
        last, changes = self.choose(above_m, None), 0
        for i in range(1, 2 * STEPS + 1):
            height_m = above_m * (1.0 + swing * math.sin(2 * math.pi * i / STEPS))
            now = self.choose(height_m, last if remembers else None)
            changes += i > STEPS and self.differ(last, now, height_m)
            last = now
        return changes

    def differ(self, before: Selection, now: Selection, above_m: float) -> bool:
        """Say whether two selections differ in something that the picture shows."""
        parts = self._key(before).items() ^ self._key(now).items()
        eye, forest = cull.eye_of(self.view(above_m)), self._place.forest(self._lane)
        rows = {
            row
            for row, _ in parts
            if cull.is_visible(forest.centre[row], forest.radius_m[row], eye)
        }
        return bool(rows) and any(rows & self.seen(one, above_m) for one in (before, now))

    def seen(self, chosen: Selection, above_m: float) -> set[int]:
        """Return the tiles of which the picture shows a pixel."""
        view = view_state(self._pose(above_m), SIZE_PX, WIDE_RAD)
        drawn = chosen.draw_list(1, view, LIMITS, settled=True)
        self._place.draw(drawn, view)
        ids = np.unique(self._place.session.renderer.read_ids()[CROP])
        if self._lane is Lane.TERRAIN:
            return set(drawn.terrain[ids[ids > 0] - 1].tolist())
        return set(drawn.objects[(-1 - ids[ids < 0].astype(np.int64)) // 65536].tolist())

    def heights_m(self, most: int) -> list[float]:
        """Return heights at which the picture changes, spread over all heights."""
        found = []
        tried = np.geomspace(LOWEST_M, HIGHEST_M, 10 * most).tolist()
        for low, high in pairwise(tried):
            ends = self.choose(low, None), self.choose(high, None)
            if self.differ(*ends, low):
                found.append(self._switch_m(low, high))
        return found[:: max(1, len(found) // most)]

    def _switch_m(self, low: float, high: float) -> float:
        """Return, to a thousandth, a height between two at which the picture changes."""
        while high > low * 1.001:
            middle = math.sqrt(low * high)
            below = self.differ(self.choose(low, None), self.choose(middle, None), low)
            low, high = (low, middle) if below else (middle, high)
        return math.sqrt(low * high)


def flicker(place: Place, lane: Lane) -> Finding:
    """Swing at heights where detail changes, more and more, until it flickers."""
    swings = Swings(place, lane)
    heights_m = swings.heights_m(place.count(10, 5))
    ours = max((swings.switches(h, SWING) for h in heights_m), default=0)
    others = max((swings.switches(h, SWING, remembers=False) for h in heights_m), default=0)
    breaks = [
        first_bad(lambda s, h=h: swings.switches(h, s) <= 1, SWING, WIDEST, 5)  # type: ignore[misc]
        for h in heights_m
    ]
    known = [one for one in breaks if not math.isnan(one)]
    least = 100.0 * min(known, default=math.nan)
    note = f"{len(heights_m)} heights at which detail changes, {LOWEST_M:g} m to 1,000 km"
    return Finding(SWING * 100, ours, least, WIDEST * 100, others, note)


def _row(name: str, fails: str, lane: Lane) -> Row:
    return Row(
        name,
        fails,
        "swing of the eye's height, once a second, %",
        "times a second that the picture's tiles change",
        1.0,
        lambda place: flicker(place, lane),
    )


ROWS = (
    _row("flicker of the ground", "tiles switch to and fro: no hysteresis", Lane.TERRAIN),
    _row("flicker of buildings", "blocks switch to and fro: no hysteresis", Lane.OBJECTS),
)
