# SPDX-License-Identifier: Apache-2.0
"""What a selection costs over an index of about 50,000 terrain tiles.

Run `pytest tests/benchmarks --benchmark-enable`; otherwise each runs once, as a test.
With `-s` it prints the times of single selections.
"""

import sys
import time
from collections.abc import Callable

import numpy as np
import pytest

from geopage.screen_error import Lens, lens_of
from geopage.terrain_selection import Terrain, select_terrain
from geopage.tree import Tree, tree_of
from tests.geopage.worlds import globe_cells, terrain_records, view_at
from tiles import cells, geodesy
from tiles.forest import build_forest
from tiles.lanes import Lane

REGION_DEG = (0.0, 10.0, 90.0, 60.0)
"""A raster of 30 arc seconds, 10,800 x 6,000 posts"""
LEAF_LEVEL = 7
LEAF_ERROR_M = 9.0
TAU = 1.0
SPOT = (np.radians(44.3), np.radians(34.8))
Benchmark = Callable[..., Terrain]


def region_tree() -> Tree:
    """The resident index of the region, made by arithmetic."""
    west, south, east, north = np.radians(REGION_DEG)
    step = np.pi / 4 / 2**LEAF_LEVEL
    lon = np.arange(west + step / 2, east, step)
    lat = np.arange(south + step / 2, north, step)
    places = (x.ravel() for x in np.meshgrid(lon, lat))
    leaves = np.asarray(cells.cell_at(*places, LEAF_LEVEL))
    wanted = [globe_cells(2)]
    for level in range(LEAF_LEVEL):
        above = np.unique(cells.ancestor(leaves, level))
        wanted.append(np.asarray(cells.children(above).ravel()))
    records = terrain_records(np.concatenate(wanted))
    edge_m = geodesy.cell_edge_m(records["cell"])
    inner = cells.level(records["cell"]) < LEAF_LEVEL
    records["error_m"] = np.where(inner, edge_m / 256, LEAF_ERROR_M)
    return tree_of(build_forest(records), Lane.TERRAIN)


@pytest.fixture(scope="module")
def tree() -> Tree:
    return region_tree()


def fly_in(count: int) -> list[Lens]:
    """From 10,000 km to 10 m, tilting up at the end."""
    share = np.linspace(0.0, 1.0, count)
    heights, pitches = 10.0 ** (7.0 - 6.0 * share), -90.0 + 85.0 * share**4
    views = zip(heights.tolist(), pitches.tolist(), strict=True)
    return [lens_of(view_at(height_m, SPOT, pitch)) for height_m, pitch in views]


def anywhere(count: int) -> list[Lens]:
    """Over the region, from all heights, looking anywhere."""
    rng = np.random.default_rng(5)
    west, south, east, north = np.radians(REGION_DEG)
    found = []
    for _ in range(count):
        place = float(rng.uniform(west, east)), float(rng.uniform(south, north))
        height_m, pitch = 10.0 ** rng.uniform(1, 7), float(rng.uniform(-90, 10))
        found.append(lens_of(view_at(height_m, place, pitch, float(rng.uniform(0, 360)))))
    return found


def timed_ms(tree: Tree, lenses: list[Lens], share: float) -> np.ndarray:
    """Times of single selections, each the next one's past, as a flight makes them."""
    rng = np.random.default_rng(2)
    uploaded = (rng.random(len(tree.parent)) < share).astype(np.uint8)
    uploaded[tree.roots] = 1
    refined = np.zeros(len(tree.parent), np.uint8)
    spent = []
    for lens in lenses:
        start_ns = time.perf_counter_ns()
        chosen = select_terrain(tree, lens, TAU, uploaded, refined)
        spent.append((time.perf_counter_ns() - start_ns) / 1e6)
        refined = chosen.refined
    return np.array(spent)


def test_the_index_is_that_of_a_large_region(tree: Tree) -> None:
    leaves = (tree.level == LEAF_LEVEL).sum()
    assert 36_000 < leaves < 38_000
    assert 48_000 < len(tree.parent) < 52_000


@pytest.mark.parametrize("share", [1.0, 0.7])
@pytest.mark.parametrize("lenses", [fly_in, anywhere])
def test_single_selections(
    tree: Tree, lenses: Callable[[int], list[Lens]], share: float
) -> None:
    timed_ms(tree, lenses(5), share)
    spent = timed_ms(tree, lenses(400), share)
    p50, p99 = np.percentile(spent, (50, 99))
    found = f"p50 {p50:.3f} ms, p99 {p99:.3f} ms"
    sys.stdout.write(f"\n{lenses.__name__}, {share:.0%} there: {found}\n")
    # The promise is 1 ms at p99; a machine that is busy with other things gets more.
    assert p50 < 1.0


@pytest.mark.parametrize("height_m", [1e7, 1e6, 1e5, 1e3])
def test_selection(benchmark: Benchmark, tree: Tree, height_m: float) -> None:
    lens = lens_of(view_at(height_m, SPOT, -30.0))
    everything = np.ones(len(tree.parent), np.uint8)
    before = np.zeros(len(tree.parent), np.uint8)
    chosen = benchmark(select_terrain, tree, lens, TAU, everything, before)
    assert 32 < len(chosen.drawn) < 2000
    assert not len(chosen.wanted)
