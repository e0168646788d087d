# SPDX-License-Identifier: Apache-2.0
"""The panels: what is typed and clicked there, and what they say."""

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from tests.viewer.flown import STEP_S, Flown, open_app, over_city
from tests.viewer.screen import Screen
from tiles.geodesy import to_ecef
from viewer.app_commands import BY_KEY, COMMANDS, HELD
from viewer.camera import Pose
from viewer.events import Key, MouseMove, Text
from viewer.hud_text import length_text, measured, measured_lines, place_text, way_text
from viewer.sun import sun_direction

SIZE = 640, 480
FIND = 100.0, 36.0
WORLD = 500.0, 300.0


@pytest.fixture(scope="module")
def opened(
    hill_store: Path, screen: Screen, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Flown]:
    pytest.importorskip("imgui_bundle", reason="the gui extra is not installed")
    assert screen.display
    with open_app(hill_store, tmp_path_factory.mktemp("hud"), SIZE, panels=True) as app:
        yield app


@pytest.fixture
def app(opened: Flown) -> Flown:
    opened.state.picked, opened.state.help_visible = None, False
    opened.state.hud_visible = True
    opened.put(over_city(300.0))
    return opened


def visit(app: Flown, x: float, y: float) -> None:
    """Bring the mouse somewhere, as panels notice only a frame later."""
    app.go(STEP_S, MouseMove(x, y))
    app.go()


def shown(screen: Screen) -> np.ndarray:
    return screen.picture()[: SIZE[1], : SIZE[0]].astype(int)


def test_panels_cover_the_picture_and_tab_takes_them_away(
    app: Flown, screen: Screen
) -> None:
    app.go()
    with_panels = shown(screen)
    app.key("tab")
    app.state.message = ""
    app.go(0.2)
    without = shown(screen)
    drawn = app.session.renderer.read_rgb()
    assert np.abs(without - drawn).max() <= 1
    apart = (np.abs(with_panels - without).max(axis=2) > 8).mean()
    assert 0.3 < apart < 0.7


def test_a_click_on_a_panel_is_none_on_the_world(app: Flown) -> None:
    before = app.navigator.pose
    visit(app, 30, 300)
    app.press(30, 300, down=True)
    app.go(STEP_S, MouseMove(200, 300))
    app.press(200, 300, down=False)
    app.go(0.5)
    assert app.navigator.pose == before
    assert app.state.picked is None


def test_a_click_beside_the_panels_is_one_on_the_world(app: Flown) -> None:
    visit(app, *WORLD)
    app.click(*WORLD)
    assert app.state.picked is not None


def test_a_place_is_typed_and_flown_to(app: Flown) -> None:
    visit(app, *FIND)
    app.click(*FIND)
    for letter in "45.02, 10.01":
        app.go(STEP_S, Text(letter))
    app.go(0.1)
    app.key("enter")
    app.go(4.0)
    pose = app.navigator.pose
    place = math.degrees(pose.lat_rad), math.degrees(pose.lon_rad)
    assert place == pytest.approx((45.02, 10.01))
    assert not app.state.closing


def test_the_only_building_of_a_name_is_flown_to(app: Flown) -> None:
    visit(app, *FIND)
    app.click(*FIND)
    app.go(STEP_S, Key("a", down=True, control=True), Key("a", down=False, control=True))
    for letter in "name=3-4":
        app.go(STEP_S, Text(letter))
    app.go(0.1)
    app.key("enter")
    app.go(4.0)
    (hit,) = app.search.hits
    assert app.navigator.pose == hit.pose(app.ground.below)


def test_the_box_keeps_the_keyboard_until_something_is_found(app: Flown) -> None:
    visit(app, *FIND)
    app.click(*FIND)
    marks = len(app.state.bookmarks)

    def ask(words: str) -> None:
        for letter in words:  # as real keys: some of these are commands
            key = Key(letter, down=True), Text(letter), Key(letter, down=False)
            app.go(STEP_S, *key)
        app.go(0.1)
        app.key("enter")
        app.go(0.3)
        while app.search.on:
            app.go()

    app.go(0.2)
    app.go(STEP_S, Key("a", down=True, control=True), Key("a", down=False))
    app.go(0.2)
    ask("qbh")
    assert "nothing found" in app.search.message
    ask("bvqc")
    assert "nothing found" in app.search.message
    assert not any((app.state.closing, app.state.help_visible, app.recorder.on))
    assert len(app.state.bookmarks) == marks
    ask("city")  # instead of what stood there
    assert app.search.best
    assert app.navigator.destination
    app.go(0.2)
    app.go(STEP_S, Key("w", down=True))
    assert app.navigator.held == {"forward"}
    app.go(STEP_S, Key("w", down=False))


