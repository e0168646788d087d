# SPDX-License-Identifier: Apache-2.0
"""A held frame rate on a real store: what is counted, set and reported."""

import csv
import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest

from geopage.selection import Thresholds
from geopage.settings import MIB, PagerSettings
from geopage.view import ViewState
from tests.viewer.small_world import write_path
from tiles.lanes import Lane
from viewer.camera_path import read_path
from viewer.complete import CompleteFrames
from viewer.flight import fly_paced
from viewer.governor import Governor
from viewer.load import Forecast, ahead_of
from viewer.poses import Flight
from viewer.run import Run, fly
from viewer.session import Picture, Session

pytestmark = pytest.mark.usefixtures("gl_context")
PICTURE = Picture((160, 96))
SETTINGS = PagerSettings(0.5, budget_bytes=128 * MIB)
TIMES_S = (0.0, 5.0, 8.0, 9.5)


@pytest.fixture
def session(hill_store: Path) -> Iterator[Session]:
    with Session(hill_store, SETTINGS, PICTURE) as made:
        yield made


@pytest.fixture
def flight(session: Session, tmp_path: Path) -> Flight:
    path = write_path(tmp_path / "down.json", 10.0, (1e6, 200.0))
    return Flight(read_path(path), session.surface, PICTURE.size_px)


def test_what_is_counted_is_what_is_drawn(session: Session, flight: Flight) -> None:
    frames, forecast = CompleteFrames(session), Forecast(session.pager, session.renderer)
    for t_s in TIMES_S:
        for limits in (Thresholds(0.5, 0.5), Thresholds(2.0, 8.0)):
            view = flight.view(t_s)
            _, stats = frames.draw(view, limits)
            load = forecast.load(view, limits)
            assert load == (stats.triangles, stats.draw_calls)


def test_tiles_that_are_not_there_count_as_the_others_do(
    session: Session, flight: Flight
) -> None:
    view, limits = flight.view(9.5), Thresholds(0.5, 0.5)
    forecast = Forecast(session.pager, session.renderer)
    drawn, stats = CompleteFrames(session).draw(view, limits)
    for lane, rows in ((Lane.TERRAIN, drawn.terrain), (Lane.OBJECTS, drawn.objects)):
        for row in rows[::3].tolist():
            session.renderer.free(lane, row)
    load = forecast.load(view, limits)
    assert load.triangles == pytest.approx(stats.triangles, rel=0.5)
    assert load.draws == pytest.approx(stats.draw_calls, rel=0.5)


def test_coarser_thresholds_are_expected_to_draw_less(
    session: Session, flight: Flight
) -> None:
    frames, forecast = CompleteFrames(session), Forecast(session.pager, session.renderer)
    view = flight.view(9.0)
    frames.draw(view, Thresholds(0.5, 0.5))
    loads = [forecast.load(view, Thresholds(px, px)) for px in (0.5, 2.0, 8.0, 32.0)]
    # Larger tiles are left out less well.
    for finer, coarser in itertools.pairwise(loads):
        assert coarser.triangles < 1.1 * finer.triangles
        assert coarser.draws < 1.2 * finer.draws
    assert loads[-1].triangles < 0.8 * loads[0].triangles


def test_the_forecast_looks_where_the_eye_will_be(flight: Flight) -> None:
    views: list[ViewState] = [flight.view(8.0 + i / 60) for i in range(12)]
    ahead, now, later = ahead_of(views), views[-1], flight.view(views[-1].t_s + 0.25)

    def apart(a: ViewState, b: ViewState) -> float:
        return float(((a.eye - b.eye) ** 2).sum() ** 0.5)

    assert apart(ahead, later) < 0.2 * apart(now, later)
    assert ahead_of(views[:1]) is views[0]


def test_a_rate_out_of_reach_makes_detail_coarser(hill_store: Path, tmp_path: Path) -> None:
    path = read_path(write_path(tmp_path / "still.json", 2.0, (2e4, 19_999.0)))
    with Session(hill_store, SETTINGS, PICTURE) as session:
        governor = Governor(session, Thresholds(0.5, 0.5), fps=2000.0)
        flight = Flight(path, session.surface, PICTURE.size_px)
        frames = fly_paced(session, flight, lambda _: None, governor).table()
        held = governor.figures(frames)
        governor.limits = Thresholds(1.5, 3.0)
        asked = session.pager.settings
        governor.rest(on=True)
        resting = session.pager.settings
        governor.rest(on=False)
        assert session.pager.settings == asked
    assert held["budget_ms"] == 0.5
    assert held["changes"] >= 1
    assert frames["threshold_px"][0] == 0.5
    assert held["threshold_px"]["max"] == frames["threshold_px"].max() > 0.5
    assert (frames["expected_ms"] >= 0).all()
    assert (resting.threshold_px, resting.objects_px) == (1.5, 3.0)
    factor = governor.budget.factor
    assert (asked.threshold_px, asked.objects_px) == (1.5 * factor, 3.0 * factor)


def test_a_rate_within_reach_leaves_the_threshold_as_it_was_set(
    hill_store: Path, tmp_path: Path
) -> None:
    path = write_path(tmp_path / "still.json", 0.9, (400.0, 399.0))
    report = fly(hill_store, SETTINGS, PICTURE, Run(path, tmp_path / "out", fps=2.0))
    assert report["frame_budget"]["changes"] == 0
    with (tmp_path / "out" / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["threshold_px"] for row in rows} == {"0.5"}
    assert all(float(row["expected_ms"]) >= 0 for row in rows)
    assert "budget" in (tmp_path / "out" / "flight.svg").read_text()
