# SPDX-License-Identifier: Apache-2.0
"""Less memory than a view needs: tiles must not come and go for ever."""

from geopage.screen_error import lens_of
from geopage.selection import Thresholds, everything, select
from geopage.settings import PagerSettings
from geopage.view import ViewState
from tiles.lanes import Lane
from viewer.camera import Pose, view_state
from viewer.flight import FRAME_S
from viewer.paging import Paging
from viewer.stability.place import SCREEN_PX, Place
from viewer.stability.row import Finding, Row, first_bad

THRESHOLD_PX = 1.0
REST_S, WATCH_S = 8.0, 2.0
"""How long a still view may take to come to rest, and how long it is watched then"""
SHORT, SHORTEST = 4.0, 256.0
HEIGHT_M, PITCH_RAD = 300.0, -0.5


def still_view(place: Place) -> ViewState:
    """Return a view over the finest ground."""
    ground_m = place.session.surface.height_at(*place.finest)
    return view_state(Pose(*place.finest, ground_m + HEIGHT_M, 0.0, PITCH_RAD), SCREEN_PX)


def stir(place: Place, view: ViewState, short: float) -> tuple[float, float]:
    """Return how a still view stirs after a while, and by what its threshold was raised.

    Parameters
    ----------
    short : times that the view's tiles would take of the memory that there is for them

    Returns
    -------
    tiles loaded a second, one more where the view is not settled; and the factor
    """
    limits = Thresholds(THRESHOLD_PX, THRESHOLD_PX)
    chosen = select(place.trees, lens_of(view), everything(place.trees), limits)
    ground = place.trees[Lane.TERRAIN]
    coarsest = int(ground.memory_bytes[ground.roots].sum())
    least = place.session.pager.memory()["index_bytes"] + 2 * coarsest
    budget = least + round(chosen.needed_bytes / short)
    paging = Paging(place.store, PagerSettings(THRESHOLD_PX, budget_bytes=budget))
    loaded = 0
    with paging.pager as pager:
        for i in range(round((REST_S + WATCH_S) / FRAME_S)):
            drawn = paging.frame(view)
            pager.advance(i * FRAME_S, (i + 1) * FRAME_S)
            if i == round(REST_S / FRAME_S):
                loaded = pager.counters["tiles_loaded"]
        loads_s = (pager.counters["tiles_loaded"] - loaded) / WATCH_S
        return loads_s + (not drawn.settled), drawn.threshold_px / THRESHOLD_PX


def thrash(place: Place) -> Finding:
    """Take memory away until a view that stands still goes on loading, or waits."""
    view = still_view(place)
    ours, factor = stir(place, view, SHORT)
    steps = place.count(6, 3)
    breaks = first_bad(lambda s: stir(place, view, s)[0] == 0.0, SHORT, SHORTEST, steps)
    note = f"with a quarter of the memory the threshold rises {factor:.2f} times, and stays"
    return Finding(SHORT, ours, breaks, SHORTEST, note=note)


ROWS = (
    Row(
        "thrash",
        "tiles of one view evict each other for ever: a fixed threshold",
        "memory that a view needs / memory that there is",
        "tiles loaded a second by a view that stands still; 1 more if not complete",
        0.0,
        thrash,
    ),
)
