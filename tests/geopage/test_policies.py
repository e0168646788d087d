# SPDX-License-Identifier: Apache-2.0
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geopage.benefit import merged_ranks
from geopage.pager import Pager
from geopage.policies.benefit import AGE_S, AHEAD_S, AROUND, Benefit
from geopage.policies.berkeley import READ_BYTES, Berkeley
from geopage.policies.coarser import next_down, on_the_way
from geopage.policies.demand import Demand
from geopage.policies.mmr import CELLS_AHEAD, Mmr
from geopage.policies.protocol import (
    PageRequests,
    Policy,
    Situation,
    everywhere,
    in_order,
)
from geopage.policies.registry import REGISTRY
from geopage.policies.review import Review, frustum_cell
from geopage.policies.vgis import Vgis, levels_skipped
from geopage.prediction import AHEAD, motion_of, predict
from geopage.schedule import UNMET
from geopage.screen_error import lens_of
from geopage.selection import Thresholds, everything, ideal, select
from geopage.settings import REPLAYED, PagerSettings, Throttle
from geopage.tree import U1, Tree
from geopage.view import ViewState
from tests.geopage.stub_renderer import StubRenderer
from tests.geopage.worlds import SPOT, view_at
from tiles.lanes import Lane

LIMITS = Thresholds(2.0, 2.0)
Trees = Mapping[Lane, Tree]


def first_levels(trees: Trees, count: int) -> dict[Lane, U1]:
    """Flags of a world whose coarsest levels of terrain are uploaded."""
    land, town = trees[Lane.TERRAIN], trees[Lane.OBJECTS]
    return {
        Lane.TERRAIN: (land.level < count).astype(np.uint8),
        Lane.OBJECTS: np.zeros(len(town.parent), np.uint8),
    }


def seen(trees: Trees, *views: ViewState, levels: int = 2) -> Situation:
    uploaded = first_levels(trees, levels)
    chosen = select(trees, lens_of(views[-1]), uploaded, LIMITS)
    motion = motion_of(views, 0.0)
    return Situation(views, motion, 0.0, 9, trees, uploaded, LIMITS, 0.0, chosen)


def flown(trees: Trees, climb: float, height_m: float = 1e4, levels: int = 2) -> Situation:
    """Two views a tenth of a second apart; `climb` logarithms of height a second."""
    before = view_at(height_m * np.exp(-climb / 10))
    return seen(trees, before, view_at(height_m, t_s=0.1), levels=levels)


def key_of(requests: PageRequests) -> dict[int, float]:
    return dict(zip(requests.rows.tolist(), requests.ranks.tolist(), strict=True))


def test_every_name_has_a_policy() -> None:
    assert tuple(REGISTRY) == REPLAYED


@pytest.mark.parametrize("name", REPLAYED)
def test_every_policy_settles_at_the_ideal(store_path: Path, name: str) -> None:
    line = Throttle(0.1, 5.0)
    with Pager(store_path, PagerSettings(policy=name, throttle=line)) as pager:
        renderer = StubRenderer(pager)
        for i, height_m in enumerate(np.geomspace(1e7, 60.0, 120).tolist()):
            view = view_at(height_m, t_s=i / 60)
            renderer.frame(view)
            pager.step(view.t_s)
        drawn = renderer.settle(view)
        wanted = ideal(pager.forests, view, 2.0, 2.0)
        assert set(drawn.terrain.tolist()) == set(wanted.terrain.tolist())
        assert drawn.objects.tolist() == wanted.objects.tolist()


