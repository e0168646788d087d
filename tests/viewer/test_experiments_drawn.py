# SPDX-License-Identifier: Apache-2.0
"""E2, E5 and E6 at a tiny scale, the report, and the command."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from geopage.screen_error import lens_of
from geopage.settings import MIB, PagerSettings, Throttle
from tests.viewer.small_world import ROWS, make_store, write_path
from tiles.lanes import Lane
from tiles.store import Store
from tiles.surface import Surface
from viewer.camera import focal_px
from viewer.camera_path import read_path
from viewer.cli_experiments import experiments
from viewer.experiments import cull_chain, fly_in, os_paging, stall, town
from viewer.experiments.cull_rows import THRESHOLDS_PX
from viewer.experiments.cull_rows import figures as cull_figures
from viewer.experiments.fly_in_rows import ALL, ALONE, LEVELS, METHODS, ONE, figures
from viewer.experiments.rows import LESS, MORE, SAME, Row
from viewer.poses import Flight
from viewer.session import Picture, Session

SIZE_PX = (96, 64)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of hills and a few blocks, and a flight down to them."""
    folder = tmp_path_factory.mktemp("experiments")
    write_path(folder / "down.json", 1.0, (20_000.0, 300.0))
    return make_store(folder)


def flight_over(store: Path) -> Flight:
    with Store(store) as reader:
        path = read_path(store.parent / "down.json")
        return Flight(path, Surface(reader), SIZE_PX)


@pytest.mark.parametrize(
    ("paper", "ours", "good", "said"),
    [
        (10.0, 10.9, LESS, "alike"),
        (10.0, 12.0, LESS, "worse"),
        (10.0, 12.0, MORE, "better"),
        (10.0, 5.0, LESS, "better"),
        (10.0, 5.0, SAME, "differs"),
        (10.0, 5.0, "", ""),
        (None, 5.0, LESS, ""),
        (10.0, None, LESS, ""),
    ],
)
def test_a_row_says_how_ours_stands(
    paper: float | None, ours: float | None, good: str, said: str
) -> None:
    assert Row("E0", "", "", "", paper, "", ours, good=good).against == said


@pytest.mark.gpu
@pytest.mark.usefixtures("gl_context")
def test_each_stage_of_e2_leaves_what_counting_leaves(small: Path) -> None:
    view = flight_over(small).view(1.0)
    settings = PagerSettings(2.0, budget_bytes=256 * MIB, fade_s=0.0)
    with Session(small, settings, Picture(SIZE_PX)) as session:
        buildings = cull_chain.buildings_of(session)
        chain = cull_chain.measure(session, [view], lambda done: None)
    assert chain.buildings == ROWS**2
    # A box is two triangles for its roof and eight for its walls.
    assert chain.triangles == 10 * ROWS**2
    away = (buildings.centre - view.eye) @ view.rotation.T
    tan = np.array(SIZE_PX) / 2 / view.focal_px
    slack = buildings.radius_m[:, None] * np.sqrt(1 + tan**2)
    inside = (np.abs(away[:, :2]) <= -away[:, 2:] * tan + slack).all(axis=1)
    assert chain.left["buildings in view"][0][0] == inside.sum()
    counts = [chain.left[stage][0][0] for stage in STAGES]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] > 0
    details = [chain.left[f"{px:g} px"][0][1] for px in THRESHOLDS_PX]
    assert details == sorted(details, reverse=True)
    rows = cull_figures(chain, chain).rows
    assert len({(row.condition, row.quantity) for row in rows}) == len(rows)
    printed = [row.paper for row in rows if row.paper is not None]
    assert printed == [32, 15, 8.5, 5.6, 4, 2.5, 1.4, 17, 39, 96, 47, 47, 10, 0.9]


STAGES = ("tiles in view", "buildings in view", "buildings with a pixel")


def test_a_downtown_has_471_buildings_that_stand_apart() -> None:
    buildings = town.downtown()
    assert len(buildings) == town.COUNT
    assert max(height for _, height in buildings) == town.TOWER_M
    low = np.array([corners.min(axis=0) for corners, _ in buildings])
    high = np.array([corners.max(axis=0) for corners, _ in buildings])
    for k in range(0, town.COUNT, 13):
        assert ((low <= high[k]) & (high >= low[k])).all(axis=1).sum() == 1
    nearest = np.linalg.norm(np.maximum(np.maximum(low, -high), 0), axis=1).min()
    assert nearest > 50.0


