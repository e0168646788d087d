# SPDX-License-Identifier: Apache-2.0
"""Failures: priority inversion, and work for views of the past."""

from pathlib import Path

from tests.geopage.worlds import SPOT
from viewer.stability.paging import (
    frames_until_urgent_is_drawn,
    stale_uploads_after_a_jump,
)
from viewer.stability.site import Site


def test_an_urgent_tile_overtakes_500_decoded_ones(wide_path: Path) -> None:
    assert frames_until_urgent_is_drawn(wide_path, Site(*SPOT), 500) <= 2


def test_after_a_jump_only_what_was_being_read_is_uploaded_in_vain(wide_path: Path) -> None:
    assert stale_uploads_after_a_jump(wide_path, Site(*SPOT)) <= 2