@pytest.mark.parametrize("name", REPLAYED)
def test_every_policy_keeps_to_a_short_budget_and_repeats_itself(
    store_path: Path, name: str
) -> None:
    runs = []
    for _ in range(2):
        settings = PagerSettings(policy=name, budget_bytes=720_000, throttle=Throttle(0.3))
        with Pager(store_path, settings) as pager:
            renderer = StubRenderer(pager, 16_000)
            for i in range(150):
                place = SPOT[0] + 2e-3 * i, SPOT[1]
                view = view_at(300.0 + 50 * i, place, -50.0, 3.0 * i, t_s=i / 60)
                renderer.frame(
                    view
                )  # checks the budget, and that all that is drawn is there
                pager.step(view.t_s)
            runs.append((renderer.uploads, pager.counters))
    assert runs[0] == runs[1]


@pytest.mark.parametrize("name", REPLAYED)
def test_every_policy_asks_for_each_row_once_in_order_of_rank(
    trees: Trees, name: str
) -> None:
    policy: Policy = REGISTRY[name]()
    for situation in (seen(trees, view_at(300.0)), flown(trees, -1.0)):
        for requests in policy.plan(situation).requests.values():
            assert (np.diff(requests.ranks) >= 0).all()
            assert len(np.unique(requests.rows)) == len(requests.rows)
            assert 0 <= requests.now <= len(requests.rows)


@pytest.mark.parametrize("name", REPLAYED)
def test_every_policy_asks_for_nothing_that_is_there(trees: Trees, name: str) -> None:
    situation = flown(trees, -1.0)
    for lane, requests in REGISTRY[name]().plan(situation).requests.items():
        assert not situation.uploaded[lane][requests.rows].any()
        assert trees[lane].has_tile[requests.rows].all()


def test_rows_of_several_groups_count_in_the_first() -> None:
    rows = [np.array(some, np.int32) for some in ([5, 3], [3, 8])]
    found = in_order([(rows[0], np.array([1.0, 0.0])), (rows[1], np.array([-9.0, 2.0]))])
    assert found.rows.tolist() == [3, 5, 8]
    assert found.now == 2


def test_benefit_on_a_fast_line_asks_by_benefit_now_and_ahead(trees: Trees) -> None:
    situation, policy = flown(trees, -1.0), Benefit()
    plan = policy.plan(situation)
    ahead_s, weight = AHEAD[0]
    assert situation.motion
    soon = situation.look(lens_of(predict(situation.view, situation.motion, ahead_s)))
    for lane in Lane:
        rows, ranks = merged_ranks(
            situation.chosen.wants[lane], [(weight, soon.wants[lane])]
        )
        np.testing.assert_array_equal(plan.requests[lane].rows, rows)
        np.testing.assert_array_equal(plan.requests[lane].ranks, ranks)


def test_benefit_on_a_slow_line_asks_for_what_will_be_seen_when_it_comes(
    trees: Trees,
) -> None:
    situation, land = flown(trees, -1.0, 1e5), trees[Lane.TERRAIN]
    bytes_per_s = 20e3
    slow = replace(situation, bytes_per_s=bytes_per_s)
    asked = Benefit().plan(slow).requests[Lane.TERRAIN]
    in_time = asked.rows[asked.ranks < UNMET / 2]
    assert len(in_time)
    assert land.tile_bytes[in_time].sum() <= AHEAD_S[-1] * bytes_per_s
    now = set(situation.chosen.wants[Lane.TERRAIN].rows.tolist())
    assert set(in_time.tolist()) - now
    assert now <= set(asked.rows.tolist())


def test_what_is_missed_for_long_comes_before_everything_else(trees: Trees) -> None:
    policy, place = Benefit(), {}
    for t_s in (0.0, 5.0, AGE_S, AGE_S + 20.0):
        views = view_at(1.01e5, t_s=t_s), view_at(1e5, t_s=t_s + 0.1)
        slow = replace(seen(trees, *views), bytes_per_s=5e3)
        asked = policy.plan(slow).requests[Lane.TERRAIN]
        missed = slow.chosen.wants[Lane.TERRAIN].rows
        place[t_s] = np.flatnonzero(np.isin(asked.rows, missed))
    assert place[0.0].max() >= len(missed)
    assert place[AGE_S + 20.0].max() < len(missed)


