# SPDX-License-Identifier: Apache-2.0
"""Failure: overshoot. What a turn makes useless is loaded all the same."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from geopage.view import ViewState
from tests.geopage.trial import Trial
from tests.geopage.worlds import SPOT
from tiles.frames import WGS84_A_M
from viewer.flight import FRAME_S
from viewer.stability.site import Site

NEAR_M = 300.0


def zig_zag(
    site: Site, hertz: float, legs: int = 6, reach_m: float = 900.0
) -> Iterator[ViewState]:
    """Go to and fro, each leg a little farther east."""
    count = round(0.5 / hertz / FRAME_S)
    for i in range(legs * count):
        leg, part = divmod(i, count)
        to_fro = part / count if leg % 2 == 0 else 1 - part / count
        east_rad = (to_fro + 0.1 * leg) * reach_m / WGS84_A_M
        yield site.view(NEAR_M, -0.6, east_rad, i * FRAME_S)


@pytest.mark.parametrize("hertz", [0.5, 1.0])
def test_a_zig_zag_loads_little_that_is_never_drawn(wide_path: Path, hertz: float) -> None:
    site = Site(*SPOT)
    with Trial(wide_path) as trial:
        trial.settle(site.view(NEAR_M))
        before = trial.pager.counters
        trial.fly(zig_zag(site, hertz))
        trial.check()
        after = trial.pager.counters
    loaded = after["tiles_loaded"] - before["tiles_loaded"]
    assert loaded > 20
    assert after["tiles_unused"] - before["tiles_unused"] <= 0.05 * loaded
