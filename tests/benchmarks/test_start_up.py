# SPDX-License-Identifier: Apache-2.0
"""How long a start takes: importing, and a first picture of the whole earth.

Run `pytest tests/benchmarks/test_start_up.py --benchmark-enable -s`, with
`GEOPAGE_STORE=FILE.geopage` for a store of your own; otherwise each runs once, as a test.
Each start is a fresh process; the first one compiles, the others load what is compiled.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.viewer.small_world import make_store

STARTS = 5
FIRST_PICTURE = """
import sys
from pathlib import Path
from geopage.settings import PagerSettings
from viewer.camera import Pose, view_state
from viewer.session import Picture, Session
with Session(Path(sys.argv[1]), PagerSettings(), Picture((1280, 720))) as session:
    session.settle(view_state(Pose(0.2, 0.8, 1e7, 0.0, -1.57), (1280, 720)))
    assert session.renderer.read_rgb().any()
"""
COMMAND = "import sys; from geopage.cli import main; sys.exit(main(sys.argv[1:]))"
VIEW = "--at", "45,12,1e7", "--look", "0,-90"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    given = os.environ.get("GEOPAGE_STORE")
    return Path(given) if given else make_store(tmp_path_factory.mktemp("start"))


def start(code: str, *words: str) -> tuple[float, float]:
    """Wall and processor seconds of a fresh process."""
    begun_s, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, "-c", code, *words], check=True)
    after = os.times()
    busy_s = after.children_user + after.children_system
    busy_s -= before.children_user + before.children_system
    return time.perf_counter() - begun_s, busy_s


def show(what: str, code: str, *words: str, starts: int) -> None:
    """Print the median start, after one that warms up."""
    start(code, *words)
    took = sorted(start(code, *words) for _ in range(starts))
    wall_s, busy_s = took[len(took) // 2]
    sys.stdout.write(f"\n{what}: {wall_s:.2f} s, {busy_s:.2f} s of processor time\n")
    assert wall_s > 0


@pytest.mark.parametrize(
    ("what", "code"),
    [("import geopage", "import geopage"), ("first picture", FIRST_PICTURE)],
)
def test_start(what: str, code: str, store: Path, request: pytest.FixtureRequest) -> None:
    timed = request.config.getoption("benchmark_enable")
    show(what, code, str(store), starts=STARTS if timed else 1)


def test_start_of_render(
    store: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    timed = request.config.getoption("benchmark_enable")
    words = ["render", str(store), *VIEW, "-o", str(tmp_path / "earth.png")]
    show("geopage render", COMMAND, *words, starts=STARTS if timed else 1)
    assert (tmp_path / "earth.png").exists()
