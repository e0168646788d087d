# SPDX-License-Identifier: Apache-2.0
"""Failure: thrashing. A view that needs more memory than there is loads for ever."""

from dataclasses import replace
from pathlib import Path

import pytest

from geopage.selection import ideal
from geopage.view import ViewState
from tests.geopage.trial import PLAIN, Trial, approach
from tests.geopage.worlds import SPOT
from tiles.lanes import Lane
from viewer.flight import FRAME_S
from viewer.stability.site import Site

FINE = replace(PLAIN, threshold_px=0.3)
HEIGHT_M, REST_S = 3e6, 6.0


def needed_bytes(trial: Trial, view: ViewState) -> int:
    """Return the memory of all that a view draws when all is there."""
    settings = trial.pager.settings
    drawn = ideal(trial.pager.forests, view, settings.threshold_px, settings.objects_px)
    return sum(
        int(trial.trees[lane].memory_bytes[rows].sum())
        for lane, rows in ((Lane.TERRAIN, drawn.terrain), (Lane.OBJECTS, drawn.objects))
    )


@pytest.mark.parametrize("share", [0.25, 0.5, 1.0, 2.0])
def test_thrashing_ends_when_the_view_stands_still(wide_path: Path, share: float) -> None:
    site = Site(*SPOT)
    view = site.view(HEIGHT_M)
    with Trial(wide_path, FINE) as trial:
        room_bytes = int(needed_bytes(trial, view) * share)
        budget_bytes = trial.pager.memory()["index_bytes"] + room_bytes
    with Trial(wide_path, replace(FINE, budget_bytes=budget_bytes)) as trial:
        trial.fly(approach(site, HEIGHT_M))
        for _ in range(round(REST_S / FRAME_S)):
            drawn = trial.frame(replace(view, t_s=trial.now_s))
        trial.check()
        assert sum(trial.seen.loads[-round(1.0 / FRAME_S) :]) == 0
        assert drawn.settled
        assert (drawn.threshold_px > FINE.threshold_px) == (share <= 1.0)


def test_zones_that_find_no_room_at_first_come_in_the_end(wide_path: Path) -> None:
    """Evictions must not wait for a list that itself waits for the room."""
    view = Site(*SPOT).view(HEIGHT_M)
    with Trial(wide_path, FINE) as trial:
        land = trial.trees[Lane.TERRAIN]
        zones_bytes = int(land.memory_bytes[land.roots].sum())
        budget_bytes = trial.pager.memory()["index_bytes"] + 3 * zones_bytes
    with Trial(wide_path, replace(FINE, budget_bytes=budget_bytes)) as trial:
        pager, zones = trial.pager, land.roots.tolist()
        # The renderer says of all but the zones that they are there, as if it had
        # had no time for those.
        for i in range(200):
            pager.view(view)
            pager.advance(i * FRAME_S, (i + 1) * FRAME_S)
            taken = pager.take_uploads(2**30)
            late = [item for item in taken if item.row in zones and i < 20]
            pager.put_back(late)
            for item in taken:
                if item not in late:
                    pager.uploaded(item.lane, item.row)
            for lane, row in pager.releases(pager.draw_list().number):
                pager.released(lane, row)
        assert pager.draw_list().number
