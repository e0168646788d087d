# SPDX-License-Identifier: Apache-2.0
"""The app in a real window, stepped by the tests' own clock."""

import math
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.viewer.flown import FINE, STEP_S, Flown, open_app, over_city
from tests.viewer.screen import Screen
from tiles.errors import InputError
from viewer.app_state import MESSAGE_S
from viewer.bookmarks import files_of, read_bookmarks
from viewer.camera_path import read_path
from viewer.events import Key, MouseMove, Wheel
from viewer.open_window import hud_of, make_folder

SIZE = 320, 200
MIDDLE = 160.0, 100.0


@pytest.fixture(scope="module")
def opened(
    hill_store: Path, screen: Screen, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Flown]:
    assert screen.display
    with open_app(hill_store, tmp_path_factory.mktemp("app"), SIZE) as app:
        yield app


@pytest.fixture
def app(opened: Flown) -> Flown:
    opened.state.picked, opened.state.frozen, opened.state.closing = None, False, False
    opened.search.ask("")
    opened.put(over_city(2000.0))
    return opened


def test_the_picture_is_on_the_screen(app: Flown, screen: Screen) -> None:
    app.go()
    shown = screen.picture()[: SIZE[1], : SIZE[0]]
    drawn = app.session.renderer.read_rgb()
    assert drawn.std() > 2
    assert np.abs(shown.astype(int) - drawn).max() <= 1


def test_what_is_touched_is_what_was_drawn(app: Flown) -> None:
    app.put(over_city(200.0, -0.7))
    drawn = app.session.renderer.read_positions()
    away_m = np.linalg.norm(drawn - app.navigator.view(0.0).eye, axis=-1)
    for x, y in ((3, 5), (160, 100), (300, 190), (77, 140)):
        point = app.touch(x + 0.5, y + 0.5)
        assert point is not None
        assert np.linalg.norm(point - drawn[y, x]) < 1e-3 * away_m[y, x]
    assert app.touch(-1, 5) is None
    app.put(over_city(3e7))
    assert app.touch(3, 3) is None


def test_dragging_keeps_the_drawn_point_under_the_cursor(app: Flown) -> None:
    app.put(over_city(400.0, -0.9))
    before = app.session.renderer.read_rgb()
    point = app.touch(160, 130)
    assert point is not None
    app.press(160.5, 130.5, down=True)
    for x, y in ((170.5, 120.5), (190.5, 90.5), (140.5, 160.5)):
        app.go(STEP_S, MouseMove(x, y))
        assert math.hypot(*np.subtract(app.where(point), (x, y))) < 1.0
        app.settle()
        again = app.touch(x, y)
        assert again is not None
        assert np.linalg.norm(again - point) < 1.0
    app.press(140.5, 160.5, down=False)
    app.settle()
    assert np.abs(app.session.renderer.read_rgb().astype(int) - before).mean() > 2


def test_the_wheel_zooms_to_the_cursor(app: Flown) -> None:
    point = app.touch(200, 60)
    assert point is not None
    app.go(1.0, Wheel(200.5, 60.5, 3.0))
    assert math.hypot(*np.subtract(app.where(point), (200.5, 60.5))) < 1.0
    assert app.navigator.pose.height_m < 1300


def test_a_real_double_click_approaches_the_place(app: Flown, screen: Screen) -> None:
    point = app.touch(220, 80)
    assert point is not None
    before_m = float(np.linalg.norm(app.navigator.view(0.0).eye - point))
    screen.do("mousemove", "220", "80", "click", "--repeat", "2", "--delay", "40", "1")
    end = time.monotonic() + 20
    while app.navigator.destination is None:
        assert time.monotonic() < end
        app.go(STEP_S, *app.window.take_events(0.2))
    app.go(8.0)
    after_m = float(np.linalg.norm(app.navigator.view(0.0).eye - point))
    assert after_m == pytest.approx(0.2 * before_m, rel=0.05)
    assert math.hypot(*np.subtract(app.where(point), MIDDLE)) < 1.0
    assert app.navigator.destination is None


def test_a_real_drag_takes_the_ground_along(app: Flown, screen: Screen) -> None:
    app.go()
    before = screen.picture()[: SIZE[1], : SIZE[0]].astype(int)
    point = app.touch(100, 60)
    assert point is not None
    screen.do("mousemove", "100", "60", "mousedown", "1", "mousemove", "180", "120")
    end = time.monotonic() + 20
    while math.hypot(*np.subtract(app.where(point), (180.5, 120.5))) >= 1.0:
        assert time.monotonic() < end
        app.go(STEP_S, *app.window.take_events(0.2))
    screen.do("mouseup", "1")
    app.go(STEP_S, *app.window.take_events(0.2))
    app.settle()
    after = screen.picture()[: SIZE[1], : SIZE[0]].astype(int)
    assert np.abs(after - before).mean() > 1


