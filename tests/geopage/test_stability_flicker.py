# SPDX-License-Identifier: Apache-2.0
"""Failure: flicker. Detail comes and goes as the eye sways about where it changes."""

import math
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from geopage.draw_list import DrawList
from geopage.screen_error import is_hidden, lens_of
from geopage.selection import Thresholds, everything, select
from geopage.transitions import OWN
from geopage.view import ViewState
from tests.geopage.trial import Trial
from tests.geopage.worlds import SPOT
from tiles.lanes import Lane
from viewer.flight import FRAME_S
from viewer.stability.row import first_bad
from viewer.stability.site import Site

SWAY, HEIGHTS = 0.005, 8
HERTZ = 2.0
"""How often the eye goes back and forth in a second."""
WELL = 0.9
SETTLED_S, SWAYING_S = 1 / HERTZ, 1.5
"""To and fro once, in which what is needed on either side comes; then it counts."""
Part = tuple[Lane, int, int]
"""Lane, row, and which part of a tile."""


def test_a_sway_about_a_threshold_switches_no_tile_more_than_once_a_second(
    wide_path: Path,
) -> None:
    site, tried = Site(*SPOT), 0
    with Trial(wide_path) as trial:
        for height_m in heights_of_change(trial, site, HEIGHTS):
            tried += 1
            trial.settle(site.view(height_m, t_s=trial.now_s))
            changes, last = Counter[Part](), set[Part]()
            for i in range(round((SETTLED_S + SWAYING_S) / FRAME_S)):
                more = SWAY * math.sin(2 * math.pi * HERTZ * i * FRAME_S)
                view = site.view(height_m * (1 + more), t_s=trial.now_s)
                shown = parts_of(trial.frame(view))
                if i * FRAME_S > SETTLED_S:
                    changes.update(
                        part for part in shown ^ last if is_in_picture(trial, part, view)
                    )
                last = shown
            assert max(changes.values(), default=0) <= SWAYING_S
        trial.check()
    assert tried > 3


def heights_of_change(trial: Trial, site: Site, count: int) -> Iterator[float]:
    """Find heights just above which another picture is right than just below."""
    ends = np.geomspace(3e6, 30.0, count + 1)
    for high_m, low_m in pairwise(ends.tolist()):
        above = right_parts(trial, site.view(high_m))
        found_m = first_bad(
            lambda low, above=above: not differ(trial, above, site.view(1 / low)),
            1 / high_m,
            1 / low_m,
        )
        if not math.isnan(found_m):
            yield 1 / found_m


def right_parts(trial: Trial, view: ViewState) -> set[Part]:
    """Return what a view draws when all is there."""
    settings = trial.pager.settings
    limits = Thresholds(settings.threshold_px, settings.objects_px)
    chosen = select(trial.trees, lens_of(view), everything(trial.trees), limits)
    return parts_of(chosen.draw_list(1, view, limits, settled=True))


def differ(trial: Trial, parts: set[Part], view: ViewState) -> bool:
    """Say whether another view draws something else in its picture."""
    changed = parts ^ right_parts(trial, view)
    return any(is_in_picture(trial, part, view) for part in changed)


def parts_of(drawn: DrawList) -> set[Part]:
    """Return what a list draws, part by part."""
    bits = (drawn.proxies | drawn.own * OWN).tolist()
    parts = zip(drawn.objects.tolist(), bits, strict=True)
    return {(Lane.TERRAIN, row, 0) for row in drawn.terrain.tolist()} | {
        (Lane.OBJECTS, row, k) for row, part in parts for k in range(5) if part >> k & 1
    }


def is_in_picture(trial: Trial, part: Part, view: ViewState) -> bool:
    """Say whether the sphere of a part's cell reaches well into the picture's cone.

    What the planet hides does not, nor what only touches the edge or the horizon: detail
    changes there as it comes into sight.
    """
    lane, row, k = part
    tree = trial.trees[lane]
    if lane is Lane.OBJECTS and k < 4:
        row = int(tree.children[row, k])  # what the proxy stands for
    x, y, z = (tree.centre[row] - view.eye).tolist()
    radius_m = WELL * float(tree.radius_m[row])
    along = float(np.dot((x, y, z), view.forward))
    aside = math.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    sine = math.sqrt(1 - view.corner_cos**2)
    if aside * view.corner_cos - along * sine > radius_m:
        return False
    return not is_hidden(lens_of(view), x, y, z, radius_m)