def test_escape_leaves_the_box_and_no_more(app: Flown) -> None:
    app.search.ask("45, 10")
    visit(app, *FIND)
    app.click(*FIND)
    app.go(0.2)
    app.key("escape")
    app.go(0.2)
    assert app.search.hits
    app.key("escape")
    assert not app.search.hits
    assert not app.state.closing


def test_letters_typed_into_a_field_are_no_commands(app: Flown) -> None:
    visit(app, *FIND)
    app.click(*FIND)
    app.go(0.1)
    for letter in ("q", "w", "tab"):
        app.go(STEP_S, Key(letter, down=True), Text(letter[0]), Key(letter, down=False))
    assert not app.state.closing
    assert not app.navigator.held
    assert app.state.hud_visible
    app.click(*WORLD)
    app.go(0.1)
    app.go(STEP_S, Key("w", down=True))
    assert app.navigator.held == {"forward"}
    app.go(STEP_S, Key("w", down=False))


def test_the_help_shows_every_command(app: Flown, screen: Screen) -> None:
    app.go()
    before = shown(screen)
    app.key("f1")
    app.go(0.2)
    assert (np.abs(shown(screen) - before).max(axis=2) > 8).mean() > 0.1
    app.key("escape")
    assert not app.state.help_visible
    assert not app.state.closing
    assert not BY_KEY.keys() & HELD.keys()
    keys = [key for command in COMMANDS for key in command.keys]
    assert len(keys) == len(set(keys))
    assert all(command.help or command.keys == ("escape",) for command in COMMANDS)


def test_at_rest_the_panels_cost_nothing(app: Flown) -> None:
    app.settle()
    assert app.go(1.0) == 0
    assert app.wait_s() >= 1.0


def test_the_sun_moves_with_the_time(app: Flown) -> None:
    app.go()
    before = app.session.renderer.read_rgb().astype(int)
    app.state.utc = datetime(2026, 6, 21, 22, tzinfo=UTC)
    app.go(0.1)
    night = app.session.renderer.read_rgb().astype(int)
    assert night.mean() < before.mean() - 10
    look = app.session.renderer.look
    assert look.sun is not None
    np.testing.assert_array_equal(look.sun, sun_direction(app.state.utc))
    app.state.utc = None
    app.go(0.1)
    assert np.abs(app.session.renderer.read_rgb() - before).mean() < 1


def test_numbers_read_well() -> None:
    assert place_text(math.radians(-122.4), math.radians(37.8)) == (
        "37.80000° N   122.40000° W"
    )
    texts = [length_text(one) for one in (1.234, 99.96, 1234.0, 12_345_678.0, -3.0)]
    assert texts == ["1.23 m", "100.0 m", "1.23 km", "12,346 km", "-3.00 m"]
    assert way_text(Pose(0, 0, 0, math.radians(359.7), -1.571)) == "0° N, straight down"
    assert way_text(Pose(0, 0, 0, math.radians(200), 0.0)) == "200° S, level"
    assert way_text(Pose(0, 0, 0, math.radians(91), 0.2)) == "91° E, 11° up"


def test_a_measurement_is_the_geodesic_and_the_height_difference() -> None:
    a, b = (
        to_ecef(*np.radians((8.0, lat)), h) for lat, h in ((47.0, 400.0), (48.0, 900.0))
    )
    found = measured(a, b)
    assert found["ground_m"] == pytest.approx(111_180.6, abs=0.5)  # a degree of latitude
    assert found["rise_m"] == pytest.approx(500.0, abs=1e-6)
    assert found["distance_m"] == pytest.approx(float(np.linalg.norm(a - b)))
    assert measured_lines([a, b])[2] == "height difference  500.0 m"
    assert measured_lines([a]) == ["click the second point"]