def test_real_keys_fly_while_they_are_held(app: Flown, screen: Screen) -> None:
    before = app.navigator.pose
    screen.do("keydown", "w")
    end = time.monotonic() + 20
    while "forward" not in app.navigator.held:
        assert time.monotonic() < end
        app.go(STEP_S, *app.window.take_events(0.2))
    app.go(0.5)
    screen.do("keyup", "w")
    while app.navigator.held:
        assert time.monotonic() < end
        app.go(STEP_S, *app.window.take_events(0.2))
    assert app.navigator.pose.lat_rad > before.lat_rad


def test_a_clicked_building_shows_its_attributes(app: Flown) -> None:
    app.put(over_city(250.0))
    ids = app.session.renderer.read_ids()
    rows, columns = np.nonzero(ids < 0)
    at = len(rows) // 2
    before = app.session.renderer.read_rgb()
    app.click(columns[at] + 0.5, rows[at] + 0.5)
    app.go(0.1)
    found = app.state.picked
    assert found is not None
    assert found["kind"] == "building"
    assert set(found["object"]["attributes"]) == {"height", "name"}
    marked = app.session.renderer.read_rgb()
    assert (marked != before).any(axis=2)[rows[at], columns[at]]
    app.do.unpick()
    app.go(0.1)
    np.testing.assert_array_equal(app.session.renderer.read_rgb(), before)


def test_a_drag_is_no_click(app: Flown) -> None:
    app.put(over_city(250.0))
    app.press(160, 100, down=True)
    app.go(STEP_S, MouseMove(180, 100))
    app.press(180, 100, down=False)
    assert app.state.picked is None


def test_two_clicks_measure_the_distance_between_them(app: Flown) -> None:
    app.key("m")
    for x in (60, 260):
        app.click(x, 100)
        app.go(1.0)
    a, b = app.state.points
    focal = SIZE[1] / (2 * math.tan(math.radians(30)))
    above_m = float(np.linalg.norm(app.navigator.view(0.0).eye - (a + b) / 2))
    assert np.linalg.norm(a - b) == pytest.approx(200 / focal * above_m, rel=0.02)
    app.key("m")
    assert not app.state.points
    assert app.state.picked is None


def test_where_nothing_changes_nothing_is_drawn_and_nobody_is_woken(app: Flown) -> None:
    app.settle()
    assert app.go(1.0) == 0
    assert app.wait_s() >= 1.0
    assert not app.session.pager.step(app.t_s)
    assert app.go(STEP_S, MouseMove(10, 10)) == 0  # over the world, without a button
    assert app.wait_s() == 0.0
    app.go(0.2)
    assert app.wait_s() >= 1.0


@pytest.mark.parametrize("size", [(1, 1), (16, 500), (333, 17)])
def test_a_window_of_any_size_is_drawn_and_comes_back(
    app: Flown, screen: Screen, size: tuple[int, int]
) -> None:
    before = app.session.renderer.read_rgb()
    number = screen.do("search", "--class", "^app$")
    end = time.monotonic() + 20
    for wanted in (size, SIZE):
        screen.do("windowsize", number, *map(str, wanted))
        while app.window.size_px != wanted:
            assert time.monotonic() < end
            app.go(STEP_S, *app.window.take_events(0.1))
        app.go(0.2)
        drawn = app.session.renderer.read_rgb()
        assert drawn.shape[:2] == (max(wanted[1], 16), max(wanted[0], 16))
    app.settle()
    after = app.session.renderer.read_rgb().astype(int)
    assert after.shape == before.shape
    assert np.abs(after - before).mean() < 1  # the selection remembers a little


