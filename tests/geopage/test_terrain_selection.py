# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from geopage import terrain_selection as terrain
from geopage.screen_error import Lens, lens_of
from geopage.selection import Selection, Thresholds, everything, select, trees_of
from geopage.tree import U1, Tree
from geopage.view import ViewState
from tests.geopage.screen_error_oracle import scales_of
from tests.geopage.worlds import SPOT, deep_globe, object_records, view_at
from tiles import cells
from tiles.forest import Rows, build_forest
from tiles.index_tree import RUNG_FIELDS
from tiles.lanes import Lane

FORESTS = {
    Lane.TERRAIN: build_forest(deep_globe()),
    Lane.OBJECTS: build_forest(object_records()),
}
TREES = trees_of(FORESTS)
LAND = TREES[Lane.TERRAIN]
CELLS: NDArray[np.int64] = FORESTS[Lane.TERRAIN].records["cell"]
LIMITS = Thresholds(2.0, 2.0)
PLACES = st.one_of(
    st.just(SPOT), st.tuples(st.floats(-np.pi, np.pi), st.floats(-np.pi / 2, np.pi / 2))
)
VIEWS = st.builds(
    view_at,
    st.floats(1.0, 7.3).map(lambda x: 10.0**x),
    PLACES,
    st.floats(-90, 20),
    st.floats(0, 360),
)
SUBSETS = st.builds(
    lambda seed, share: (np.random.default_rng(seed).random(len(CELLS)) < share).astype(
        np.uint8
    ),
    st.integers(0, 2**32 - 1),
    st.floats(0, 1),
)


def flags_with_roots(flags: U1) -> dict[Lane, U1]:
    """Uploaded flags of both lanes in which the zones are there."""
    flags = flags.copy()
    flags[:32] = 1
    return {
        Lane.TERRAIN: flags,
        Lane.OBJECTS: np.zeros(len(TREES[Lane.OBJECTS].parent), np.uint8),
    }


def assert_covers_the_globe_once(drawn: Rows) -> None:
    """No cell lies in another, and together they are as large as 32 zones."""
    found = np.sort(CELLS[drawn])
    assert (cells.range_max(found[:-1]) < cells.range_min(found[1:])).all()
    assert (0.25 ** cells.level(found)).sum() == 32.0


def brute_force_targets(tree: Tree, lens: Lens, tau: float) -> set[int]:
    scale = scales_of(lens, tree)

    def below(row: int) -> set[int]:
        if tree.error_m[row] * scale[row] <= tau or tree.children[row].min() < 0:
            return {row}
        return set().union(*(below(int(child)) for child in tree.children[row]))

    return set().union(*(below(row) for row in range(32)))


@given(VIEWS)
def test_refine_finds_the_targets_of_plain_recursion(view: ViewState) -> None:
    lens, nothing = lens_of(view), np.zeros(len(CELLS), np.uint8)
    plan = terrain.refine(LAND, lens, 2.0, nothing + np.uint8(1), nothing)
    found = set(plan.rows[plan.kind == terrain.TARGET].tolist())
    assert found == brute_force_targets(LAND, lens, 2.0)


@given(VIEWS, SUBSETS)
def test_what_is_drawn_covers_the_globe_once(view: ViewState, subset: U1) -> None:
    flags = flags_with_roots(subset)
    chosen = select(TREES, lens_of(view), flags, LIMITS)
    assert_covers_the_globe_once(chosen.terrain)
    assert flags[Lane.TERRAIN][chosen.terrain].all()


@given(st.lists(st.tuples(VIEWS, SUBSETS), min_size=2, max_size=4))
def test_a_session_covers_the_globe_once_throughout(
    steps: list[tuple[ViewState, U1]],
) -> None:
    refined = None
    for view, subset in steps:
        chosen = select(TREES, lens_of(view), flags_with_roots(subset), LIMITS, refined)
        refined = chosen.made
        assert_covers_the_globe_once(chosen.terrain)


