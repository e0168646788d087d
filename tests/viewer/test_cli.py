# SPDX-License-Identifier: Apache-2.0
"""The drawing commands as a user types them."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from geopage.cli import main
from tests.viewer.small_world import LAT_DEG, LON_DEG, write_path
from tiles.geodesy import to_geodetic

pytestmark = pytest.mark.usefixtures("gl_context")
SIZE = ("--size", "96x64")


@pytest.fixture(scope="module")
def store(hill_store: Path) -> Path:
    return hill_store


def test_render_writes_a_picture_and_the_drawn_points(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, points = tmp_path / "p.png", tmp_path / "p.npy"
    at = f"{LAT_DEG},{LON_DEG},20000"
    words = ["render", str(store), "--at", at, "--look", "0,-90", *SIZE, "-o", str(out)]
    assert main([*words, "--positions", str(points), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["terrain_tiles"] > 0
    with Image.open(out) as picture:
        assert picture.size == (96, 64)
    drawn = np.load(points)
    assert drawn.shape == (64, 96, 3)
    assert drawn.dtype == np.float64
    height = to_geodetic(drawn.reshape(-1, 3))[2]
    assert (np.abs(height) < 2000).all()


def test_render_to_a_southern_place_takes_negative_numbers(
    store: Path, tmp_path: Path
) -> None:
    out = tmp_path / "south.png"
    words = ["render", str(store), "--at", "-33.9,18.4,1000", *SIZE, "-o", str(out)]
    assert main(words) == 0
    assert out.stat().st_size > 500


def test_fly_and_chart(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_path(tmp_path / "down.json", 10.0, (1e7, 1e5))
    runs = []
    for threshold in ("1", "4"):
        out = tmp_path / threshold
        words = ["fly", str(store), str(path), "--settled", "--poses", "3", *SIZE]
        assert main([*words, "--threshold", threshold, "--out", str(out), "--json"]) == 0
        settings = json.loads(capsys.readouterr().out)["settings"]
        assert settings["threshold_px"] == float(threshold)
        runs.append(str(out))
    assert main(["chart", *runs, "-o", str(tmp_path / "chart.svg")]) == 0
    text = (tmp_path / "chart.svg").read_text()
    assert "Speed against accuracy" in text


def test_doctor_names_the_driver(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["gl_renderer"]
    assert set(found["fast_paths"].values()) <= {True, False}


def bad_path(tmp_path: Path, **changes: object) -> str:
    path = write_path(tmp_path / "bad.json", 2.0, (100.0, 50.0))
    whole = json.loads(path.read_text())
    whole["keyframes"][1].update(changes)
    for key in [key for key, value in changes.items() if value is None]:
        del whole["keyframes"][1][key]
    path.write_text(json.dumps(whole))
    return str(path)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--fade", "-1"], "-1"),
        (["--fade", "60"], "60"),
        (["--fade", "soon"], "soon"),
        (["--detail", "colour"], "colour"),
    ],
)
def test_how_detail_changes_is_checked(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fly", "a.geopage", "b.json", "--out", "c", *words]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert said in err


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"t_s": None}, "t_s"), ({"t_s": 0.0}, "not after"), ({"lat_deg": 91.0}, "lat_deg")],
)
def test_a_bad_camera_path_is_one_line_and_exit_2(
    store: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, object],
    said: str,
) -> None:
    out = tmp_path / "out"
    words = ["fly", str(store), bad_path(tmp_path, **changes), "--out", str(out)]
    assert main(words) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "bad.json" in err
    assert said in err
    assert not out.exists()


@pytest.mark.parametrize(
    "words",
    [
        ["render", "none.geopage", "--at", "0,0,10", "-o", "x.png"],
        ["fly", "none.geopage", "none.json", "--out", "x"],
        ["chart", "nowhere", "-o", "x.svg"],
    ],
)
def test_what_is_not_there_is_named_in_one_line(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "none." in err or "nowhere" in err


def test_a_picture_in_a_missing_folder_is_one_line(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "no" / "p.png"
    assert main(["render", str(store), "--at", "0,0,1e6", *SIZE, "-o", str(out)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
