# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from geopage.pager import Pager
from geopage.policies.demand import Demand
from geopage.settings import PagerSettings, Throttle
from tests.geopage.stub_renderer import StubRenderer
from tests.geopage.worlds import SPOT, view_at
from tiles.lanes import Lane

HERE = view_at(2e5)
THERE = view_at(300.0, (SPOT[0], SPOT[1]), t_s=1.0)


def test_another_policy_pages_from_then_on(store_path: Path) -> None:
    with Pager(store_path) as pager:
        renderer = StubRenderer(pager)
        renderer.settle(HERE)
        pager.set_policy("demand")
        assert isinstance(pager.policy, Demand)
        assert pager.settings.policy == "demand"
        assert renderer.settle(THERE).settled


def test_a_policy_that_is_not_there_is_refused(store_path: Path) -> None:
    with Pager(store_path) as pager, pytest.raises(ValueError, match="fastest"):
        pager.set_policy("fastest")


@pytest.mark.parametrize("line", [None, Throttle(1.0)])
def test_a_destination_is_there_when_the_eye_arrives(
    store_path: Path, line: Throttle | None
) -> None:
    with Pager(store_path, PagerSettings(throttle=line)) as pager:
        renderer = StubRenderer(pager)
        renderer.settle(HERE)
        pager.destination(THERE)
        for i in range(400):
            renderer.frame(HERE)
            pager.step(10.0 + i / 60)
        there = set(renderer.there)
        drawn = renderer.settle(THERE)
        assert {(Lane.TERRAIN, row) for row in drawn.terrain.tolist()} <= there
        assert {(Lane.OBJECTS, row) for row in drawn.objects.tolist()} <= there


def test_without_a_destination_something_is_to_be_loaded_on_arrival(
    store_path: Path,
) -> None:
    with Pager(store_path) as pager:
        renderer = StubRenderer(pager)
        renderer.settle(HERE)
        loaded = pager.counters["tiles_loaded"]
        renderer.settle(THERE)
        assert pager.counters["tiles_loaded"] > loaded
