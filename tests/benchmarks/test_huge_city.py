# SPDX-License-Identifier: Apache-2.0
"""A small run of `huge_city`: a city of ten times the memory that there is for tiles."""

from pathlib import Path

import pytest

from geopage.pager import Pager
from geopage.settings import MIB, PagerSettings
from tests.benchmarks import huge_city

SIDE, VERTICES, SECONDS = 64, 100, 2.0
GROUND_BYTES = 1_000_000
"""What a view takes for terrain; the city's tiles get the rest."""


def test_a_city_of_ten_times_the_budget_has_no_hole_and_keeps_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(huge_city, "EVERY", 20)
    monkeypatch.setattr(huge_city, "FALL_S", 6.0)
    path = tmp_path / "city.geopage"
    things = huge_city.write_city(path, SIDE, VERTICES)
    tiles_bytes = int(things["memory_bytes"].sum(dtype="i8"))
    with Pager(path, dry=True) as pager:
        index_bytes = pager.memory()["index_bytes"]
    room_bytes = GROUND_BYTES + tiles_bytes // 10
    settings = PagerSettings(budget_bytes=index_bytes + room_bytes, fade_s=0.0)
    found = huge_city.fly(path, SIDE, settings, SECONDS)
    assert (found.holes, found.over_budget) == (0, 0)
    assert found.rss_over == 0
    assert abs(found.rss_last_bytes - found.rss_first_bytes) < 8 * MIB
    assert found.raised > 1.0
    assert found.loaded > SIDE * SIDE // 10


def test_its_blocks_stand_where_they_are_and_below_proxies() -> None:
    things = huge_city.city_records(huge_city.city_blocks(SIDE))
    own = things["own_dimension_m"] > 0
    assert own.sum() == SIDE * SIDE
    assert not things["proxies"][own].any()
    assert (things["error_m"][own] == 0).all()
