# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geopage.object_visit import STAY
from geopage.screen_error import STILL, Lens, Sweep, blur_px, lens_of, px_per_m
from geopage.selection import Selection, Thresholds, everything, ideal, select, trees_of
from geopage.tree import U1
from geopage.view import ViewState
from tests.geopage.worlds import (
    BLOCK_LEVEL,
    CITY_LEVELS,
    SPOT,
    deep_globe,
    object_records,
    view_at,
)
from tiles import geodesy
from tiles.forest import build_forest
from tiles.frames import Ecef
from tiles.lanes import Lane

FORESTS = {
    Lane.TERRAIN: build_forest(deep_globe()),
    Lane.OBJECTS: build_forest(object_records()),
}
TREES = trees_of(FORESTS)
TOWN = TREES[Lane.OBJECTS]
BLOCKS = np.flatnonzero(TOWN.level == BLOCK_LEVEL)
LIMITS = Thresholds(2.0, 2.0)
VIEWS = st.builds(
    lambda height, east, north, pitch, heading: view_at(
        10.0**height, (SPOT[0] + east, SPOT[1] + north), pitch, heading
    ),
    st.floats(1.5, 7.3),
    st.floats(-0.002, 0.002),
    st.floats(-0.002, 0.002),
    st.floats(-90, 0),
    st.floats(0, 360),
)
SUBSETS = st.builds(
    lambda seed, share: (
        (np.random.default_rng(seed).random(len(TOWN.parent)) < share) & (TOWN.has_tile > 0)
    ).astype(np.uint8),
    st.integers(0, 2**32 - 1),
    st.floats(0, 1),
)


def chosen_with(
    view: ViewState, flags: U1, limits: Thresholds = LIMITS, sweep: Sweep = STILL
) -> Selection:
    land = np.ones(len(TREES[Lane.TERRAIN].parent), np.uint8)
    lens = lens_of(view, sweep=sweep)
    return select(TREES, lens, {Lane.TERRAIN: land, Lane.OBJECTS: flags}, limits)


def times_shown(chosen: Selection, block: int) -> int:
    """How many pictures of a block are drawn: its own objects, and proxies above it."""
    drawn = dict(zip(chosen.objects.tolist(), range(len(chosen.objects)), strict=True))
    count = int(block in drawn and chosen.own[drawn[block]])
    row = block
    while (parent := int(TOWN.parent[row])) >= 0:
        k = TOWN.children[parent].tolist().index(row)
        count += parent in drawn and int(chosen.proxies[drawn[parent]]) >> k & 1
        row = parent
    return count


def uploaded(rows: object) -> U1:
    flags = np.zeros(len(TOWN.parent), np.uint8)
    flags[rows] = TOWN.has_tile[rows]
    return flags


SWEEPS = st.builds(
    lambda speed, spin, shutter: Sweep(
        (0.6 * 10.0**speed, 0.8 * 10.0**speed, 0.0), (0.0, 0.0, spin), shutter
    ),
    st.floats(0, 5),
    st.sampled_from([0.0, 0.3, 2.0]),
    st.sampled_from([0.0, 1 / 60]),
)


@given(VIEWS, SUBSETS, SWEEPS)
def test_no_block_is_drawn_both_itself_and_by_a_proxy(
    view: ViewState, flags: U1, sweep: Sweep
) -> None:
    chosen = chosen_with(view, flags, sweep=sweep)
    assert max(times_shown(chosen, block) for block in BLOCKS.tolist()) <= 1
    assert flags[chosen.objects].all()


@given(VIEWS, SWEEPS)
def test_what_speed_leaves_out_passes_by_faster_than_its_size(
    view: ViewState, sweep: Sweep
) -> None:
    flags, lens = everything(TREES)[Lane.OBJECTS], lens_of(view, sweep=sweep)
    usual, chosen = chosen_with(view, flags), chosen_with(view, flags, sweep=sweep)
    for block in BLOCKS.tolist():
        if not times_shown(chosen, block) and block in usual.objects[usual.own].tolist():
            assert any(passes_by(lens, block, row) for row in path_to(block))


def passes_by(lens: Lens, block: int, row: int) -> bool:
    """Whether a cell moves by more than a block's size, so that nobody looks into it."""
    sphere = *TOWN.centre[row], TOWN.radius_m[row]
    return bool(TOWN.own_m[block] * px_per_m(lens, *sphere) <= blur_px(lens, *sphere))


def path_to(row: int) -> list[int]:
    """A cell and all above it."""
    return [row, *path_to(int(TOWN.parent[row]))] if row >= 0 else []


@given(VIEWS, SUBSETS)
def test_with_the_skyline_uploaded_every_block_that_counts_is_drawn(
    view: ViewState, flags: U1
) -> None:
    flags = flags | uploaded(TOWN.level == CITY_LEVELS[0])
    best = ideal(FORESTS, view, 2.0, 2.0)
    chosen = chosen_with(view, flags)
    for block in BLOCKS.tolist():
        wanted = times_shown(best, block)  # type: ignore[arg-type]
        assert times_shown(chosen, block) >= wanted


