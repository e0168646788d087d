# SPDX-License-Identifier: Apache-2.0
"""What `geopage doctor` says with everything there, and with something missing."""

import json
import subprocess
import sys

import moderngl
import pytest

from geopage.cli import main
from tests.viewer.screen import Screen
from tiles.errors import InputError
from viewer import doctor, gl


def told(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    """What the command printed as JSON."""
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def test_it_names_the_driver_that_draws(
    gl_context: moderngl.Context, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor", "--json"]) == 0
    found = told(capsys)
    assert found["can_draw"] is True
    assert found["gl_renderer"] == gl_context.info["GL_RENDERER"]
    assert found["gl_vendor"] == gl_context.info["GL_VENDOR"]
    paths = found["fast_paths"]
    assert isinstance(paths, dict)
    for what, name in doctor.FAST_PATHS.items():
        assert paths[what] is (name in gl_context.extensions)
    assert set(gl.NEEDED) <= set(doctor.FAST_PATHS.values())


def test_a_window_opens_where_there_is_a_screen(screen: Screen) -> None:
    command = [sys.executable, "-m", "geopage", "doctor"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert screen.display
    assert "\nwindow: yes\n" in done.stdout
    assert done.stderr == ""


def test_where_nothing_draws_it_says_what_to_install_and_exits_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails() -> None:
        raise InputError("OpenGL", "no context", "install libegl1")

    monkeypatch.setattr(doctor.gl, "open_headless", fails)
    monkeypatch.setattr(doctor, "_window", fails)
    assert main(["doctor"]) == 1
    said = capsys.readouterr().out
    assert "can draw: no\n" in said
    assert "advice: without a window: install libegl1\n" in said
    assert "fast paths" not in said


def test_a_driver_too_old_can_not_draw(
    gl_context: moderngl.Context,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert gl_context.version_code >= 430
    monkeypatch.setattr(gl, "NEEDED", (*gl.NEEDED, "GL_none_such"))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert main(["doctor", "--json"]) == 1
    assert "lacks GL_none_such" in str(told(capsys)["without_a_window"])


def test_a_missing_extra_comes_with_its_command(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    gl_context: moderngl.Context,
) -> None:
    assert gl_context
    without = {"report": ("PIL", "no_such_module")}
    extras = {
        name: (what, without.get(name, modules))
        for name, (what, modules) in doctor.EXTRAS.items()
    }
    monkeypatch.setattr(doctor, "EXTRAS", extras)
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert "  report: no\n" in said
    assert "advice: for pictures, charts: pip install geopage[report]\n" in said
