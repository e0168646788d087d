# SPDX-License-Identifier: Apache-2.0
"""What is loaded when something starts: what takes time waits until it is needed."""

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = {"numpy", "numba", "moderngl", "pyproj", "rasterio", "shapely", "matplotlib", "PIL"}
ELSEWHERE = {"rasterio", "pyogrio", "shapely", "trimesh", "matplotlib", "imageio_ffmpeg"}
"""What reading sources, charts and films need, and drawing does not."""


def loaded(code: str, *words: str) -> set[str]:
    """Top-level modules in a fresh process after some code."""
    ends = f"{code}\nimport sys; print(*{{name.split('.')[0] for name in sys.modules}})"
    command = [sys.executable, "-c", ends, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("code", ["import geopage", "import geopage.cli"])
def test_importing_loads_nothing_heavy(code: str) -> None:
    assert not loaded(code) & HEAVY


def test_a_command_that_draws_loads_nothing_of_ingest_or_charts(
    hill_store: Path, tmp_path: Path
) -> None:
    code = "import sys; from geopage.cli import main; assert main(sys.argv[1:]) == 0"
    picture = tmp_path / "earth.png"
    words = ["render", str(hill_store), "--at", "10,20,1e7", "--look", "0,-90"]
    there = loaded(code, *words, "--size", "64x48", "-o", str(picture))
    assert picture.exists()
    assert {"numba", "moderngl"} <= there
    assert not there & ELSEWHERE
    assert "pyproj" not in there


def test_a_session_loads_no_pictures_or_charts() -> None:
    there = loaded("import viewer.session")
    assert not there & (ELSEWHERE | {"PIL", "pyproj", "imgui_bundle", "glfw"})
