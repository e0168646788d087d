# SPDX-License-Identifier: Apache-2.0
"""What every row measures on: one store, opened once, in small pictures."""

from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from geopage.draw_list import DrawList
from geopage.screen_error import lens_of
from geopage.selection import Flags, Thresholds, everything, select, trees_of
from geopage.settings import MIB, PagerSettings
from geopage.tree import Tree
from geopage.view import ViewState
from tiles import cells
from tiles.forest import Forest
from tiles.lanes import Lane
from viewer.camera import focal_px
from viewer.drawn_surface import DrawnTiles
from viewer.holes import hole_pixels
from viewer.session import Picture, Session

SIZE_PX = (160, 120)
SCREEN_PX = (1280, 720)
"""Errors count in pixels of this picture, 60 degrees high."""
FOCAL_PX = focal_px(SCREEN_PX[1], np.radians(60.0))
BUDGET = 256 * MIB
FINE_LEVEL = 4


class Place:
    """A store with all that the rows ask of it. Thread: the one that made it."""

    def __init__(self, store: Path, *, quick: bool = False) -> None:
        self.store, self.quick = store, quick

    def count(self, whole: int, quick: int) -> int:
        """Return how many cases to try."""
        return quick if self.quick else whole

    @cached_property
    def session(self) -> Session:
        """Pager (standing still), renderer and surface."""
        settings = PagerSettings(budget_bytes=BUDGET, fade_s=0.0)
        return Session(self.store, settings, Picture(SIZE_PX))

    @cached_property
    def trees(self) -> dict[Lane, Tree]:
        """What the selection walks."""
        return trees_of(self.session.pager.forests)

    @cached_property
    def tiles(self) -> DrawnTiles:
        """The triangles of terrain tiles."""
        return DrawnTiles(self.session.store, self.ground)

    @property
    def ground(self) -> Forest:
        """The terrain's forest."""
        return self.forest(Lane.TERRAIN)

    def forest(self, lane: Lane) -> Forest:
        """Return the forest of a lane."""
        return self.session.pager.forests[lane]

    @cached_property
    def finest(self) -> tuple[float, float]:
        """Longitude and latitude, rad, of the middle of a cell of the deepest level."""
        west, south, east, north = cells.bounds_rad(self.ground.records["cell"][-1])
        return float(west + east) / 2, float(south + north) / 2

    def fine_spot(self, rng: np.random.Generator) -> tuple[float, float]:
        """Return a random place, rad, where the ground is finer than elsewhere."""
        cell = self.ground.records["cell"]
        level = cells.level(cell)
        fine = cell[level >= min(FINE_LEVEL, int(level.max()))]
        west, south, east, north = cells.bounds_rad(rng.choice(fine))
        return float(rng.uniform(west, east)), float(rng.uniform(south, north))

    def select(
        self, view: ViewState, threshold_px: float, uploaded: Flags | None = None
    ) -> DrawList:
        """Return what a view draws, of all tiles or of some."""
        limits = Thresholds(threshold_px, threshold_px)
        there = everything(self.trees) if uploaded is None else uploaded
        chosen = select(self.trees, lens_of(view), there, limits)
        return chosen.draw_list(1, view, limits, settled=uploaded is None)

    def draw(self, drawn: DrawList, view: ViewState) -> None:
        """Draw a list with all its tiles."""
        self.session.hold(drawn)
        self.session.renderer.draw(drawn, view)

    def holes(self, drawn: DrawList, view: ViewState, skirt: float = 1.0) -> int:
        """Draw a list and count the pixels that show the background through the ground.

        Parameters
        ----------
        skirt : times what the skirts' depths are
        """
        self.draw(replace(drawn, skirt_m=drawn.skirt_m * np.float32(skirt)), view)
        lowest_m = float(self.ground.records["min_height_m"][drawn.terrain].min())
        return hole_pixels(self.session.renderer, view, lowest_m)

    def close(self) -> None:
        """Give everything back."""
        if "session" in self.__dict__:
            self.session.close()
