# SPDX-License-Identifier: Apache-2.0
"""Failure: starvation. One lane waits for as long as the other has something to load."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.geopage.trial import HIGH_M, PLAIN, Trial
from tests.geopage.worlds import SPOT
from tiles.lanes import Lane
from viewer.flight import FRAME_S
from viewer.stability.site import Site, tiles_a_frame

PATIENCE_S = 1.0


@pytest.mark.parametrize("policy", ["benefit", "demand"])
def test_no_lane_waits_while_the_other_loads(wide_path: Path, policy: str) -> None:
    line = tiles_a_frame(wide_path, 0.5)
    site = Site(*SPOT)
    with Trial(wide_path, replace(PLAIN, throttle=line, policy=policy)) as trial:
        trial.settle_globe(site.view(HIGH_M))
        started = len(trial.seen.uploads)
        trial.settle(site.view(300.0, t_s=trial.now_s))
        frames = [{lane for lane, _ in some} for some in trial.seen.uploads[started:]]
    last = {lane: max(i for i, some in enumerate(frames) if lane in some) for lane in Lane}
    # Until one lane has all that it wants, neither goes without for long.
    both = frames[: min(last.values())]
    assert len(both) > 10
    for lane in Lane:
        idle = 0
        for some in both:
            idle = 0 if lane in some else idle + 1
            assert idle * FRAME_S <= PATIENCE_S
