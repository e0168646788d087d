# SPDX-License-Identifier: Apache-2.0
"""How the globe is cut: what a view costs at each latitude."""

import math

import numpy as np

from geopage.screen_error import lens_of
from geopage.selection import everything, trees_of
from geopage.terrain_selection import select_terrain
from geopage.tree import Tree
from tiles import bounds, cells, zones
from tiles.forest import build_forest
from tiles.frames import WGS84_A_M, Floats, Ints
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from viewer.camera import Pose, view_state
from viewer.stability.place import SCREEN_PX, Place
from viewer.stability.row import Finding, Row

LEVELS, PER_EDGE = 6, 256
HEIGHT_M, THRESHOLD_PX = 300e3, 4.0
HERE_DEG = 45.0


def globe(*, by_level: bool = False) -> Tree:
    """Return the index of a globe whose cells err by their true edge / 256.

    Parameters
    ----------
    by_level : by their edge at the equator instead, wherever they are
    """
    found = [cells.make(np.arange(zones.COUNT), 0, 0, 0)]
    for _ in range(LEVELS - 1):
        found.append(cells.children(found[-1]).ravel())
    cell = np.sort(np.concatenate(found))
    records = np.zeros(len(cell), INDEX)
    records["cell"], records["row"] = cell, 1
    records["centre"], radius_m = bounds.sphere_of(cell, 0.0, 0.0)
    records["radius_m"] = np.ceil(radius_m)
    records["error_m"] = edges_m(cell, by_level=by_level) / PER_EDGE
    return trees_of({Lane.TERRAIN: build_forest(records)})[Lane.TERRAIN]


def edges_m(cell: Ints, *, by_level: bool = False) -> Floats:
    """Return the root of each cell's area, or, by level alone, its edge at the equator."""
    west, south, east, north = cells.bounds_rad(cell)
    if by_level:
        return np.asarray(WGS84_A_M * (north - south))
    area = (east - west) * np.abs(np.sin(north) - np.sin(south))
    return np.asarray(WGS84_A_M * np.sqrt(area))


def tiles_at(tree: Tree, lat_deg: float) -> int:
    """Return how many tiles a view straight down draws."""
    view = view_state(
        Pose(0.1, math.radians(lat_deg), HEIGHT_M, 0.0, -math.pi / 2), SCREEN_PX
    )
    there = everything({Lane.TERRAIN: tree})[Lane.TERRAIN]
    before = np.zeros(len(tree.parent), np.uint8)
    drawn = select_terrain(tree, lens_of(view), THRESHOLD_PX, there, before).drawn
    return len(drawn)


def cost(place: Place) -> Finding:
    """Compare what a view draws at all latitudes with what it draws at 45 degrees."""
    lat_deg = 90.0 - np.geomspace(1e-6, 90.0, place.count(60, 20))
    ratios = []
    for by_level in (False, True):
        tree = globe(by_level=by_level)
        drawn = [tiles_at(tree, lat) for lat in lat_deg.tolist()]
        ratios.append(np.array(drawn) / tiles_at(tree, HERE_DEG))
    worst = float(lat_deg[ratios[0].argmax()])
    bad = np.flatnonzero(ratios[0] > MOST)
    breaks = float(lat_deg[bad].min()) if len(bad) else math.nan
    note = (
        f"most at {worst:.4g} degrees; a globe without relief, from {HEIGHT_M / 1e3:g} km"
    )
    return Finding(90.0, float(ratios[0].max()), breaks, 90.0, float(ratios[1].max()), note)


MOST = 1.5
ROWS = (
    Row(
        "poles, cost",
        "cells get narrow, so many more are drawn: error bounds by level alone",
        "latitude, degrees",
        "tiles drawn / tiles drawn at 45 degrees",
        MOST,
        cost,
    ),
)