def test_on_a_fast_line_what_is_missed_for_long_comes_before_what_gains_more(
    trees: Trees,
) -> None:
    policy = Benefit()
    high, low = seen(trees, view_at(1e6)), seen(trees, view_at(1e5, t_s=AGE_S + 1.0))
    old, new = (one.chosen.wants[Lane.TERRAIN].rows for one in (high, low))
    by_benefit = Benefit().plan(low).requests[Lane.TERRAIN].rows
    policy.plan(high)
    asked = policy.plan(low).requests[Lane.TERRAIN].rows
    both = np.intersect1d(old, new)
    assert 0 < len(both) < len(new)
    assert set(asked[: len(both)].tolist()) == set(both.tolist())
    assert set(by_benefit[: len(both)].tolist()) != set(both.tolist())


def test_a_destination_comes_after_all_that_is_missed(trees: Trees) -> None:
    there = view_at(500.0, (SPOT[0] + 0.3, SPOT[1]), t_s=9.0)
    plain = seen(trees, view_at(1e5))
    asked = Benefit().plan(replace(plain, destination=there)).requests[Lane.TERRAIN]
    before = Benefit().plan(plain).requests[Lane.TERRAIN]
    wanted = select(trees, lens_of(there), plain.uploaded, LIMITS).wants[Lane.TERRAIN]
    assert asked.rows[: len(before.rows)].tolist() == before.rows.tolist()
    assert asked.now == before.now
    more = set(wanted.rows.tolist()) - set(before.rows.tolist())
    assert set(asked.rows[len(before.rows) :].tolist()) == more
    assert more


def test_a_slow_line_brings_what_other_directions_show_after_everything_else(
    trees: Trees,
) -> None:
    ahead = seen(trees, view_at(300.0, SPOT, -5.0))
    fast = Benefit().plan(ahead).requests[Lane.TERRAIN]
    slow = Benefit().plan(replace(ahead, bytes_per_s=1e5)).requests[Lane.TERRAIN]
    around = ahead.look(everywhere(ahead, ahead.view)).wants[Lane.TERRAIN]
    late = slow.rows[slow.ranks >= AROUND]
    assert set(around.rows.tolist()) <= set(slow.rows.tolist())
    assert set(late.tolist()) <= set(around.rows.tolist()) - set(fast.rows.tolist())
    assert len(late)


def test_demand_puts_the_largest_error_first_and_asks_for_nothing_early(
    trees: Trees,
) -> None:
    situation = flown(trees, -1.0, 3e6, levels=1)
    wants = situation.chosen.wants[Lane.TERRAIN]
    asked = Demand().plan(situation).requests[Lane.TERRAIN]
    error_px = dict(zip(wants.rows.tolist(), wants.error_px.tolist(), strict=True))
    assert sorted(asked.rows.tolist()) == sorted(wants.rows.tolist())
    assert (np.diff([error_px[row] for row in asked.rows.tolist()]) <= 0).all()
    assert len(set(error_px.values())) > 1
    assert asked.now == len(asked.rows)


def test_the_way_down_leads_from_what_is_there_to_what_is_wanted(trees: Trees) -> None:
    tree, uploaded = trees[Lane.TERRAIN], first_levels(trees, 2)[Lane.TERRAIN]
    deepest = np.flatnonzero(tree.level == tree.level.max()).astype(np.int32)
    way = on_the_way(tree, uploaded, deepest)
    assert (way[-1] == deepest).all()
    for column in way.T:
        rows = column[column >= 0]
        assert tree.level[rows].tolist() == list(range(2, int(tree.level.max()) + 1))
        assert (tree.parent[rows[1:]] == rows[:-1]).all()
    for skip in (0, 1, 30):
        level = tree.level[next_down(tree, uploaded, deepest, skip)]
        assert set(level.tolist()) == {min(2 + skip, int(tree.level.max()))}


