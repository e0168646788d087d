# SPDX-License-Identifier: Apache-2.0
"""How long it takes to choose what a view draws."""

import math
import time
from collections.abc import Mapping

import numpy as np

from geopage.screen_error import Lens, lens_of
from geopage.selection import Thresholds, everything, select, trees_of
from geopage.tree import Tree
from tiles.forest import Forest, build_forest
from tiles.frames import Ecef, Floats
from tiles.geodesy import to_geodetic
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from viewer.camera import Pose, view_state
from viewer.stability.globe import globe
from viewer.tally import Json

VIEWS, SIZE_PX, THRESHOLD_PX = 400, (1280, 720), 1.0
STEEPEST_RAD, FLATTEST_RAD = -math.pi / 2, math.radians(10.0)


def selection_times(forests: Mapping[Lane, Forest]) -> list[Json]:
    """Time selections over a store's whole index, and over a large one that is made up.

    Returns
    -------
    For each index its `index` name and `cells`, and `p50_ms`, `p99_ms` and `max_ms` of
    processor time of one selection of everything that a view draws
    """
    empty = build_forest(np.zeros(0, INDEX))
    whole = trees_of({Lane.OBJECTS: empty}) | {Lane.TERRAIN: globe()}
    indexes = {"the store's": trees_of(forests), "a globe without relief": whole}
    found = []
    for name, trees in indexes.items():
        spent = times_ms(trees)
        p50, p99 = np.percentile(spent, (50, 99)).tolist()
        count = sum(len(tree.parent) for tree in trees.values())
        times = {"p50_ms": p50, "p99_ms": p99, "max_ms": float(spent.max())}
        found.append({"index": name, "cells": count, "views": VIEWS, **times})
    return found


def times_ms(trees: Mapping[Lane, Tree]) -> Floats:
    """Return the times of single selections, each the next one's past, as in a flight."""
    there, limits = everything(trees), Thresholds(THRESHOLD_PX, THRESHOLD_PX)
    lenses = lenses_over(trees[Lane.TERRAIN])
    made = select(trees, lenses[0], there, limits).made
    spent = []
    for lens in lenses:
        start_ns = time.thread_time_ns()
        made = select(trees, lens, there, limits, made).made
        spent.append((time.thread_time_ns() - start_ns) / 1e6)
    return np.array(spent)


def lenses_over(tree: Tree) -> list[Lens]:
    """Return views from 10 m to 10,000 km over random leaves, looking anywhere."""
    rng, found = np.random.default_rng(5), []
    bare = np.flatnonzero((tree.children < 0).all(axis=1))
    for row in rng.choice(bare, VIEWS).tolist():
        lon, lat, ground_m = (float(x) for x in to_geodetic(Ecef(tree.centre[row])))
        height_m = max(ground_m, 0.0) + 10.0 ** float(rng.uniform(1, 7))
        heading, pitch = rng.uniform((0.0, STEEPEST_RAD), (2 * math.pi, FLATTEST_RAD))
        pose = Pose(lon, lat, height_m, float(heading), float(pitch))
        found.append(lens_of(view_state(pose, SIZE_PX)))
    return found
