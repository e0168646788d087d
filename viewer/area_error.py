# SPDX-License-Identifier: Apache-2.0
"""The screen error of a draw list, by area of the picture, without drawing it.

Rays through a coarse grid of pixels meet the ellipsoid, raised to the ground's height
under the eye. The drawn tile there has a measured error in metres, and at the ray's
depth that is so many pixels. Relief and what it hides are left out; so are buildings.
"""

import numpy as np

from geopage.draw_list import DrawList
from geopage.tree import F8, Tree
from geopage.view import ViewState
from tiles import cells, geodesy
from tiles.frames import WGS84_A_M, WGS84_B_M, Ecef, Ints

COLUMNS, LINES = 32, 18
LEAST_DEPTH_M = 1e-3


def screen_errors_px(
    tree: Tree, cell: Ints, drawn: DrawList, view: ViewState, ground_m: float
) -> F8:
    """Return the screen error at each ray that meets the ground, (n,).

    A tile with nothing finer below it counts as 0: no pager can do better.

    Parameters
    ----------
    tree : the terrain's
    cell : (n,) int64 ids of its rows
    drawn : list that is on the screen
    view : with which it is drawn
    ground_m : height of the ground above the ellipsoid
    """
    away = to_ground(view, ground_m)
    points = Ecef(view.eye + away)
    if not len(points):
        return np.zeros(0)
    lon, lat, _ = geodesy.to_geodetic(points)
    at = cells.cell_at(lon, lat, cells.MAX_LEVEL)
    first = cells.range_min(cell[drawn.terrain])
    order = np.argsort(first)
    rows = drawn.terrain[order[np.searchsorted(first[order], at, side="right") - 1]]
    depth_m = np.maximum(away @ view.forward, LEAST_DEPTH_M)
    finer = (tree.children[rows] >= 0).all(axis=1)
    return np.asarray(tree.error_m[rows] * view.focal_px / depth_m * finer)


def to_ground(view: ViewState, ground_m: float) -> F8:
    """Return the ways from the eye to the ground along the rays that meet it, (n, 3) m."""
    x = ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) * view.width_px / view.focal_px
    y = ((np.arange(LINES) + 0.5) / LINES - 0.5) * view.height_px / view.focal_px
    across, up = np.meshgrid(x, y)
    rays = np.stack((across, up, -np.ones_like(across)), -1).reshape(-1, 3) @ view.rotation
    stretch = np.array((1.0, 1.0, (WGS84_A_M + ground_m) / (WGS84_B_M + ground_m)))
    eye, rays_s = view.eye * stretch, rays * stretch
    a = (rays_s**2).sum(axis=1)
    b = rays_s @ eye
    c = float(eye @ eye) - (WGS84_A_M + ground_m) ** 2
    under = b * b - a * c
    meets = (under >= 0) & (b < 0) & (c > 0)
    t = c / (-b[meets] + np.sqrt(under[meets]))
    return np.asarray(rays[meets] * t[:, None])


def by_area(errors_px: F8, percent: float) -> float:
    """Return the percentile of a frame's errors; 0 where it shows only sky."""
    return float(np.percentile(errors_px, percent)) if len(errors_px) else 0.0
