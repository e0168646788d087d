# SPDX-License-Identifier: Apache-2.0
"""A small run of `million`: the same view of a city, alone and with others elsewhere.

Run `pytest tests/benchmarks/test_million.py --benchmark-enable -s -o
faulthandler_timeout=0` for 10,000 buildings against 1,000,000 (some minutes, 1 GB).
"""

import sys
from functools import partial

import moderngl
import pytest

from geopage.screen_error import Lens
from tests.benchmarks.million import (
    TURNS,
    VIEWS,
    City,
    built,
    chosen,
    compared,
    framed,
    said,
)
from tiles.index_tree import INDEX

FAR_BOXES = 64
"""Objects of the skylines that are far away, where these are larger than a pixel."""


@pytest.fixture(scope="module")
def cities(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[City, City]:
    folder = tmp_path_factory.mktemp("million")
    measured = request.config.getoption("benchmark_enable")
    few, many = (10_000, 1_000_000) if measured else (100, 3_000)
    return built(folder / "few", few, 0), built(folder / "many", few, many - few)


@pytest.fixture(scope="module")
def turns(request: pytest.FixtureRequest) -> int:
    return TURNS if request.config.getoption("benchmark_enable") else 2


def drawn_of(city: City, lens: Lens) -> set[tuple[int, int, int]]:
    """The cells that a view draws around the spot: own objects or not, which proxies."""
    found = chosen(city, lens)
    cell = city.forest.records["cell"][found.drawn]
    rows = zip(cell.tolist(), found.own.tolist(), found.proxies.tolist(), strict=True)
    return set(rows)


@pytest.mark.slow
@pytest.mark.parametrize("name", VIEWS)
def test_a_view_of_a_city_draws_the_same_whatever_else_is_in_the_store(
    cities: tuple[City, City], name: str
) -> None:
    few, many = cities
    mine, all_of_it = drawn_of(few, few.lens(name)), drawn_of(many, few.lens(name))
    assert mine
    assert mine <= all_of_it
    # Behind the horizon or smaller than a pixel: a handful of skylines at most.
    assert len(all_of_it - mine) <= 8


@pytest.mark.slow
def test_time_and_index_bytes(cities: tuple[City, City], turns: int) -> None:
    for name in VIEWS:
        lens = cities[0].lens(name)
        select = [partial(chosen, city, lens) for city in cities]
        small, large = compared(select, 4 * turns)
        tiles = len(chosen(cities[1], lens).drawn)
        told = f"\nselection, {name}: {said(small, large)}, {tiles} tiles drawn"
        sys.stdout.write(told)
        # A machine that is busy with other things gets more.
        assert large < 2.0
    for city in cities:
        count, rate = city.report["objects"], city.report["buildings_per_s"]
        per = city.report["index_bytes_per_building"]
        assert per == pytest.approx(
            len(city.forest.records) * INDEX.itemsize / count, abs=0.01
        )
        assert per < 16
        sys.stdout.write(f"\n{count} buildings: {rate}/s, {per} B of index each")
    sys.stdout.write(f"\n{cities[1].report['stages_s']}\n")


@pytest.mark.slow
@pytest.mark.parametrize("name", VIEWS)
def test_frame_time(
    cities: tuple[City, City], gl_context: moderngl.Context, turns: int, name: str
) -> None:
    small, large, shown = framed(cities, gl_context, name, turns)
    assert 0 <= shown[1] - shown[0] <= FAR_BOXES
    sys.stdout.write(f"\nframe, {name}: {said(small, large)}, {shown} objects drawn")
    assert large < 1000.0
