# SPDX-License-Identifier: Apache-2.0
"""Work that nobody needs any more."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from geopage.residency import Key
from geopage.screen_error import lens_of
from geopage.selection import Thresholds, everything, select
from geopage.settings import PagerSettings
from geopage.view import ViewState
from viewer.flight import FRAME_S
from viewer.paging import Paging
from viewer.stability.place import Place
from viewer.stability.row import Finding, Row, first_bad
from viewer.stability.site import Site, tiles_a_frame

JUMPS_HZ, FASTEST_HZ, IN_FLIGHT = 5.0, 30.0, 2.0
JUMPS, NEAR_M, FAR_M = 10, 300.0, 3e6
TILES, FEW_BYTES = 10.0, 8_000
"""What the line carries in a frame, and what is taken over: decoded tiles pile up."""


def stale(place: Place) -> Finding:
    """Jump to and fro more and more often while decoded tiles pile up."""
    site = Site(*place.finest, place.session.surface.height_at(*place.finest))

    def tiles(per_s: float) -> float:
        return stale_uploads_after_a_jump(place.store, site, per_s)

    steps = place.count(3, 1)
    breaks = first_bad(lambda hz: tiles(hz) <= IN_FLIGHT, JUMPS_HZ, FASTEST_HZ, steps)
    return Finding(JUMPS_HZ, tiles(JUMPS_HZ), breaks, FASTEST_HZ)


def stale_uploads_after_a_jump(store: Path, site: Site, per_s: float = 5.0) -> int:
    """Jump away and home; at home all is there, so nothing is to be done.

    Returns
    -------
    Most tiles of no use to the view that were uploaded after the first frame of one of
    ten jumps, while decoded tiles of the view before pile up: at most the 2 that the
    servers were reading.
    """
    settings = PagerSettings(fade_s=0.0, throttle=tiles_a_frame(store, TILES))
    most, paging, home = 0, Paging(store, settings), site.view(NEAR_M)
    with paging.pager as pager:
        now_s = paging.settle(home)
        while not pager.complete:  # what is asked for early comes too
            now_s = show(paging, home, now_s)
        paging.upload_bytes = FEW_BYTES
        for jump in range(JUMPS):
            away = replace(site, lon_rad=site.lon_rad + 0.5 * jump).view(FAR_M)
            view = home if jump % 2 else away
            count, useful = 0, useful_to(view, paging)
            for i in range(round(1 / per_s / FRAME_S)):
                now_s = show(paging, replace(view, t_s=now_s), now_s)
                count += len(paging.uploaded - useful) if i else 0
            most = max(most, count)
    return most


def show(paging: Paging, view: ViewState, now_s: float) -> float:
    """Do one frame; return when the next one begins."""
    paging.frame(view)
    paging.pager.advance(now_s, now_s + FRAME_S)
    return now_s + FRAME_S


def useful_to(view: ViewState, paging: Paging) -> set[Key]:
    """Return all that a view may ask for in good faith.

    That is what it draws of everything, by half the thresholds (for what is kept, and
    what is asked for early), and what can stand in for that: cells above it, with
    those beside them.
    """
    settings = paging.pager.settings
    limits = Thresholds(settings.threshold_px, settings.objects_px).times(0.5)
    chosen = select(paging.trees, lens_of(view), everything(paging.trees), limits)
    found: set[Key] = set()
    for lane, kept in chosen.keep.items():
        tree, rows = paging.trees[lane], kept
        while len(rows):
            found.update((lane, row) for row in rows.tolist())
            above = np.unique(tree.parent[rows])
            rows = above[above >= 0]
            found.update((lane, row) for row in tree.children[rows].ravel().tolist())
    return found


ROWS = (
    Row(
        "stale work",
        "after a jump the tiles of the old view are still uploaded",
        "jumps a second",
        "tiles uploaded after a jump that are of no use",
        IN_FLIGHT,
        stale,
    ),
)
