# SPDX-License-Identifier: Apache-2.0
"""A real window on a virtual screen, with a real mouse and real keys."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from geopage.cli import main
from tests.viewer.screen import Screen
from tiles.errors import InputError
from viewer.events import (
    Event,
    Focus,
    Key,
    MouseButton,
    MouseMove,
    Refresh,
    Text,
    Wheel,
)
from viewer.gl import CallTable, Gl
from viewer.window import Window
from viewer.window_context import address_of

SIZE = 400, 300


@pytest.fixture
def window(screen: Screen) -> Iterator[Window]:
    assert screen.display
    with Window("test", SIZE) as made:
        wait_for(made, lambda event: isinstance(event, Focus))
        yield made


def wait_for(window: Window, wanted: Callable[[Event], bool]) -> list[Event]:
    """Return all events up to the first wanted one."""
    seen: list[Event] = []
    end = time.monotonic() + 20
    while not any(map(wanted, seen)):
        assert time.monotonic() < end, seen
        seen += window.take_events(0.5)
    return seen


def is_released(event: Event, button: str) -> bool:
    return isinstance(event, MouseButton) and event.button == button and not event.down


def test_a_window_has_the_size_that_was_asked_for_and_a_context(window: Window) -> None:
    assert window.size_px == SIZE
    assert window.gl.context.version_code >= 430
    assert not window.is_lost()
    window.gl.check("opening a window")


def test_the_mouse_is_heard_in_pixels(window: Window, screen: Screen) -> None:
    screen.do("mousemove", "50", "60", "mousedown", "1", "mousemove", "80", "90")
    screen.do("mouseup", "1", "mousedown", "3", "mouseup", "3")
    seen = wait_for(window, lambda e: is_released(e, "right"))
    presses = [e for e in seen if isinstance(e, MouseButton)]
    assert [(e.button, e.down) for e in presses] == [
        ("left", True), ("left", False), ("right", True), ("right", False),
    ]  # fmt: skip
    assert MouseMove(80.5, 90.5) in seen
    assert presses[0].t_s <= presses[1].t_s


def test_control_and_left_is_right(window: Window, screen: Screen) -> None:
    screen.do("mousemove", "50", "60", "keydown", "ctrl", "click", "1", "keyup", "ctrl")
    seen = wait_for(window, lambda e: is_released(e, "right"))
    presses = [e for e in seen if isinstance(e, MouseButton)]
    assert [e.button for e in presses] == ["right", "right"]


def test_the_wheel_and_keys_are_heard(window: Window, screen: Screen) -> None:
    screen.do("mousemove", "50", "60", "click", "4", "click", "5")
    screen.do("key", "shift+w", "Escape", "F11", "question")
    seen = wait_for(window, lambda e: isinstance(e, Text) and e.text == "?")
    assert [e.notches for e in seen if isinstance(e, Wheel)] == [1.0, -1.0]
    down = [(e.name, e.shift) for e in seen if isinstance(e, Key) and e.down]
    for one in (("w", True), ("escape", False), ("f11", False)):
        assert one in down


def test_a_window_of_another_size_says_so(window: Window, screen: Screen) -> None:
    number = screen.do("search", "--name", "^test$")
    for size in ((1, 1), (320, 200)):
        screen.do("windowsize", number, *map(str, size))
        wait_for(window, lambda e: isinstance(e, Refresh))
        end = time.monotonic() + 20
        while window.size_px != size:
            assert time.monotonic() < end
            window.take_events(0.1)


def test_full_screen_fills_the_screen_and_goes_back(window: Window) -> None:
    window.toggle_fullscreen()
    assert window.is_fullscreen
    assert window.size_px == (1024, 640)
    window.toggle_fullscreen()
    assert not window.is_fullscreen
    end = time.monotonic() + 20
    while window.size_px != SIZE:
        assert time.monotonic() < end
        window.take_events(0.1)


def test_a_hidden_window_gives_a_context_where_there_is_no_egl(screen: Screen) -> None:
    assert screen.display
    with Window("hidden", (64, 64), visible=False) as window:
        table = CallTable(Gl(window.gl.context, address_of))
        table.stamp()
        table.add("glFinish")
        table.stamp()
        assert table.run() >= 0
        first, last = table.stamps_ns.tolist()
    assert first <= last <= time.perf_counter_ns()


def test_without_a_display_one_line_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match=r"no display.*geopage render") as found:
        Window("test", SIZE)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("content", [None, b"", b"no store at all, but some text" * 99])
def test_what_is_no_store_is_refused_in_one_line(
    screen: Screen,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    content: bytes | None,
) -> None:
    assert screen.display
    store = tmp_path / "w.geopage"
    if content is not None:
        store.write_bytes(content)
    assert main(["view", str(store)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "w.geopage" in said


def test_an_old_driver_is_refused_in_one_line(screen: Screen) -> None:
    old = {**os.environ, "MESA_GL_VERSION_OVERRIDE": "4.1", "DISPLAY": screen.display}
    code = "from viewer.window import Window; from geopage.cli import guarded\n"
    code += "raise SystemExit(guarded(lambda words: Window('x', (64, 64)), []))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=old,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "OpenGL 4.5" in done.stderr