def test_a_minimised_window_draws_nothing(
    app: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(type(app.window), "minimised", True)
        assert app.window.size_px == (0, 0)
        app.navigator.pose = over_city(3000.0)
        assert app.go(0.5) == 0
        assert 0 < app.wait_s() < 1
    assert app.go(0.1) > 0


def test_a_frozen_selection_stays_while_the_eye_moves(app: Flown) -> None:
    drawn = app.session.pager.draw_list()
    app.key("x")
    app.navigator.pose = over_city(300.0)
    assert app.go(1.0) > 0
    assert app.session.pager.draw_list() is drawn
    app.key("x")
    app.settle()
    newest = app.session.pager.draw_list()
    np.testing.assert_array_equal(newest.view.eye, app.navigator.view(0.0).eye)


def test_a_picture_is_settled_and_larger_than_the_window(app: Flown) -> None:
    app.state.shot_scale = 2
    app.navigator.pose = over_city(700.0, -1.0)
    app.key("p")
    app.settle()
    file = sorted(app.state.out.glob("hills-*.png"))[-1]
    with Image.open(file) as image:
        saved = np.asarray(image)
    assert saved.shape == (2 * SIZE[1], 2 * SIZE[0], 3)
    assert app.session.renderer.size_px == SIZE
    small = saved.reshape(SIZE[1], 2, SIZE[0], 2, 3).mean(axis=(1, 3))
    drawn = app.session.renderer.read_rgb()
    assert np.abs(small - drawn).mean() < 6
    assert str(file) in app.state.message


def test_a_picture_of_a_frozen_selection_leaves_it_frozen(app: Flown) -> None:
    drawn = app.session.pager.draw_list()
    app.key("x")
    app.put(over_city(500.0))
    before = len(list(app.state.out.glob("hills-*.png")))
    app.key("p")
    app.go(0.2)
    assert len(list(app.state.out.glob("hills-*.png"))) == before + 1
    assert app.session.pager.draw_list() is drawn


def test_a_recorded_tour_is_a_camera_path_that_flies_the_same_way(app: Flown) -> None:
    app.key("v")
    assert app.recorder.on
    app.go(0.1, Key("d", down=True))
    app.go(1.0)
    middle = app.navigator.pose
    app.go(1.0, Key("d", down=False))
    end = app.navigator.pose
    app.key("v")
    file = app.replayer.last
    assert file is not None
    path = read_path(file)
    assert path.duration_s == pytest.approx(2.1, abs=0.2)
    replayed = path.pose_at(1.1)
    assert abs(replayed.lon_rad - middle.lon_rad) * 6.4e6 < 2000 * 0.6 * 2 * STEP_S
    app.put(over_city(5000.0))
    app.do.replay_last()
    app.go(path.duration_s + 1.0)
    assert not app.replayer.on
    for name in ("lon_rad", "lat_rad", "height_m", "heading_rad", "pitch_rad"):
        assert getattr(app.navigator.pose, name) == pytest.approx(getattr(end, name))


def test_a_hand_on_the_globe_ends_a_replay(app: Flown) -> None:
    app.do.replay_last()
    app.go(1.0)
    assert app.replayer.on
    app.press(160, 100, down=True)
    app.press(160, 100, down=False)
    assert not app.replayer.on


def test_bookmarks_are_kept_beside_the_store(app: Flown) -> None:
    app.do.keep_bookmarks([])
    pose = app.navigator.pose
    app.do.add_bookmark("the city")
    store = app.session.store.path
    assert files_of(store)[0].exists()
    (mark,) = read_bookmarks(store)
    assert mark.name == "the city"
    for name in ("lon_rad", "lat_rad", "height_m", "heading_rad", "pitch_rad"):
        assert getattr(mark.pose(), name) == pytest.approx(getattr(pose, name))


def test_a_search_finds_a_building_and_flies_there(app: Flown) -> None:
    app.search.ask("name=3-4")
    app.go(0.5)
    assert [hit.label for hit in app.search.hits] == ["3-4 (22 m high)"]
    pose = app.search.hits[0].pose(app.ground.below)
    app.do.fly_to(pose)
    assert app.go(3.0) > 10
    assert app.navigator.pose == pose
    app.search.ask("nonsense=1")
    assert "no object has a field" in app.search.message


def test_the_threshold_may_change_on_the_way(app: Flown) -> None:
    app.put(over_city(2e5))
    fine = len(app.session.pager.draw_list().terrain)
    app.do.set_threshold(32.0)
    app.settle()
    assert len(app.session.pager.draw_list().terrain) < fine
    app.do.set_threshold(FINE.threshold_px)
    app.settle()
    assert len(app.session.pager.draw_list().terrain) == fine


def test_a_reset_driver_ends_in_one_line(
    app: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(type(app.window), "is_lost", lambda _: True)
        with pytest.raises(InputError, match="driver was reset"):
            app.go(5.0)


def test_a_film_that_fails_says_why_in_one_line(app: Flown) -> None:
    broken = app.state.out / "broken.json"
    broken.write_text("{}")
    app.filming.start(app, broken)
    end = time.monotonic() + 60
    while app.filming.on:
        assert time.monotonic() < end
        app.go(STEP_S, *app.window.take_events(0.1))
    assert "broken.json" in app.state.message


def test_plus_and_minus_zoom_to_the_middle(app: Flown) -> None:
    before = app.navigator.pose
    app.key("equal")
    app.go(1.0)
    assert app.navigator.pose.height_m < 0.85 * before.height_m
    app.key("minus")
    app.go(1.0)
    assert app.navigator.pose.height_m == pytest.approx(before.height_m, rel=0.01)
    assert app.navigator.pose.lon_rad == pytest.approx(before.lon_rad, abs=1e-6)


def test_escape_ends_what_is_on_top_and_only_then_the_window(app: Flown) -> None:
    app.key("v")
    app.go(1.0)
    app.key("v")
    app.key("v")
    app.do.replay_last()
    app.state.picked = {"kind": "ground"}
    app.do.measure(on=True)
    app.search.ask("45, 10")
    app.state.help_visible = True
    on = [
        lambda: app.state.help_visible,
        lambda: app.search.hits,
        lambda: app.state.measuring,
        lambda: app.state.picked,
        lambda: app.replayer.on,
        lambda: app.recorder.on,
    ]
    for number in range(len(on)):
        assert all(is_on() for is_on in on[number:]), number
        app.key("escape")
        assert not on[number](), number
        assert not app.state.closing
    assert "saved" in app.state.message
    app.key("escape")
    assert app.state.closing


def test_a_message_lives_from_when_it_is_seen(app: Flown) -> None:
    app.say("done")
    app.t_s += 60.0  # so long took what was done
    app.go(MESSAGE_S - 1.0)
    assert app.state.message == "done"
    app.go(1.5)
    assert not app.state.message


def test_loading_is_said_until_all_is_there(app: Flown) -> None:
    assert not app.loading
    app.navigator.pose = over_city(60.0, -0.4)
    app.go()
    assert app.loading
    app.settle()
    assert not app.loading
    assert app.session.pager.settled


def test_a_building_that_was_found_is_marked_on_arrival(app: Flown) -> None:
    app.search.ask("name=3-4")
    app.go(0.5)
    hit = app.search.best
    assert hit is not None
    app.do.go_to(hit)
    assert app.state.picked is not None
    assert app.state.picked["object"]["attributes"]["name"] == "3-4"
    app.go(4.0)
    app.settle()
    app.go(2.0)
    assert app.state.overlay.picked is not None
    assert app.drawn is not None
    row, ordinal = app.state.overlay.picked
    app.do.unpick()
    assert app.state.overlay.picked is None
    ids = app.session.renderer.read_ids()
    shown = -1 - ids[ids < 0]
    rows = app.drawn.objects[shown // 65536]
    assert ((rows == row) & (shown % 65536 == ordinal)).any()


def test_a_recording_is_saved_when_the_window_closes(
    app: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(app.window), "hide", lambda _: None)
    app.key("v")
    app.go(1.0)
    (line,) = app.close()
    assert str(app.replayer.last) in line
    assert app.replayer.last is not None
    assert read_path(app.replayer.last).duration_s == pytest.approx(1.0, abs=0.2)


def test_where_nothing_can_be_saved_no_window_opens(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--out"):
        make_folder(tmp_path / "no" / "where")
    make_folder(tmp_path / "new")
    assert (tmp_path / "new").is_dir()


@pytest.mark.parametrize("key", ["q", "escape"])
def test_q_and_escape_close(app: Flown, key: str) -> None:
    app.key(key)
    assert app.state.closing


@pytest.mark.slow
def test_the_command_opens_a_window_and_q_ends_it_with_0(
    hill_store: Path, screen: Screen, tmp_path: Path
) -> None:
    store = shutil.copy(hill_store, tmp_path / "w.geopage")
    words = [sys.executable, "-m", "geopage", "view", str(store), "--size", "321x234"]
    with subprocess.Popen(
        [*words, "--out", str(tmp_path)], stderr=subprocess.PIPE, text=True
    ) as process:
        number = screen.do("search", "--sync", "--onlyvisible", "--name", "geopage - w")
        screen.do("windowfocus", "--sync", number, "key", "q")
        assert process.stderr
        assert (process.wait(20), process.stderr.read()) == (0, "")


def test_without_the_panels_library_the_window_works(
    app: Flown, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "viewer.hud", None)
    assert hud_of(app.window) is None
    assert capsys.readouterr().err.count("\n") == 1
