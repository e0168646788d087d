# SPDX-License-Identifier: Apache-2.0
"""What a view would draw at other thresholds, counted without drawing it."""

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.pager import Pager
from geopage.prediction import motion_of, predict
from geopage.screen_error import lens_of, px_per_m
from geopage.selection import Thresholds, everything, select, trees_of
from geopage.view import ViewState
from tiles.kernels import brief
from tiles.lanes import Lane
from viewer.cull import Eye, Lists, eye_of, has_whole_skirts, is_visible, terrain_runs
from viewer.cull_objects import CHILDREN, count_above
from viewer.frame_budget import Load
from viewer.renderer import Renderer
from viewer.runs import MOST_RUNS

AHEAD_S = 0.25
"""About how long it takes until other thresholds show."""


class Forecast:
    """Counts for views of one store, of which the renderer has some tiles."""

    def __init__(self, pager: Pager, renderer: Renderer) -> None:
        self._renderer = renderer
        self._trees = trees_of(pager.forests)
        self._there = everything(self._trees)

    def load(self, view: ViewState, limits: Thresholds) -> Load:
        """Return what a view draws when all that it wants is there."""
        chosen = select(self._trees, lens_of(view), self._there, limits)
        return self.count(chosen.draw_list(1, view, limits, settled=True), view)

    def count(self, drawn: DrawList, view: ViewState) -> Load:
        """Return what is in the picture of a list's tiles.

        A tile that is not uploaded counts as many triangles as those of its lane that
        are, on average.
        """
        eye = eye_of(view, drawn.sweep)
        lists = self._renderer.lists
        meshes = drawn.rungs(), drawn.skirt_m
        ground = count_terrain(lists(Lane.TERRAIN, drawn.terrain), meshes, eye)
        things = count_objects(
            lists(Lane.OBJECTS, drawn.objects),
            (drawn.own, drawn.proxies, self._renderer.arena.pool.records),
            eye,
            float(drawn.object_threshold_px),
        )
        draws = sum(known + missing for known, missing, _ in (ground, things))
        triangles = sum(
            n * (1 + missing / max(known, 1)) for known, missing, n in (ground, things)
        )
        return Load(triangles, draws)


def ahead_of(views: list[ViewState], floor_m: float = 0.0) -> ViewState:
    """Return the view `AHEAD_S` after the last of some views, oldest first."""
    motion = motion_of(views, floor_m)
    return views[-1] if motion is None else predict(views[-1], motion, AHEAD_S)


@brief
def count_terrain(
    lists: Lists, meshes: tuple[NDArray[np.uint8], NDArray[np.float32]], eye: Eye
) -> tuple[int, int, int]:
    """Return draws of visible tiles that are uploaded, tiles that are not, triangles."""
    known, missing, indices = 0, 0, 0
    runs, whole = np.empty((MOST_RUNS, 2), np.int64), has_whole_skirts(lists, eye)
    for entry in range(len(lists.rows)):
        row, skirt_m = lists.rows[entry], float(meshes[1][entry])
        if not is_visible(lists.centre[row], lists.radius_m[row] + skirt_m, eye):
            continue
        if lists.slots[row]["uploaded"] == 0:
            missing += 1
            continue
        deep_m = np.inf if whole else skirt_m
        count = terrain_runs(lists, row, meshes[0][entry], deep_m, eye, runs)
        known += count
        indices += runs[:count, 1].sum()
    return known, missing, indices // 3


@brief
def count_objects(
    lists: Lists,
    parts: tuple[NDArray[np.bool_], NDArray[np.uint8], NDArray[np.void]],
    eye: Eye,
    threshold_px: float,
) -> tuple[int, int, int]:
    """Return the visible parts that are uploaded, those that are not, and triangles."""
    own, proxies, pool = parts
    known, missing, indices = 0, 0, 0
    for entry in range(len(lists.rows)):
        row = lists.rows[entry]
        centre, radius = lists.centre[row], lists.radius_m[row]
        if not is_visible(centre, radius, eye):
            continue
        slot = lists.slots[row]
        for child in range(CHILDREN):
            if proxies[entry] >> child & 1:
                known += slot["uploaded"]
                missing += 1 - slot["uploaded"]
                indices += slot["uploaded"] * slot["proxy_count"][child]
        if own[entry] and slot["uploaded"] == 0:
            missing += 1
        elif own[entry]:
            scale = px_per_m(eye.lens, centre[0], centre[1], centre[2], radius)
            seen = count_above(pool, slot, threshold_px / scale)
            if seen > 0:
                known += 1
                indices += pool[slot["pool_start"] + seen - 1]["index_end"]
    return known, missing, indices // 3