def test_an_object_tile_without_proxies_is_not_on_the_way(trees: Trees) -> None:
    tree = trees[Lane.OBJECTS]
    deepest = np.flatnonzero(tree.level == tree.level.max()).astype(np.int32)
    way = on_the_way(tree, np.zeros(len(tree.parent), np.uint8), deepest)
    above = np.unique(way[:-1][way[:-1] >= 0])
    assert len(above)
    assert tree.proxies[above].all()


def test_vgis_walks_down_level_by_level_at_rest_and_skips_when_fast(trees: Trees) -> None:
    rest, fast = seen(trees, view_at(1e4)), flown(trees, -1.5)
    assert levels_skipped(rest) == 0
    assert levels_skipped(fast) == 2
    land = trees[Lane.TERRAIN]
    for situation in (rest, fast):
        asked = Vgis().plan(situation).requests[Lane.TERRAIN]
        first = asked.rows[: asked.now]
        at_most = 2 + levels_skipped(situation)
        assert land.level[first].max() == at_most


def test_vgis_prefers_the_centre_of_the_screen_if_told(trees: Trees) -> None:
    view = view_at(3e6, pitch_deg=-60.0)
    situation, land = seen(trees, view, levels=1), trees[Lane.TERRAIN]
    plain = key_of(Vgis().plan(situation).requests[Lane.TERRAIN])
    central = key_of(Vgis(centre=True).plan(situation).requests[Lane.TERRAIN])
    rows = np.array(sorted(plain))
    away = land.centre[rows] - view.eye
    away_m = np.linalg.norm(away, axis=1)
    angle = np.arccos(away @ view.forward / away_m)
    aside = angle - np.arcsin(np.minimum(land.radius_m[rows] / away_m, 1))
    later = np.array([central[row] - plain[row] for row in rows.tolist()])
    assert later.min() >= 0
    assert np.corrcoef(np.maximum(aside, 0), later)[0, 1] > 0.9


def test_mmr_asks_for_the_coarsest_first_then_for_the_appropriate(trees: Trees) -> None:
    situation, land = seen(trees, view_at(500.0)), trees[Lane.TERRAIN]
    asked = Mmr().plan(situation).requests[Lane.TERRAIN]
    wants = situation.chosen.wants[Lane.TERRAIN].rows
    top = next_down(land, situation.uploaded[Lane.TERRAIN], wants, 0)
    assert set(asked.rows[: len(set(top.tolist()))].tolist()) == set(top.tolist())
    assert set(wants.tolist()) <= set(asked.rows[: asked.now].tolist())


def test_mmr_looks_around_when_slow_and_ahead_when_fast(trees: Trees) -> None:
    slow, fast = Mmr(), Mmr()
    slow.plan(seen(trees, view_at(500.0)))
    fast.plan(flown(trees, -1.0))
    assert 9 <= len(slow._queue) <= 26
    assert len(fast._queue) == CELLS_AHEAD


def test_mmr_keeps_its_queue_until_the_cell_changes_or_the_view_turns_30_degrees(
    trees: Trees,
) -> None:
    policy, queues = Mmr(), []
    here = {"height_m": 500.0, "pitch_deg": -20.0}
    for heading_deg, height_m in ((0, 500), (25, 500), (40, 500), (40, 900)):
        here = {"height_m": float(height_m), "heading_deg": float(heading_deg)}
        policy.plan(seen(trees, view_at(pitch_deg=-20.0, **here)))
        queues.append(policy._queue)
    assert queues[1] is queues[0]
    assert queues[2] is not queues[1]
    assert queues[3] is not queues[2]


def test_review_wants_what_overlaps_the_disk_cell_in_the_order_of_the_index(
    trees: Trees,
) -> None:
    policy, situation = Review(), seen(trees, view_at(2e5, pitch_deg=-45.0))
    asked = policy.plan(situation).requests[Lane.TERRAIN]
    assert policy.disk
    cell, _ = frustum_cell(situation.view, 1e5)
    assert policy.disk.holds(cell)
    inside = policy.disk.distance_m(trees[Lane.TERRAIN], asked.rows) == 0
    first = int(inside.argmin()) if not inside.all() else len(inside)
    assert first > 0
    assert (np.diff(asked.rows[:first]) > 0).all()


