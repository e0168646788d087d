# SPDX-License-Identifier: Apache-2.0
"""Films of camera paths: whole, and put together from what interruptions left."""

import json
import os
import subprocess
import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from numpy.typing import NDArray

from geopage.cli import main
from geopage.settings import MIB, PagerSettings
from tests.viewer.small_world import write_path
from tiles.errors import InputError
from viewer.complete import CompleteFrames
from viewer.film_path import FilmPlan, film_path
from viewer.session import Picture

pytestmark = pytest.mark.usefixtures("gl_context")
PICTURE = Picture((160, 96))
SETTINGS = PagerSettings(2.0, budget_bytes=128 * MIB)
FRAMES, STOP = 12, 5


@pytest.fixture(scope="module")
def store(hill_store: Path) -> Path:
    return hill_store


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> FilmPlan:
    folder = tmp_path_factory.mktemp("films")
    path = write_path(folder / "down.json", FRAMES / 10, (9000.0, 300.0))
    return FilmPlan(path, folder / "whole.mp4", 10.0)


@pytest.fixture(scope="module")
def whole(store: Path, plan: FilmPlan) -> NDArray[np.uint8]:
    report = film_path(store, SETTINGS, PICTURE, plan)
    assert (report["frames"], report["frames_from_before"]) == (FRAMES, 0)
    return pictures(plan.out)


def pictures(film: Path, size_px: tuple[int, int] = PICTURE.size_px) -> NDArray[np.uint8]:
    """Frames of a film, (n, h, w, 3)."""
    words = ["-v", "error", "-i", str(film), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), *words]
    data = subprocess.run(command, capture_output=True, check=True).stdout
    width, height = size_px
    return np.frombuffer(data, np.uint8).reshape(-1, height, width, 3)


def assert_same(film: NDArray[np.uint8], other: NDArray[np.uint8]) -> None:
    """Equal but for what the codec adds, frame by frame; neighbours differ by more."""
    assert film.shape == other.shape
    apart = np.abs(film.astype(int) - other).mean(axis=(1, 2, 3))
    steps = np.abs(np.diff(other.astype(int), axis=0)).mean(axis=(1, 2, 3))
    assert apart.max() < 3.0
    assert apart.max() < 0.5 * steps.min()


def test_a_film_that_ctrl_c_stopped_goes_on_to_the_same_film(
    store: Path, plan: FilmPlan, whole: NDArray[np.uint8], monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = FilmPlan(plan.path, plan.out.parent / "stopped.mp4", plan.hz)
    draw, drawn = CompleteFrames.draw, []

    def stop(self: CompleteFrames, *given: object) -> object:
        drawn.append(given)
        if len(drawn) == STOP + 1:
            raise KeyboardInterrupt
        return draw(self, *given)  # type: ignore[arg-type]

    with monkeypatch.context() as patched:
        patched.setattr(CompleteFrames, "draw", stop)
        with pytest.raises(KeyboardInterrupt):
            film_path(store, SETTINGS, PICTURE, mine)
    assert not mine.out.exists()
    report = film_path(store, SETTINGS, PICTURE, mine)
    assert report["frames_from_before"] == STOP
    assert_same(pictures(mine.out), whole)
    assert not mine.out.with_name("stopped.mp4.parts").exists()


def test_a_film_whose_process_was_killed_keeps_its_finished_parts(
    store: Path, plan: FilmPlan, whole: NDArray[np.uint8]
) -> None:
    out = plan.out.parent / "killed.mp4"
    code = f"""
import os
from pathlib import Path
from tests.viewer.test_film import PICTURE, SETTINGS, FilmPlan, film_path
from viewer.film_parts import Parts
add = Parts.add
def die(self, rgb):
    add(self, rgb)
    if self.count == {STOP}:
        self._part_s = 99.0  # what comes now is not finished
    if self.count == {STOP + 3}:
        os._exit(9)
Parts.add = die
film_path(Path({str(store)!r}), SETTINGS, PICTURE,
    FilmPlan(Path({str(plan.path)!r}), Path({str(out)!r}), {plan.hz}, part_s=0.0))
"""
    where = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run([sys.executable, "-c", code], env=where, check=False)
    assert done.returncode == 9
    report = film_path(store, SETTINGS, PICTURE, FilmPlan(plan.path, out, plan.hz))
    assert report["frames_from_before"] == STOP
    assert_same(pictures(out), whole)


def test_parts_of_another_film_are_not_used(store: Path, plan: FilmPlan) -> None:
    out = plan.out.parent / "other.mp4"
    film_path(store, SETTINGS, PICTURE, FilmPlan(plan.path, out, plan.hz))
    folder = out.with_name("other.mp4.parts")
    folder.mkdir()
    (folder / "0000000-4.mp4").write_bytes(out.read_bytes())
    begun = {"size": [160, 96], "threshold": 4.0}
    (folder / "film.json").write_text(json.dumps(begun))
    with pytest.raises(InputError, match="begun with another"):
        film_path(store, SETTINGS, PICTURE, FilmPlan(plan.path, out, plan.hz))
    assert (folder / "0000000-4.mp4").exists()


def test_the_film_shows_what_its_path_says(whole: NDArray[np.uint8]) -> None:
    # The city grows: ever more pixels differ from the ground at the picture's corner.
    ground = whole[:, :8, :8].reshape(len(whole), -1, 3).mean(axis=1)
    far = np.abs(whole - ground[:, None, None]).max(-1) > 24
    share = far.mean((1, 2))
    assert share[-1] > 3 * share[0] + 0.01


@pytest.mark.parametrize(
    ("out", "reason"),
    [("none/f.mp4", "No such file"), ("f.avi", "is no .mp4"), ("a.mp4", "is no .mp4")],
)
def test_what_can_not_be_written_is_said_before_anything_is_drawn(
    store: Path,
    plan: FilmPlan,
    capsys: pytest.CaptureFixture[str],
    out: str,
    reason: str,
) -> None:
    (plan.out.parent / "a.mp4").mkdir(exist_ok=True)
    words = ["film", str(store), str(plan.path), "-o", str(plan.out.parent / out)]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert reason in said
    assert said.count("\n") == 1


def test_the_command_says_what_it_made(
    store: Path, plan: FilmPlan, capsys: pytest.CaptureFixture[str]
) -> None:
    out = plan.out.parent / "said.mp4"
    words = ["film", str(store), str(plan.path), "-o", str(out), "--size", "64x48"]
    assert main([*words, "--fps", "5", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["frames"] == FRAMES // 2
    assert pictures(out, (64, 48)).shape == (FRAMES // 2, 48, 64, 3)
    assert main([*words, "--fps", "500"]) == 2


def test_without_ffmpeg_it_says_what_to_install(
    store: Path,
    plan: FilmPlan,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["film", str(store), str(plan.path), "-o", str(plan.out.parent / "no.mp4")]
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert main(words) == 2
    assert "pip install geopage[video]" in capsys.readouterr().err
    monkeypatch.undo()

    def fails() -> str:
        raise RuntimeError("No ffmpeg exe could be found.\nInstall it.")

    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", fails)
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "install ffmpeg" in said
    assert said.count("\n") == 1
