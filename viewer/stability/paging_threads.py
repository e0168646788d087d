# SPDX-License-Identifier: Apache-2.0
"""What the threads of a pager do while nothing changes: nothing."""

import threading
import time
from pathlib import Path

from geopage.pager import Pager
from geopage.view import ViewState
from viewer.stability.site import Site

PAUSE_S = 0.002
QUIET_S = 0.05


def turn(pager: Pager, view: ViewState) -> None:
    """Do what a render loop does for one frame, but for the drawing."""
    pager.view(view)
    drawn = pager.draw_list()
    for lane, row in pager.releases(drawn.number):
        pager.released(lane, row)
    for item in pager.take_uploads(2**20):
        pager.uploaded(item.lane, item.row)


def threads_of(pager: Pager) -> list[threading.Thread]:
    """Return the threads of a pager, of which no other is started, that still run."""
    return [one for one in threading.enumerate() if one.name in pager.wake_ups]


def busy_s(pager: Pager) -> dict[str, float]:
    """Return the processor time of each thread of a pager so far."""
    return {
        one.name: time.clock_gettime(time.pthread_getcpuclockid(one.ident))
        for one in threads_of(pager)
        if one.ident is not None
    }


def busy_at_rest_s(store: Path, site: Site, frames: int = 60) -> tuple[float, int, int]:
    """Show one view for a while after all that it wants is there.

    Returns
    -------
    Processor time of all paging threads meanwhile, their wake-ups, and tiles loaded:
    each at most 0.
    """
    with Pager(store) as pager:
        pager.start()
        view = site.view(300.0)
        before, calm = busy_s(pager), False
        while not calm:  # the last thread takes a moment to go to sleep
            turn(pager, view)
            time.sleep(PAUSE_S if not pager.settled else QUIET_S)
            now = busy_s(pager)
            calm, before = pager.settled and now == before, now
        wake_ups, loads = sum(pager.wake_ups.values()), pager.counters["tiles_loaded"]
        for _ in range(frames):
            turn(pager, view)
            time.sleep(PAUSE_S)
        busy = sum(busy_s(pager).values()) - sum(before.values())
        woken = sum(pager.wake_ups.values()) - wake_ups
        return busy, woken, pager.counters["tiles_loaded"] - loads