def test_review_makes_a_new_disk_cell_when_the_frustum_cell_leaves_it(
    trees: Trees,
) -> None:
    policy, disks = Review(), []
    for east in (0.0, 1e-6, 1e-2):
        place = SPOT[0] + east, SPOT[1]
        policy.plan(seen(trees, view_at(2e3, place, -30.0)))
        disks.append(policy.disk)
    assert disks[1] is disks[0]
    assert disks[2] is not disks[1]


def test_review_fetches_the_next_cell_where_the_eye_is_going(trees: Trees) -> None:
    policy = Review()
    for i in range(200):
        places = [(SPOT[0] + 3e-6 * (i + k), SPOT[1]) for k in range(2)]
        views = [
            view_at(2e3, place, -30.0, 90.0, t_s=k / 60) for k, place in enumerate(places)
        ]
        policy.plan(seen(trees, *views))
        if policy.next:
            break
    assert policy.next
    assert policy.disk
    middles = [(box.low + box.high) / 2 for box in (policy.disk, policy.next)]
    assert (middles[1] - middles[0]) @ (views[1].eye - views[0].eye) > 0


def test_review_lets_the_deepest_farthest_and_oldest_go_first(trees: Trees) -> None:
    policy, land = Review(), trees[Lane.TERRAIN]
    policy.plan(seen(trees, view_at(2e3)))
    spot = int(np.argmax(land.level))
    same = np.flatnonzero(land.level == 2).astype(np.int32)
    order = policy.leaving(Lane.TERRAIN, same, np.full(len(same), 5))
    away_m = np.linalg.norm(land.centre[same] - land.centre[spot], axis=1)
    assert order[np.argmin(away_m)] == order.max()
    deep = np.array([spot, land.parent[spot]], np.int32)
    assert np.diff(policy.leaving(Lane.TERRAIN, deep, np.array([5, 5]))) > 0
    again = np.array([spot, spot], np.int32)
    assert np.diff(policy.leaving(Lane.TERRAIN, again, np.array([5, 6]))) > 0


def test_berkeley_looks_ahead_at_all_that_any_view_in_its_range_needs(
    trees: Trees,
) -> None:
    situation = seen(trees, view_at(3e3))
    rng = np.random.default_rng(5)
    kept = Berkeley().plan(situation).keep[-1][Lane.TERRAIN]
    for _ in range(20):
        offset = rng.normal(size=3)
        offset *= 3e3 / 8 * rng.random() / np.linalg.norm(offset)
        view = view_at(3e3)
        moved = ViewState(0.0, view.eye + offset, view.rotation, view.focal_px, 1280, 720)
        chosen = select(trees, lens_of(moved), everything(trees), LIMITS)
        finer = trees[Lane.TERRAIN].level[kept].max()
        assert trees[Lane.TERRAIN].level[chosen.terrain].max() <= finer


def test_berkeley_reads_the_coarsest_first_and_little_beyond_the_view(
    trees: Trees,
) -> None:
    situation, land = flown(trees, -1.0), trees[Lane.TERRAIN]
    asked = Berkeley().plan(situation).requests[Lane.TERRAIN]
    assert (np.diff(land.level[asked.rows]) >= 0).all()
    visible = set(situation.chosen.wants[Lane.TERRAIN].rows.tolist())
    assert visible <= set(asked.rows.tolist())
    way = on_the_way(land, situation.uploaded[Lane.TERRAIN], np.array(sorted(visible)))
    more = set(asked.rows.tolist()) - set(way.ravel().tolist())
    assert land.tile_bytes[sorted(more)].sum() <= READ_BYTES
