# SPDX-License-Identifier: Apache-2.0
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from geopage.draw_list import DrawList
from geopage.pager import Pager
from geopage.selection import ideal
from geopage.settings import PagerSettings
from geopage.transitions import Transitions
from tests.geopage.stub_renderer import StubRenderer
from tests.geopage.test_object_selection import BLOCKS, FORESTS, LIMITS, TOWN, chosen_with
from tests.geopage.test_pager import run_until_settled
from tests.geopage.worlds import SPOT, view_at

FADE_S = 0.25
STEP_S = 1 / 30
PATTERN = (np.arange(16) + 0.5) / 16
ALL = np.ones(len(TOWN.parent), np.uint8)
Parts = frozenset[tuple[int, int]]


def parts_at(drawn: DrawList, t_s: float, p: float) -> list[tuple[int, int]]:
    """What a pixel with the value `p` of the pattern shows; bit 4 is own objects."""
    shares = drawn.shares(t_s)
    if not len(shares):
        shares = np.tile(np.float32((0, 1)), (len(drawn.objects), 1))
    shown = (shares[:, 0] <= np.float32(p)) & (np.float32(p) < shares[:, 1])
    bits = drawn.proxies | drawn.own.astype(np.uint8) << 4
    entries = zip(drawn.objects[shown].tolist(), bits[shown].tolist(), strict=True)
    return [(row, k) for row, part in entries for k in range(5) if part >> k & 1]


def pictures_of(block: int, parts: Parts) -> int:
    """How many of some parts show a block: its own objects, and proxies above it."""
    count, row = int((block, 4) in parts), block
    while (parent := int(TOWN.parent[row])) >= 0:
        count += (parent, TOWN.children[parent].tolist().index(row)) in parts
        row = parent
    return count


def selected(height_m: float, east: float, seed: int, share: float, t_s: float) -> DrawList:
    """The selection of a view in which a random share of the town's tiles is there."""
    flags = (np.random.default_rng(seed).random(len(ALL)) < share) & (TOWN.has_tile > 0)
    view = view_at(height_m, (SPOT[0] + east, SPOT[1]), t_s=t_s)
    chosen = chosen_with(view, flags.astype(np.uint8))
    return chosen.draw_list(1, view, LIMITS, settled=False)


POSES = st.tuples(
    st.floats(1.5, 6.0).map(lambda x: 10.0**x),
    st.floats(-0.001, 0.001),
    st.integers(0, 5),
    st.sampled_from([0.3, 0.7, 1.0, 1.0]),
    st.integers(1, 12),
)


@settings(max_examples=20)
@given(st.lists(POSES, min_size=2, max_size=12))
def test_a_pixel_shows_the_whole_selection_of_some_time_ago(
    walk: list[tuple[float, float, int, float, int]],
) -> None:
    transitions, history, t_s = Transitions(FADE_S), [], 0.0
    for *pose, steps in walk:
        t_s += steps * STEP_S
        newest = selected(*pose, t_s)  # type: ignore[arg-type]
        history.append((t_s, frozenset(parts_at(newest, t_s, 0.5))))
        drawn = transitions.blend(newest, ALL, t_s)
        assert frozenset(parts_at(drawn.solid(), t_s, 0.5)) == history[-1][1]
        for later_s in (t_s, t_s + STEP_S / 3):
            for p in PATTERN:
                shown = parts_at(drawn, later_s, p)
                then = [was for was in history if was[0] <= later_s - p * FADE_S]
                assert len(shown) == len(set(shown))
                assert set(shown) == (then or history[:1])[-1][1]


def fly(pager: Pager, heights: np.ndarray, start: int = 0) -> list[DrawList]:
    renderer, lists = StubRenderer(pager), []
    for i, height_m in enumerate(heights, start):
        view = view_at(float(height_m), t_s=i * STEP_S)
        lists.append(renderer.frame(view))
        pager.step(view.t_s)
    return lists