@given(VIEWS, SUBSETS)
def test_nothing_is_drawn_twice_before_all_zones_are_there(
    view: ViewState, subset: U1
) -> None:
    flags = flags_with_roots(subset)
    flags[Lane.TERRAIN][:32:3] = 0
    found = np.sort(CELLS[select(TREES, lens_of(view), flags, LIMITS).terrain])
    assert (cells.range_max(found[:-1]) < cells.range_min(found[1:])).all()


@given(VIEWS)
def test_with_everything_uploaded_the_threshold_holds(view: ViewState) -> None:
    lens = lens_of(view)
    chosen = select(TREES, lens, everything(TREES), LIMITS)
    error_px = LAND.error_m * scales_of(lens, LAND)
    leaf = LAND.children.min(axis=1) < 0
    assert (leaf[chosen.terrain] | (error_px[chosen.terrain] <= 2.0)).all()
    assert not chosen.stand_in.any()
    assert len(chosen.wants[Lane.TERRAIN].rows) == 0


@given(VIEWS, SUBSETS)
def test_loading_what_is_wanted_ends_with_the_ideal(view: ViewState, subset: U1) -> None:
    flags, lens = flags_with_roots(subset), lens_of(view)
    ideal = select(TREES, lens, everything(TREES), LIMITS)
    for _ in range(6):
        chosen = select(TREES, lens, flags, LIMITS)
        wanted = chosen.wants[Lane.TERRAIN].rows
        assert not flags[Lane.TERRAIN][wanted].any()
        flags[Lane.TERRAIN][wanted] = 1
    assert set(chosen.terrain.tolist()) == set(ideal.terrain.tolist())


def uploaded_by(*chosen: Selection) -> dict[Lane, U1]:
    flags = flags_with_roots(np.zeros(len(CELLS), np.uint8))
    for selection in chosen:
        flags[Lane.TERRAIN][selection.terrain] = 1
    return flags


def test_a_target_that_is_missing_is_stood_in_for_by_its_parent() -> None:
    lens = lens_of(view_at(1e4))
    ideal = select(TREES, lens, everything(TREES), LIMITS)
    deepest = int(ideal.terrain[np.argmax(LAND.level[ideal.terrain])])
    flags = uploaded_by(ideal)
    flags[Lane.TERRAIN][deepest] = 0
    flags[Lane.TERRAIN][LAND.parent[deepest]] = 1
    chosen = select(TREES, lens, flags, LIMITS)
    assert chosen.terrain[chosen.stand_in].tolist() == [LAND.parent[deepest]]
    assert chosen.wants[Lane.TERRAIN].rows.tolist() == [deepest]
    assert not np.isin(LAND.children[LAND.parent[deepest]], chosen.terrain).any()


def test_detail_stays_while_a_coarser_target_loads() -> None:
    near = select(TREES, lens_of(view_at(1e3)), everything(TREES), LIMITS)
    flags = uploaded_by(near)
    far = select(TREES, lens_of(view_at(1e6)), flags, LIMITS, near.made)
    spot = LAND.level[far.terrain] > 6
    assert set(near.terrain[LAND.level[near.terrain] > 6]) == set(far.terrain[spot])
    flags[Lane.TERRAIN][far.wants[Lane.TERRAIN].rows] = 1
    later = select(TREES, lens_of(view_at(1e6)), flags, LIMITS, far.made)
    assert LAND.level[later.terrain].max() < LAND.level[far.terrain].max()


def test_detail_does_not_change_back_and_forth_at_the_threshold() -> None:
    lens, flags = lens_of(view_at(1e5)), everything(TREES)
    first = select(TREES, lens, flags, LIMITS)
    for factor in (1.05, 0.999, 1.1, 1.2):
        again = select(TREES, lens, flags, LIMITS.times(factor), first.made)
        assert set(first.terrain) <= set(again.terrain) | set(
            select(TREES, lens, flags, LIMITS.times(factor * 0.8)).terrain
        )
        assert set(again.terrain) == set(first.terrain)


def test_a_far_jump_wants_some_levels_in_between_and_skips_others() -> None:
    flags = flags_with_roots(np.zeros(len(CELLS), np.uint8))
    chosen = select(TREES, lens_of(view_at(1e3)), flags, LIMITS)
    spot = np.flatnonzero(cells.contains(CELLS, cells.cell_at(*SPOT, 12)))
    asked = LAND.level[np.intersect1d(spot, chosen.wants[Lane.TERRAIN].rows)]
    assert {2, 4, 6, 8, 10} <= set(asked.tolist())
    assert not {1, 3, 5, 7, 9} & set(asked.tolist())


