# SPDX-License-Identifier: Apache-2.0
"""Failures: priority inversion, and work for views of the past."""

from dataclasses import replace
from pathlib import Path

from tests.geopage.trial import HIGH_M, PATIENCE, PLAIN, Trial
from tests.geopage.worlds import SPOT
from tiles.lanes import Lane
from viewer.stability.queue import stale_uploads_after_a_jump
from viewer.stability.site import Site, tiles_a_frame

NEVER_PX, FINE_PX, NEAR_M = 1e9, 0.02, 300.0
"""At 0.02 px a view of the whole globe wants hundreds of tiles."""
STALLED_BYTES = 64_000
"""An upload budget that takes seconds for what piled up."""


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


def test_an_urgent_tile_overtakes_500_decoded_ones(wide_path: Path) -> None:
    assert frames_until_urgent_is_drawn(wide_path, Site(*SPOT), 500) <= 2


def test_after_a_jump_only_what_was_being_read_is_uploaded_in_vain(wide_path: Path) -> None:
    assert stale_uploads_after_a_jump(wide_path, Site(*SPOT)) <= 2
