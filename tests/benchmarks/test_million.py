# SPDX-License-Identifier: Apache-2.0
"""The same view of a city, alone in its store and with a hundred times more elsewhere.

Selections and frames are timed in turns, so that both have the same machine; the frames
are drawn with everything resident, over a globe at height 0.

Run `pytest tests/benchmarks/test_million.py --benchmark-enable -s -o
faulthandler_timeout=0` for 10,000 buildings against 1,000,000 (some minutes, 1 GB);
otherwise it runs once on a few thousand.
"""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
import shapely

from geopage.draw_list import DrawList
from geopage.object_selection import Objects, select_objects
from geopage.screen_error import Lens, lens_of
from geopage.tree import Tree, tree_of
from geopage.view import ViewState
from ingest.buildings import BuildingOptions, ingest_parts
from ingest.footprints import Footprints, read_parts
from ingest.synthetic import first_of, replicated
from tests.geopage.worlds import view_at
from tests.viewer.worlds import globe, whole_list
from tiles.forest import Forest, build_forest
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.objects import decode
from tiles.store import Store
from viewer.arena import ArenaSize
from viewer.renderer import Renderer

CITY = Path(__file__).parents[2] / "data_samples" / "sanfrancisco_buildings.gpkg"
SPOT = (np.radians(-122.447), np.radians(37.762))
FAR_DEG = 8.0
TAU = 1.0
TURNS = 50
ROOM = ArenaSize(vertex_bytes=64 << 20, index_bytes=32 << 20, layers=64, objects=1 << 16)
FAR_BOXES = 64
"""Objects of the skylines that are far away, where these are larger than a pixel."""
VIEWS = {
    "street": (10.0, -5.0),
    "300 m": (300.0, -30.0),
    "3 km": (3_000.0, -45.0),
    "15 km": (15_000.0, -60.0),
    "160 km": (160_000.0, -90.0),
}


@dataclass(frozen=True)
class City:
    """A store's objects lane."""

    tree: Tree
    forest: Forest
    store: Path
    report: dict[str, Any]


def alone(count: int) -> Iterator[Footprints]:
    yield first_of(next(read_parts(CITY, at_most=count)), count)


def far_away(store: Path, count: int) -> Iterator[Footprints]:
    """Copies of the city, eight degrees to the east."""
    for part in replicated(CITY, store, count, None, None):
        by = np.array((FAR_DEG, 0.0))
        east = shapely.transform(part.geometry, lambda xy, by=by: xy + by)
        yield replace(part, geometry=east)


def built(store: Path, few: int, more: int) -> City:
    readers = {"city": [lambda: alone(few)]}
    if more:
        readers["elsewhere"] = [lambda: far_away(store, more)]
    report = ingest_parts(store, readers, BuildingOptions())
    with Store(store) as opened:
        forest = build_forest(opened.index(Lane.OBJECTS))
    return City(tree_of(forest, Lane.OBJECTS), forest, store, report)


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


def chosen(city: City, lens: Lens) -> Objects:
    before = np.zeros(len(city.tree.parent), np.uint8)
    return select_objects(city.tree, lens, TAU, TAU, city.tree.has_tile, before)


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
    height_m, pitch = VIEWS[name]
    few, many = cities
    lens = lens_of(view_at(height_m, SPOT, pitch))
    mine, all_of_it = drawn_of(few, lens), drawn_of(many, lens)
    assert mine
    assert mine <= all_of_it
    # Behind the horizon or smaller than a pixel: a handful of skylines at most.
    assert len(all_of_it - mine) <= 8


@pytest.mark.slow
def test_time_and_index_bytes(cities: tuple[City, City], turns: int) -> None:
    for name, (height_m, pitch) in VIEWS.items():
        lens = lens_of(view_at(height_m, SPOT, pitch))
        select = [partial(chosen, city, lens) for city in cities]
        large, told = compared(select, 4 * turns)
        tiles = len(chosen(cities[1], lens).drawn)
        sys.stdout.write(f"\nselection, {name}: {told}, {tiles} tiles drawn")
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
    height_m, pitch = VIEWS[name]
    view = view_at(height_m, SPOT, pitch)
    scenes = [scene(city, view, gl_context) for city in cities]
    try:
        draw = [partial(renderer.draw, drawn, view) for renderer, drawn in scenes]
        shown = [one().objects for one in draw]
        assert 0 <= shown[1] - shown[0] <= FAR_BOXES
        large, told = compared(draw, turns)
        sys.stdout.write(f"\nframe, {name}: {told}, {shown} objects drawn")
        assert large < 1000.0
    finally:
        for renderer, _ in scenes:
            renderer.release()


def scene(
    city: City, view: ViewState, context: moderngl.Context
) -> tuple[Renderer, DrawList]:
    """Upload what a view draws of a city, and a globe below."""
    ground, found = globe(), chosen(city, lens_of(view))
    forests = {Lane.TERRAIN: ground.forests[Lane.TERRAIN], Lane.OBJECTS: city.forest}
    size_px = view.width_px, view.height_px
    renderer = Renderer(forests, size_px, ROOM, context=context)
    for row, tile in ground.terrain.items():
        assert renderer.upload(Lane.TERRAIN, row, tile)
    with Store(city.store) as store:
        for row in found.drawn.tolist():
            record = city.forest.records[row]
            key = int(record["cell"]), int(record["row"]), int(record["check"])
            body = store.checked_body(Lane.OBJECTS, *key)
            assert renderer.upload(Lane.OBJECTS, row, decode(body))
    drawn = whole_list(ground, view, TAU)
    own = found.own.view(np.bool_)
    return renderer, replace(drawn, objects=found.drawn, own=own, proxies=found.proxies)


def compared(work: list[Callable[[], object]], turns: int) -> tuple[float, str]:
    """Do two things in turns; return how long the second takes, ms, and both in words."""
    spent_ms = np.empty((turns, 2))
    for row in spent_ms:
        for k, do in enumerate(work):
            start_ns = time.perf_counter_ns()
            do()
            row[k] = (time.perf_counter_ns() - start_ns) / 1e6
    small, large = np.median(spent_ms, axis=0)
    return float(large), f"{small:.4f} ms, {large:.4f} ms: x {large / small:.2f}"