def test_missing_siblings_share_one_urgency_so_that_none_holds_up_the_others() -> None:
    lens = lens_of(view_at(1e4, pitch_deg=-20.0))
    ideal = select(TREES, lens, everything(TREES), LIMITS)
    deepest = int(ideal.terrain[np.argmax(LAND.level[ideal.terrain])])
    kids = LAND.children[LAND.parent[deepest]]
    flags = uploaded_by(ideal)
    flags[Lane.TERRAIN][kids] = 0
    flags[Lane.TERRAIN][LAND.parent[deepest]] = 1
    wants = select(TREES, lens, flags, LIMITS).wants[Lane.TERRAIN]
    benefit = wants.benefit[np.isin(wants.rows, kids)]
    assert len(benefit) == 4
    assert benefit.max() <= 2 * benefit.min()


@given(VIEWS, SUBSETS)
def test_a_skirt_is_as_deep_as_both_errors_of_every_pair_of_neighbours(
    view: ViewState, subset: U1
) -> None:
    chosen = select(TREES, lens_of(view), flags_with_roots(subset), LIMITS)
    drawn, skirt_m = chosen.terrain, chosen.skirt_m
    place = {int(row): i for i, row in enumerate(drawn)}
    forest = FORESTS[Lane.TERRAIN]
    for i, row in enumerate(drawn.tolist()):
        for k in range(4):
            other = int(forest.links[row, k])
            while other >= 0 and other not in place:
                other = int(forest.parent[other])
            if other >= 0:
                both_m = LAND.mesh_error_m[row] + LAND.mesh_error_m[other]
                assert min(skirt_m[i], skirt_m[place[other]]) >= both_m * (1 - 1e-6)


def test_a_zone_root_is_wanted_before_everything_else() -> None:
    flags = {lane: np.zeros_like(tree.has_tile) for lane, tree in TREES.items()}
    wants = select(TREES, lens_of(view_at(1e3)), flags, LIMITS).wants[Lane.TERRAIN]
    first = wants.rows[np.argsort(-wants.benefit)][:32]
    assert sorted(first.tolist()) == list(range(32))


def test_the_coarsest_mesh_within_the_threshold_is_drawn() -> None:
    """And one that was drawn goes only when the threshold is well below its error."""
    records = deep_globe()
    for times, name in zip((1.2, 1.4, 1.7), RUNG_FIELDS, strict=True):
        records[name] = times * records["error_m"]
    forests = {**FORESTS, Lane.TERRAIN: build_forest(records)}
    trees = trees_of(forests)
    land, lens = trees[Lane.TERRAIN], lens_of(view_at(2e3))
    scale = scales_of(lens, land)
    seen: set[int] = set()
    inner: set[int] = set()
    for px in np.geomspace(0.1, 400.0, 60).tolist():
        chosen = select(trees, lens, everything(trees), Thresholds(px, px))
        rows, every = chosen.terrain, np.column_stack((land.mesh_error_m, land.rung_m))
        error_px = every[rows] * scale[rows, None]
        expected = np.where(error_px[:, 1:] <= px, [1, 2, 3], 0).max(axis=1)
        assert chosen.rung.tolist() == expected.tolist()
        drawn_m = every[rows, chosen.rung]
        assert (chosen.skirt_m >= drawn_m).all()
        seen |= set(chosen.rung.tolist())
        limits = Thresholds(0.9 * px, 0.9 * px)
        again = select(trees, lens, everything(trees), limits, chosen.made)
        back = select(trees, lens, everything(trees), Thresholds(px, px), again.made)
        both = np.intersect1d(again.terrain, back.terrain)
        changed = [c.rung[np.isin(c.terrain, both)].tolist() for c in (again, back)]
        assert changed[0] == changed[1]
        inner |= set(chosen.rung[land.children[rows, 0] >= 0].tolist())
    assert seen == inner == {0, 1, 2, 3}