@pytest.fixture(scope="module")
def downtown(small: Path) -> Path:
    """The hills with one downtown instead of the blocks, as the command makes it."""
    store = small.with_name("town.geopage")
    town.bare_copy(small, store)
    assert town.build(store, 1) == town.COUNT
    with Store(store) as reader:
        assert reader.object_count() == town.COUNT
        assert [source["name"] for source in reader.sources("buildings")] == [town.NAME]
    return store


@pytest.mark.gpu
@pytest.mark.usefixtures("gl_context")
def test_e5_draws_more_the_less_hierarchy_there_is(downtown: Path) -> None:
    first, again = (fly_in.measure(downtown, town.COUNT, 5, SIZE_PX) for _ in range(2))
    for method in METHODS:
        counts = [one.triangles for one in first.by_height[method]]
        assert counts == [one.triangles for one in again.by_height[method]]
    totals = [sum(one.triangles for one in first.by_height[method]) for method in METHODS]
    by_name = dict(zip(METHODS, totals, strict=True))
    assert by_name[ALONE] < by_name[LEVELS] <= by_name[ONE] < by_name[ALL]
    assert first.first_m == again.first_m
    # s f / threshold, but for the height of the tower and the size of its tile.
    expected_m = town.TOWER_M * focal_px(SIZE_PX[1], math.radians(60))
    assert first.expected_m == pytest.approx(expected_m)
    assert first.first_m == pytest.approx(expected_m, rel=0.1)
    for name in ("pan", "orbit"):
        on, off = first.turning[name, True], first.turning[name, False]
        for one, other in zip(on, off, strict=True):
            assert one.triangles < other.triangles
    found = figures([first])
    untimed = [row for row in found.rows if not row.timed]
    assert untimed == [row for row in figures([again]).rows if not row.timed]
    assert {row.paper for row in found.rows} == {None, 7.0, 17.5, 40.0, 100.0, 160.0}


@pytest.mark.gpu
@pytest.mark.usefixtures("gl_context")
def test_without_culling_the_picture_is_the_same_and_more_is_drawn(downtown: Path) -> None:
    settings = PagerSettings(1.0, budget_bytes=256 * MIB, fade_s=0.0)
    with Session(downtown, settings, Picture(SIZE_PX)) as session:
        view = fly_in.pan(100.0, SIZE_PX)[1]
        drawn = fly_in.chosen(session.pager.forests, view, 1.0, culls=False)
        session.hold(drawn)
        few = session.renderer.draw(drawn, view).triangles
        culled = session.renderer.read_rgb()
        session.renderer.culls = False
        assert session.renderer.draw(drawn, view).triangles > few
        assert (session.renderer.read_rgb() == culled).all()
        assert lens_of(view).cone_cos > 0
        assert len(session.pager.forests[Lane.OBJECTS].records)


def test_e6_waits_longer_behind_a_slower_line_and_the_same_twice(small: Path) -> None:
    lines = {"fast": Throttle(1.0, 5.0), "slow": Throttle(0.05, 50.0)}
    flight = flight_over(small)
    first, again = (
        stall.measure(small, flight, lines, 1 / 20, lambda done: None) for _ in range(2)
    )
    assert first.rows == again.rows
    waits = [row.ours for row in first.rows if row.quantity.startswith("wait at")]
    assert len(waits) == len(lines) * len(stall.POLICIES)
    half = len(stall.POLICIES)
    for fast, slow in zip(waits[:half], waits[half:], strict=True):
        assert fast is not None
        assert slow is not None
        assert fast <= slow


def test_the_command_writes_table_page_and_charts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os_paging, "MEMORY", 1_500_000)
    words = ["--out", str(tmp_path), "--only", "e1", "--quick", "--json"]
    assert experiments(words) == 0
    told = json.loads(capsys.readouterr().out)["E1"]
    lines = (tmp_path / "experiments.csv").read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    assert any("machine" in line for line in head)
    assert any("commit" in line for line in head)
    table = list(csv.DictReader(lines[len(head) :]))
    assert [row["quantity"] for row in table] == [row["quantity"] for row in told]
    assert {row["experiment"] for row in table} == {"E1"}
    text = (tmp_path / "EXPERIMENTS.md").read_text()
    assert text.count("\n| ") == len(table) + 2
    page = (tmp_path / "index.html").read_text()
    assert 'src="e1_frames.svg"' in page
    assert (tmp_path / "e1_frames.svg").stat().st_size > 1000


@pytest.mark.parametrize("words", [[], ["--out", "x", "--only", "E7"], ["--quick"]])
def test_words_that_mean_nothing_are_refused(words: list[str]) -> None:
    with pytest.raises(SystemExit) as left:
        experiments(words)
    assert left.value.code == 2
