# SPDX-License-Identifier: Apache-2.0
"""Frames of one view of a city, alone in its store and with a million others elsewhere.

    python -m tests.benchmarks.million FOLDER [--few 1000] [--many 1000000]
        [--numbers OUT.json]

writes two stores, draws both in turns, so that both have the same machine, with
everything resident, over a globe at height 0, and prints how much longer a frame takes.
The stores are deleted afterwards. The number goes into PAGING.md by
`geopage paging --also OUT.json`.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
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
from tiles.frames import WGS84_A_M
from tiles.lanes import Lane
from tiles.objects import decode
from tiles.samples import SAMPLES
from tiles.store import Store
from viewer.arena import ArenaSize
from viewer.gl import open_headless
from viewer.paging_numbers.limits import FLAT, MISSED, Line, as_dict, in_words, line
from viewer.renderer import Renderer

CITY = SAMPLES / "sanfrancisco_buildings.gpkg"
FAR_DEG = 8.0
TAU = 1.0
TURNS = 50
LIMIT = 1.1
ROOM = ArenaSize(vertex_bytes=64 << 20, index_bytes=32 << 20, layers=64, objects=1 << 16)
VIEWS = {
    "street": (10.0, -5.0),
    "300 m": (300.0, -30.0),
    "3 km": (3_000.0, -45.0),
    "15 km": (15_000.0, -60.0),
    "160 km": (160_000.0, -90.0),
}
"""Height above the middle of the city, m, and pitch, degrees"""


@dataclass(frozen=True)
class City:
    """A store's objects lane."""

    tree: Tree
    forest: Forest
    store: Path
    report: dict[str, Any]

    def lens(self, name: str) -> Lens:
        return lens_of(self.view(name))

    def view(self, name: str) -> ViewState:
        """Look from the south at the city's middle, wherever its first buildings are."""
        height_m, pitch_deg = VIEWS[name]
        lon, lat = middle()
        away_m = height_m / math.tan(math.radians(-pitch_deg))
        return view_at(height_m, (lon, lat - away_m / WGS84_A_M), pitch_deg)


def middle(count: int = 100) -> tuple[float, float]:
    """Return longitude and latitude, rad, amid the buildings that come first."""
    first = first_of(next(read_parts(CITY, at_most=count)), count)
    lon, lat = np.radians(np.median(shapely.get_coordinates(first.geometry), axis=0))
    return float(lon), float(lat)


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


def chosen(city: City, lens: Lens) -> Objects:
    before = np.zeros(len(city.tree.parent), np.uint8)
    return select_objects(city.tree, lens, TAU, TAU, city.tree.has_tile, before)


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


def compared(work: Sequence[Callable[[], object]], turns: int) -> tuple[float, float]:
    """Do two things in turns; return the median time of each, ms."""
    spent_ms = np.empty((turns, 2))
    for row in spent_ms:
        for k, do in enumerate(work):
            start_ns = time.perf_counter_ns()
            do()
            row[k] = (time.perf_counter_ns() - start_ns) / 1e6
    small, large = np.median(spent_ms, axis=0).tolist()
    return small, large


def said(small_ms: float, large_ms: float) -> str:
    return f"{small_ms:.4f} ms, {large_ms:.4f} ms: x {large_ms / small_ms:.3f}"


def framed(
    cities: Sequence[City], context: moderngl.Context, name: str, turns: int
) -> tuple[float, float, list[int]]:
    """Draw one view of both stores; return frame times, ms, and objects drawn."""
    view = cities[0].view(name)
    scenes = [scene(city, view, context) for city in cities]
    try:
        draw = [partial(renderer.draw, drawn, view) for renderer, drawn in scenes]
        shown = [one().objects for one in draw]
        return *compared(draw, turns), shown
    finally:
        for renderer, _ in scenes:
            renderer.release()


def measured(cities: Sequence[City], turns: int) -> Line:
    """Draw all views of both; hold the worst ratio against the limit."""
    context, ratios = open_headless(), {}
    for name in VIEWS:
        small_ms, large_ms, shown = framed(cities, context, name, turns)
        ratios[name] = large_ms / small_ms
        told = f"frame, {name}: {said(small_ms, large_ms)}, {shown} objects drawn\n"
        sys.stdout.write(told)
    context.release()
    worst = max(ratios.values())
    counts = " and ".join(f"{city.report['objects']:,}" for city in cities)
    each = ", ".join(f"{name} {ratio:.3f}" for name, ratio in ratios.items())
    note = f"{counts} objects; {each}"
    return line(FLAT, f"{LIMIT:.2f}", f"{worst:.2f}", note, is_met=worst <= LIMIT)


def main(words: list[str]) -> int:
    """Write, draw, print, delete."""
    parser = argparse.ArgumentParser(prog="million", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--few", type=int, default=1_000)
    parser.add_argument("--many", type=int, default=1_000_000)
    parser.add_argument("--numbers", type=Path, metavar="OUT.json")
    given = parser.parse_args(words)
    try:
        start_s, few = time.monotonic(), given.few
        cities = [
            built(given.folder / "few.geopage", few, 0),
            built(given.folder / "many.geopage", few, given.many - few),
        ]
        sys.stdout.write(f"stores written in {time.monotonic() - start_s:.0f} s\n")
        found = measured(cities, TURNS)
    finally:
        for name in ("few", "many"):
            for one in given.folder.glob(f"{name}.geopage*"):
                one.unlink()
    sys.stdout.write(in_words(found) + "\n")
    if given.numbers:
        kept = {"numbers": [as_dict(found)]}
        given.numbers.write_text(json.dumps(kept, indent=1) + "\n")
    return int(found.verdict == MISSED)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
