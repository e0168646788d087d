# SPDX-License-Identifier: Apache-2.0
"""Other thresholds while a pager runs."""

from pathlib import Path

import pytest

from geopage.pager import Pager
from geopage.pressure import MemoryPressure
from geopage.selection import ideal
from geopage.settings import PagerSettings
from tests.geopage.stub_renderer import StubRenderer
from tests.geopage.worlds import view_at


@pytest.mark.parametrize("limits", [(8.0, None), (0.5, 3.0)])
def test_new_limits_settle_at_the_ideal_of_the_new_limits(
    store_path: Path, limits: tuple[float, float | None]
) -> None:
    view = view_at(1e5)
    with Pager(store_path, PagerSettings(fade_s=0.0)) as pager:
        renderer = StubRenderer(pager)
        before = renderer.settle(view)
        pager.set_limits(*limits)
        assert not pager.settled
        after = renderer.settle(view)
        wanted = ideal(pager.forests, view, limits[0], limits[1] or limits[0])
        assert set(before.terrain.tolist()) != set(wanted.terrain.tolist())
        assert (after.threshold_px, after.object_threshold_px) == (
            limits[0],
            limits[1] or limits[0],
        )
        # What was finer stays while it is no more than a fifth too fine.
        if limits[0] < 2.0:
            assert set(after.terrain.tolist()) == set(wanted.terrain.tolist())
            assert after.objects.tolist() == wanted.objects.tolist()
        assert len(wanted.terrain) <= len(after.terrain)


def test_many_new_limits_wake_the_scene_manager_once_and_the_newest_counts(
    store_path: Path,
) -> None:
    view = view_at(2e3)
    with Pager(store_path, PagerSettings(fade_s=0.0)) as pager:
        StubRenderer(pager).settle(view)
        for px in (3.0, 5.0, 2.5, 2.25):
            pager.set_limits(px)
        assert pager.step(view.t_s)
        assert pager.draw_list().threshold_px == 2.25
        assert pager.settings.threshold_px == 2.25
        assert not pager.step(view.t_s)
        pager.set_limits(2.25)
        assert not pager.step(view.t_s)


def test_impossible_limits_are_refused_and_nothing_changes(store_path: Path) -> None:
    with Pager(store_path) as pager:
        with pytest.raises(ValueError, match="threshold_px"):
            pager.set_limits(0.0)
        assert pager.settings == PagerSettings()


def test_a_larger_threshold_ends_what_short_memory_did_at_the_same_view() -> None:
    pressure, view = MemoryPressure(1000), view_at(100.0)
    assert pressure.update(900, view)
    assert not pressure.update(100, view)
    pressure.try_again()
    assert pressure.update(100, view)
    assert pressure.factor == 1.0