def test_buildings_stay_covered_in_every_list_of_a_flight_in_and_out(
    store_path: Path,
) -> None:
    down = np.geomspace(1e6, 100.0, 100)
    with Pager(store_path, PagerSettings(fade_s=FADE_S)) as pager:
        lists = fly(pager, np.concatenate((down, down[::-1])))
    assert sum(drawn.fade is not None for drawn in lists) > 20
    history: list[tuple[float, Parts]] = []
    covered = 0
    for drawn in lists:
        t_s = drawn.view.t_s
        history = history if drawn.fade else []
        history.append((t_s, frozenset(parts_at(drawn.solid(), t_s, 0.5))))
        recent = [was for at_s, was in history if at_s > t_s - FADE_S - STEP_S]
        for block in BLOCKS.tolist():
            always = min(pictures_of(block, was) for was in recent)
            for p in PATTERN[::3]:
                shown = frozenset(parts_at(drawn, t_s, p))
                assert always <= pictures_of(block, shown) <= 1
            covered += always
    assert covered > len(BLOCKS) * len(lists) / 3


def two_lists() -> tuple[DrawList, DrawList]:
    far, near = (
        ideal(FORESTS, view_at(3e4), 2.0, 2.0),
        ideal(FORESTS, view_at(300.0), 2.0, 2.0),
    )
    assert set(far.objects) - set(near.objects)
    return far, near


def test_a_fade_ends_by_the_clock_of_the_steps_when_the_view_stands_still() -> None:
    far, near = two_lists()
    transitions = Transitions(FADE_S)
    assert transitions.blend(far, ALL, 0.0).fade is None  # the first of all
    assert transitions.ends_s == np.inf
    assert transitions.blend(near, ALL, 1.0).fade is not None
    assert transitions.ends_s == 1.0 + FADE_S
    assert transitions.blend(near, ALL, 1.0 + FADE_S).fade is None
    assert transitions.ends_s == np.inf


def test_what_is_evicted_while_it_fades_is_not_drawn_and_nothing_fades() -> None:
    far, near = two_lists()
    transitions = Transitions(FADE_S)
    transitions.blend(far, ALL, 0.0)
    fading = transitions.blend(near, ALL, 1.0)
    gone = ALL.copy()
    gone[next(iter(set(fading.objects) - set(near.objects)))] = 0
    cut = transitions.blend(near, gone, 1.01)
    assert cut.fade is None
    assert cut.objects.tolist() == near.objects.tolist()


def test_a_clock_that_is_set_back_ends_all_fades() -> None:
    far, near = two_lists()
    transitions = Transitions(FADE_S)
    transitions.blend(replace(far, view=replace(far.view, t_s=9.0)), ALL, 0.0)
    transitions.blend(replace(near, view=replace(near.view, t_s=9.1)), ALL, 0.1)
    assert transitions.blend(near, ALL, 0.2).fade is None


def test_without_fades_a_list_is_the_selection() -> None:
    far, near = two_lists()
    transitions = Transitions(0.0)
    assert transitions.blend(far, ALL, 0.0) is far
    assert transitions.blend(near, ALL, 0.0) is near


def test_a_fade_at_rest_wakes_the_scene_once_and_then_nobody(store_path: Path) -> None:
    with Pager(store_path, PagerSettings(fade_s=0.1)) as pager:
        pager.start()
        renderer = StubRenderer(pager)
        drawn = run_until_settled(renderer, view_at(300.0))
        assert drawn.fade is None
        assert len(drawn.objects)
        pause = threading.Event()
        pause.wait(0.05)
        before = dict(pager.wake_ups)
        pause.wait(0.3)
        assert pager.wake_ups == before


def test_fading_tiles_are_kept_uploaded_and_the_budget_holds(store_path: Path) -> None:
    # The stub renderer checks that it has what every list draws.
    heights = np.geomspace(2e5, 100.0, 100)
    zig_zag = np.concatenate([heights, heights[::-1]] * 2)
    fading = 0
    for budget in (520_000, 600_000, 720_000, 2**22):
        with Pager(store_path, PagerSettings(budget_bytes=budget, fade_s=FADE_S)) as pager:
            fading = sum(drawn.fade is not None for drawn in fly(pager, zig_zag))
            assert pager.memory()["peak_bytes"] <= budget
    assert fading > len(zig_zag) / 10
