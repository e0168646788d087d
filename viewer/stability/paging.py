# SPDX-License-Identifier: Apache-2.0
"""Known ways in which paging fails, each made to happen by a virtual clock.

Each function takes a store, a site and how hard it is made, and returns one figure; its
docstring says what that figure may be at most. See `trial`.
"""

from dataclasses import replace
from pathlib import Path

from tiles.lanes import Lane
from viewer.flight import FRAME_S
from viewer.stability.site import HIGH_M, Site, tiles_a_frame
from viewer.stability.trial import PATIENCE, PLAIN, Trial

NEVER_PX = 1e9
FINE_PX = 0.02
"""A threshold that makes a view of the whole globe want hundreds of tiles."""
STALLED_BYTES, FEW_BYTES = 64_000, 8_000
"""Upload budgets that take seconds for what piled up."""
NEAR_M = 300.0


def frames_until_urgent_is_drawn(store: Path, site: Site, backlog: int = 500) -> int:
    """Priority inversion: low-rank tiles are decoded and wait, then an urgent one comes.

    Returns
    -------
    Frames from the read of the first object tile of a new, near view until a list draws
    it, with `backlog` decoded tiles waiting for their upload: at most 2.
    """
    settings = replace(
        PLAIN,
        threshold_px=FINE_PX,
        object_threshold_px=NEVER_PX,
        throttle=tiles_a_frame(store, 4.0),
    )
    with Trial(store, settings, upload_bytes=STALLED_BYTES) as trial:
        trial.settle_globe(site.view(HIGH_M))
        trial.pile_up(site.view(HIGH_M), backlog)
        trial.pager.set_limits(FINE_PX, PLAIN.objects_px)
        near = site.view(NEAR_M, t_s=trial.now_s)
        read_at = urgent = -1
        for i in range(PATIENCE):
            drawn = trial.frame(near)
            if urgent in drawn.objects:
                return i - read_at
            if urgent < 0 and (first := trial.decoded(Lane.OBJECTS)):
                read_at, urgent = i, min(first)
    raise TimeoutError(f"no object of {store} was drawn in {PATIENCE} frames")


def stale_uploads_after_a_jump(store: Path, site: Site, per_s: float = 5.0) -> int:
    """Stale work: jumps away and home; at home all is there, so nothing is to be done.

    Returns
    -------
    Most tiles of no use to the view that were uploaded after the first frame of one of
    ten jumps, while decoded tiles of the view before pile up: at most the 2 that the
    servers were reading.
    """
    most, hold = 0, round(1 / per_s / FRAME_S)
    settings = replace(PLAIN, throttle=tiles_a_frame(store, 10.0))
    with Trial(store, settings) as trial:
        home = site.view(NEAR_M)
        trial.settle(home)
        trial.uploads_per_frame = FEW_BYTES
        for jump in range(10):
            away = replace(site, lon_rad=site.lon_rad + 0.5 * jump).view(3e6)
            view = home if jump % 2 else away
            stale, useful = 0, trial.useful(view)
            for i in range(hold):
                trial.frame(replace(view, t_s=trial.now_s))
                stale += len(set(trial.seen.uploads[-1]) - useful) if i else 0
            most = max(most, stale)
    return most