@given(VIEWS, SUBSETS)
def test_loading_what_is_wanted_ends_with_the_ideal(view: ViewState, flags: U1) -> None:
    flags = flags.copy()
    for _ in range(8):
        chosen = chosen_with(view, flags)
        wanted = chosen.wants[Lane.OBJECTS].rows
        assert not flags[wanted].any()
        assert TOWN.has_tile[wanted].all()
        flags[wanted] = 1
    best = ideal(FORESTS, view, 2.0, 2.0)
    assert chosen.objects.tolist() == best.objects.tolist()
    assert chosen.own.tolist() == best.own.tolist()
    assert chosen.proxies.tolist() == best.proxies.tolist()
    assert len(wanted) == 0


def facing(row: int, distance_m: float) -> ViewState:
    """A view whose axis goes through the centre of a cell's sphere, from above."""
    centre = Ecef(TOWN.centre[row])
    lon, lat, _ = geodesy.to_geodetic(centre)
    up = geodesy.up(lon, lat)
    view = view_at(0.0, (float(lon), float(lat)))
    eye = Ecef(centre + up * (distance_m + TOWN.radius_m[row]))
    return ViewState(0.0, eye, view.rotation, view.focal_px, view.width_px, view.height_px)


@pytest.mark.parametrize("tau", [1.0, 2.0, 10.0])
def test_an_object_appears_at_size_times_focal_over_threshold(tau: float) -> None:
    block = int(BLOCKS[5])
    limits = Thresholds(1e-3, tau)  # proxies are never good enough
    reach_m = float(TOWN.own_m[block]) * view_at(0.0).focal_px / tau
    shown = {}
    for share in (0.999999, 1.000001):
        chosen = chosen_with(
            facing(block, reach_m * share), everything(TREES)[Lane.OBJECTS], limits
        )
        own = chosen.objects[chosen.own]
        shown[share] = block in own.tolist()
    assert shown == {0.999999: True, 1.000001: False}


def test_the_town_appears_at_size_times_focal_over_threshold() -> None:
    top = int(np.flatnonzero(TOWN.level == CITY_LEVELS[0])[0])
    reach_m = float(TOWN.proxy_m[top]) * view_at(0.0).focal_px / 2.0
    for share, seen in ((0.999, True), (1.001, False)):
        best = ideal(FORESTS, facing(top, reach_m * share), 2.0, 2.0)
        assert (top in best.objects.tolist()) == seen


def test_what_was_drawn_goes_later_than_it_came() -> None:
    top = int(np.flatnonzero(TOWN.level == CITY_LEVELS[0])[0])
    reach_m = float(TOWN.proxy_m[top]) * view_at(0.0).focal_px / 2.0
    flags = everything(TREES)

    def drawn(share: float, before: Selection | None) -> Selection:
        lens = lens_of(facing(top, reach_m * share))
        return select(TREES, lens, flags, LIMITS, before.made if before else None)

    came = drawn(0.999, None)
    for share, stays in ((1.001, True), (0.999 / STAY, True), (1.001 / STAY, False)):
        assert (top in drawn(share, came).objects.tolist()) == stays
    assert top not in drawn(1.001, None).objects.tolist()


def test_a_view_that_stands_still_selects_the_same_again() -> None:
    for height_m in np.geomspace(50.0, 1e6, 12).tolist():
        lens = lens_of(view_at(height_m))
        first = select(TREES, lens, everything(TREES), LIMITS)
        again = select(TREES, lens, everything(TREES), LIMITS, first.made)
        assert again.objects.tolist() == first.objects.tolist()
        assert again.proxies.tolist() == first.proxies.tolist()
        assert again.own.tolist() == first.own.tolist()


def test_tiles_that_can_stand_in_count_as_kept() -> None:
    chosen = select(TREES, lens_of(view_at(200.0)), everything(TREES), LIMITS)
    above = set(chosen.keep[Lane.OBJECTS].tolist()) - set(chosen.objects.tolist())
    levels = set(TOWN.level[list(above)].tolist())
    assert levels >= {*CITY_LEVELS[:2]}


def test_blocks_stay_while_the_proxy_tile_above_them_loads() -> None:
    near, far = view_at(1e3), view_at(1.2e4)
    flags = uploaded(chosen_with(near, everything(TREES)[Lane.OBJECTS]).objects)
    middle = TOWN.level == CITY_LEVELS[1]
    flags[middle | (TOWN.level == CITY_LEVELS[0])] = 0
    chosen = chosen_with(far, flags)
    wanted = chosen.wants[Lane.OBJECTS]
    assert set(TOWN.level[wanted.rows]) & set(CITY_LEVELS[:2])
    assert (TOWN.level[chosen.objects] == BLOCK_LEVEL).all()


def test_a_world_without_objects_draws_and_wants_none() -> None:
    forests = {**FORESTS, Lane.OBJECTS: build_forest(object_records()[:0])}
    drawn = ideal(forests, view_at(100.0), 2.0, 2.0)
    assert len(drawn.objects) == len(drawn.own) == len(drawn.proxies) == 0
