# SPDX-License-Identifier: Apache-2.0
"""What is missing in a frame: pixels without a tile, objects without a proxy."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.screen_error import lens_of
from geopage.selection import Thresholds, everything, select, trees_of
from geopage.view import ViewState
from tiles.forest import Forest
from tiles.frames import WGS84_A_M, WGS84_B_M, Floats
from tiles.lanes import Lane
from viewer.renderer import Renderer

CHILDREN = np.arange(4)


def hole_pixels(renderer: Renderer, view: ViewState, lowest_m: float) -> int:
    """Count pixels of the last frame that should show the earth and show no tile.

    A pixel is a hole when its ray (float64) meets the ellipsoid lowered to `lowest_m`,
    the store's least height, and no tile or object was drawn there.
    """
    rays = rays_of(view, np.argwhere(renderer.read_empty()))
    return int(meets_ellipsoid(view, rays, lowest_m).sum())


def rays_of(view: ViewState, pixels: NDArray[np.int64]) -> Floats:
    """Return unit directions through pixel centres, (n, 3) ECEF axes.

    Parameters
    ----------
    pixels : (n, 2) row from the top and column
    """
    x = (pixels[:, 1] + 0.5 - view.width_px / 2) / view.focal_px
    y = (view.height_px / 2 - pixels[:, 0] - 0.5) / view.focal_px
    camera = np.stack([x, y, -np.ones_like(x)], axis=-1)
    camera /= np.linalg.norm(camera, axis=-1, keepdims=True)
    return np.asarray(camera @ view.rotation)


def meets_ellipsoid(view: ViewState, rays: Floats, height_m: float) -> Floats:
    """Say which rays from the eye, (n, 3) unit, meet the ellipsoid at a height."""
    axes = np.array([WGS84_A_M, WGS84_A_M, WGS84_B_M]) + height_m
    eye, ray = view.eye / axes, rays / axes
    along = ray @ eye
    square = (ray * ray).sum(axis=-1)
    inside = along**2 - square * (float(eye @ eye) - 1.0)
    return np.asarray((inside >= 0) & (along < 0))


class ObjectHoles:
    """Compares draw lists with what the thresholds demand of a view."""

    def __init__(self, forests: Mapping[Lane, Forest]) -> None:
        self._trees = trees_of(forests)
        self._flags = everything(self._trees)
        self._forest = forests[Lane.OBJECTS]

    def count(self, drawn: DrawList, view: ViewState) -> int:
        """Count demanded cells that neither the list's tiles nor its proxies show."""
        limits = Thresholds(drawn.threshold_px, drawn.object_threshold_px)
        lens = lens_of(view, sweep=drawn.sweep)
        wanted = select(self._trees, lens, self._flags, limits).draw_list(
            0, view, limits, settled=True
        )
        drawn = drawn.solid()
        shown = np.zeros(len(self._forest.parent), bool)
        shown[drawn.objects] = True
        below = self._children_of(drawn)
        rows = wanted.objects[self._in_picture(wanted.objects, view)]
        return sum(not self._is_shown(row, shown, below) for row in rows.tolist())

    def _in_picture(self, rows: NDArray[np.int32], view: ViewState) -> NDArray[np.bool_]:
        """Say which cells reach into the cone around the picture, (n,).

        A list is right for more than its own picture, but not the same beyond it.
        """
        away = self._forest.centre[rows] - view.eye
        along = away @ view.forward
        aside = np.sqrt(np.maximum((away**2).sum(axis=1) - along**2, 0.0))
        sine = math.sqrt(1 - view.corner_cos**2)
        reach_m = aside * view.corner_cos - along * sine
        return np.asarray(reach_m <= self._forest.radius_m[rows])

    def _children_of(self, drawn: DrawList) -> set[int]:
        """Return the cells that a drawn proxy stands for."""
        bits = (drawn.proxies[:, None] >> CHILDREN) & 1
        return set(self._forest.children[drawn.objects][bits > 0].tolist())

    def _is_shown(self, row: int, shown: np.ndarray, below: set[int]) -> bool:
        if shown[row] or (shown[self._descendants(row)]).any():
            return True
        while row >= 0:
            if row in below:
                return True
            row = int(self._forest.parent[row])
        return False

    def _descendants(self, row: int) -> list[int]:
        found, stack = [], [row]
        while stack:
            children = self._forest.children[stack.pop()]
            stack += [int(child) for child in children if child >= 0]
            found += [int(child) for child in children if child >= 0]
        return found
