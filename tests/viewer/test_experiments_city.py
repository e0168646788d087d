# SPDX-License-Identifier: Apache-2.0
"""E1, E3 and E4 at a tiny scale, against brute force."""

import math
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from tiles import geodesy
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.store import Store
from viewer.experiments import cache_knee, complement, os_paging
from viewer.experiments.city import (
    APART_M,
    HIGH_M,
    MEMORY_BYTES,
    City,
    index_of,
    lon_lat,
    make_city,
    tile_of,
    write_city,
)
from viewer.experiments.packed_tree import FANOUT, NodeCache, PackedTree
from viewer.experiments.pages import Flown
from viewer.experiments.review_walk import Retrieval, Walker, walk_through
from viewer.experiments.setting import Setting
from viewer.experiments.walks import (
    EYE_M,
    SPEED_M_S,
    frustum_corners,
    in_frustum,
    make_walk,
)

COUNT = 4000
Box = tuple[np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def city() -> City:
    return make_city(COUNT)


@pytest.fixture(scope="module")
def tree(city: City) -> PackedTree:
    return PackedTree(city)


def meets(city: City, box: Box) -> set[int]:
    near = ((city.low <= box[1]) & (city.high >= box[0])).all(axis=1)
    return set(np.flatnonzero(near).tolist())


def box_at(east_m: float, north_m: float, side_m: float) -> Box:
    low = np.array((east_m, north_m, 0.0))
    return low, low + np.array((side_m, side_m, 50.0))


def test_boxes_are_ten_to_thirty_metres_apart_and_never_touch(city: City) -> None:
    middle = (city.low + city.high)[:, :2] / 2
    columns, rows = np.unique(middle[:, 0]), np.unique(middle[:, 1])
    for lines in (columns, rows):
        steps = np.diff(lines)[np.diff(lines) > 1e-6]
        assert APART_M[0] <= steps.min() < steps.max() <= APART_M[1]
    for k in range(0, COUNT, 97):
        assert meets(city, (city.low[k], city.high[k])) == {k}


def test_an_index_holds_every_box_in_a_sphere_of_its_tile(city: City) -> None:
    records = index_of(city)
    own = records[records["row"] > 0]
    assert own["memory_bytes"].sum() == COUNT * MEMORY_BYTES
    leaf, place = tile_of(city)
    assert (own["cell"] == leaf).all()
    corners = np.concatenate((city.low, city.high))
    points = geodesy.to_ecef(*lon_lat(corners[:, 0], corners[:, 1]), corners[:, 2])
    both = np.concatenate((place, place))
    away_m = np.linalg.norm(points - own["centre"][both], axis=1)
    assert (away_m <= own["radius_m"][both]).all()
    assert (records["subtree_dimension_m"] == np.float32(HIGH_M)).all()


def test_a_city_store_has_its_index_and_flat_ground(city: City, tmp_path: Path) -> None:
    with Store(write_city(tmp_path / "c.geopage", city)) as store:
        assert len(store.index(Lane.TERRAIN)) == 32
        found = store.index(Lane.OBJECTS)
    assert found.dtype == INDEX
    assert len(found) == len(index_of(city))


@pytest.mark.parametrize("place", [(0.0, 0.0), (300.0, 400.0), (900.0, 100.0)])
def test_a_search_finds_what_brute_force_finds(
    city: City, tree: PackedTree, place: tuple[float, float]
) -> None:
    box = box_at(*place, 350.0)
    history = [box_at(place[0] - 40.0, place[1] - 30.0, 350.0)]
    found = tree.search(box)
    assert set(tree.order[found.boxes].tolist()) == meets(city, box)
    rest = tree.search(box, history)
    wanted = meets(city, box) - meets(city, history[0])
    assert set(tree.order[rest.boxes].tolist()) == wanted
    assert wanted
    assert len(rest.nodes) < len(found.nodes)


def test_a_search_reads_the_nodes_that_recursion_reads(tree: PackedTree) -> None:
    box = box_at(250.0, 250.0, 300.0)

    def visit(level: int, node: int) -> list[int]:
        one = tree.levels[level]
        low, high = one.low[node], one.high[node]
        if not ((low <= box[1]).all() and (high >= box[0]).all()):
            return []
        below = [] if level == 0 else range(node * FANOUT, (node + 1) * FANOUT)
        count = len(tree.levels[level - 1].low) if level else 0
        found = [visit(level - 1, child) for child in below if child < count]
        return [one.first + node, *(n for part in found for n in part)]

    top = len(tree.levels) - 1
    assert sorted(tree.search(box).nodes.tolist()) == sorted(visit(top, 0))


def test_a_cache_of_nodes_lets_the_least_recently_used_go(tree: PackedTree) -> None:
    random = np.random.default_rng(3)
    cache, held, missed = NodeCache(tree, 16 * 4096), OrderedDict[int, None](), 0
    box = box_at(0.0, 0.0, 10.0)
    for _ in range(50):
        nodes = random.choice(len(tree.node_low), 8, replace=False)
        for node in nodes.tolist():
            missed += node not in held
            held.pop(node, None)
            held[node] = None
        while len(held) > 16:
            held.popitem(last=False)
        missed -= cache.read(nodes, box)
    assert missed == 0


def test_the_view_keeps_every_box_that_a_ray_of_it_meets(city: City) -> None:
    place, heading = np.array((500.0, 300.0)), 0.7
    kept = in_frustum(city.low, city.high, place, heading)
    random = np.random.default_rng(2)
    ahead = np.array((math.sin(heading), math.cos(heading)))
    right = np.array((ahead[1], -ahead[0]))
    met = np.zeros(COUNT, np.bool_)
    for _ in range(4000):
        depth, across = random.uniform(1, 1000), random.uniform(-0.577, 0.577)
        at = np.array((*(place + depth * (ahead + across * right)), EYE_M))
        met |= ((city.low <= at) & (city.high >= at)).all(axis=1)
    assert met.sum() > 100
    assert kept[met].all()
    assert kept.sum() < 0.5 * COUNT


@pytest.mark.parametrize("name", list(SPEED_M_S))
@pytest.mark.parametrize("complement_search", [True, False])
def test_all_of_the_view_is_in_memory_at_every_step(
    tree: PackedTree, name: str, *, complement_search: bool
) -> None:
    walk = make_walk(name, np.full(2, 300.0), 12.0)
    how = Retrieval(complement=complement_search, buffer_bytes=2_000_000)
    walker = Walker(tree, how)
    for i in range(len(walk.place)):
        heading = float(walk.heading_rad[i])
        walker.step(frustum_corners(walk.place[i], heading), walk.velocity(i))
        needed = in_frustum(tree.boxes.low, tree.boxes.high, walk.place[i], heading)
        assert walker.held[needed].all()


def test_complement_search_reads_no_box_twice_while_memory_lasts(tree: PackedTree) -> None:
    walk = make_walk("turning", np.full(2, 600.0), 30.0)
    how = Retrieval(buffer_bytes=10**9)
    walker = Walker(tree, how)
    for i in range(len(walk.place)):
        corners = frustum_corners(walk.place[i], float(walk.heading_rad[i]))
        walker.step(corners, walk.velocity(i))
    assert walker.tally.box_reads == walker.held.sum()
    box = walk_through(tree, walk, Retrieval(complement=False, buffer_bytes=10**9))
    assert box.box_reads > walker.tally.box_reads


def test_e3_has_all_its_rows_and_comes_out_the_same_twice(
    tmp_path: Path, city: City
) -> None:
    setting = Setting(tmp_path)
    found = [
        complement.measure(complement.make_scene(setting, COUNT, 4.0), lambda done: None)
        for _ in range(2)
    ]
    assert found[0].rows == found[1].rows
    assert found[0].says == found[1].says
    rows = found[0].rows
    per_session = [row for row in rows if row.condition.startswith("session")]
    assert len(per_session) == 5 * (4 + len(complement.OWN) + 1)
    printed = [row.paper for row in rows if row.quantity == "I/Os per query, BOX"]
    assert printed == list(complement.BOX_READS)
    culled = [row.ours for row in rows if row.quantity == "objects culled"]
    assert len(culled) == 6
    assert all(one is not None and 0 <= one <= 100 for one in culled)
    assert {chart.name for chart in found[0].charts} == {"e3_reads", "e3_culled", "e3_k"}
    assert make_city(COUNT).side_m == city.side_m


def test_the_knee_is_the_smallest_cache_that_keeps_all() -> None:
    read = (9, 100, 130, 102, 100, 150)
    raised = (2.0, 1.1, 1.0, 1.0, 1.0, 1.0)
    flown = [
        Flown(bytes_read=b, raised=[1.0, f]) for b, f in zip(read, raised, strict=True)
    ]
    assert cache_knee.knee_of(flown) == 3
    flown[-1].raised.append(1.5)
    assert cache_knee.knee_of(flown) is None


def test_e4_reads_no_more_with_more_memory_and_the_same_twice(tmp_path: Path) -> None:
    case = cache_knee.city_case(Setting(tmp_path), COUNT, 3.0)
    case = cache_knee.Case(*[getattr(case, name) for name in FIELDS], (5.0, 6.0, 12.0))
    first, again = (cache_knee.measure([case], lambda done: None) for _ in range(2))
    assert first.rows == again.rows
    knees = [row for row in first.rows if row.quantity == "smallest cache that suffices"]
    assert len(knees) == len(cache_knee.POLICIES)
    assert all(row.ours in {5.0, 6.0, None} for row in knees)
    for series in first.charts[0].series:
        assert list(series.x) == [5.0, 6.0, 12.0]
        assert max(series.y) < 3 * COUNT * 222 / 1e6


FIELDS = ("name", "store", "views", "step_s", "threshold_px")


def test_virtual_memory_faults_as_a_list_does() -> None:
    random = np.random.default_rng(1)
    system, held, faults = os_paging.VirtualMemory(60, 40), list(range(20, 60)), 0
    for _ in range(200):
        pages = np.unique(random.integers(0, 60, 6))
        faults += sum(page not in held for page in pages.tolist())
        held = [page for page in held if page not in pages] + pages.tolist()
        del held[: max(len(held) - 40, 0)]
        faults -= system.touch(pages)
    assert faults == 0


def test_e1_stalls_more_with_less_memory_and_the_same_twice(tmp_path: Path) -> None:
    found = [
        os_paging.measure(Setting(tmp_path), 2_500_000, 15.0, lambda done: None)
        for _ in range(2)
    ]
    assert found[0].rows == found[1].rows
    stalls = [row.ours for row in found[0].rows if row.quantity == "frames that stall"]
    assert stalls == sorted(stalls, key=float)  # type: ignore[arg-type]
    assert stalls[-1]
    mean = [r for r in found[0].rows if r.quantity == "frame time, mean"]
    assert mean[0].ours == pytest.approx(0.063)
    assert all(row.ours >= mean[0].ours for row in mean[1:])  # type: ignore[operator]
    loaded = [row for row in found[0].rows if row.quantity == "loaded a frame"]
    assert len(loaded) == len(os_paging.POLICIES)
