# SPDX-License-Identifier: Apache-2.0
"""`geopage accuracy` on a real store, small enough to be made here."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geopage.cli import guarded
from geopage.settings import PagerSettings
from tiles.errors import InputError
from tiles.store import Store
from tiles.surface import Surface
from tiles.writer import Writer
from viewer.accuracy import accuracy, summary
from viewer.cli import accuracy as command
from viewer.random_views import boxes_of, random_poses
from viewer.session import Picture
from viewer.tally import Tally

SIZE = Picture((96, 64))
NAMES = {"p50", "p95", "p99", "max", "share_within_threshold", "share_limited_by_leaf"}


@pytest.fixture(scope="module")
def store(hill_store: Path) -> Path:
    return hill_store


@pytest.fixture(scope="module")
def found(store: Path) -> dict[str, Any]:
    return accuracy(store, PagerSettings(2.0), SIZE, 12, 5, store.parent / "out")


pytestmark = pytest.mark.usefixtures("gl_context")


def test_no_pixel_is_worse_than_the_threshold_or_the_leaf(found: dict[str, Any]) -> None:
    assert found["share_within_threshold"] == 1.0
    assert found["pixels_judged"] > 12 * 96 * 64 / 3
    assert found["share_not_judged"] == 0.0  # one source, and it is everywhere
    assert not found["faults"]


def test_the_figures_have_the_agreed_names(found: dict[str, Any]) -> None:
    assert found.keys() >= NAMES | {"pixels_judged", "share_not_judged", "worst_view"}
    free = found["where_no_leaf_limits"]
    assert 0 < free["p50"] <= free["max"] <= 2.0
    assert 0 <= found["p50"] <= found["p95"] <= found["p99"] <= found["max"]
    worst = found["worst_view"]
    assert worst["error_px"] <= worst["limit_px"]
    assert worst.keys() >= {"lat_deg", "lon_deg", "height_m", "heading_deg", "pitch_deg"}


def test_the_folder_holds_the_figures_and_a_line_a_view(
    store: Path, found: dict[str, Any]
) -> None:
    folder = store.parent / "out"
    assert json.loads((folder / "accuracy.json").read_text())["p95"] == found["p95"]
    with (folder / "views.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert sum(int(row["judged"]) for row in rows) == found["pixels_judged"]
    assert max(float(row["max"] or 0) for row in rows) == pytest.approx(found["max"])


def test_terrain_that_moved_after_the_ingest_is_found(store: Path, tmp_path: Path) -> None:
    moved = tmp_path / "moved.geopage"
    with Store(store) as source:
        source.connection.execute("VACUUM INTO ?", (str(moved),))
    writer = Writer(moved)
    ask = "SELECT details FROM source WHERE name='hills'"
    wrong = json.loads(writer.connection.execute(ask).fetchone()[0])
    wrong["transform"][2] += 90.0  # the posts are a quarter of the globe away
    writer.connection.execute(
        "UPDATE source SET details=? WHERE name='hills'", (json.dumps(wrong),)
    )
    writer.close()
    found = accuracy(moved, PagerSettings(2.0), SIZE, 6, 5)
    assert found["share_within_threshold"] < 0.9


def test_a_damaged_copy_of_a_source_is_refused_in_one_line(
    store: Path, tmp_path: Path
) -> None:
    damaged = tmp_path / "damaged.geopage"
    with Store(store) as source:
        source.connection.execute("VACUUM INTO ?", (str(damaged),))
    writer = Writer(damaged)
    writer.connection.execute("UPDATE raster_block SET body=x'00' WHERE row=0 AND col=1")
    writer.close()
    with pytest.raises(InputError, match="its copy is damaged") as raised:
        accuracy(damaged, PagerSettings(2.0), SIZE, 1, 1)
    assert "\n" not in str(raised.value)


def test_the_same_seed_gives_the_same_poses_of_every_kind(store: Path) -> None:
    with Store(store) as opened:
        surface = Surface(opened)
        boxes = boxes_of(opened.sources("terrain"))
        poses = random_poses(surface, boxes, 300, 3)
        assert poses == random_poses(surface, boxes, 300, 3)
        assert poses != random_poses(surface, boxes, 300, 4)
        ground = surface.heights(*np.array([(p.lon_rad, p.lat_rad) for p in poses]).T)[0]
    above = np.array([pose.height_m for pose in poses]) - ground
    assert 10 <= above.min() < 30
    assert 5e6 < above.max() <= 1e7
    assert 0.4 < (above < 1e4).mean() < 0.6  # log-uniform: half below 10 km
    pitch = np.degrees([pose.pitch_rad for pose in poses])
    assert 0.1 < (pitch == -90).mean() < 0.2
    assert (pitch > 0).any()
    assert pitch.max() < 20
    lat = np.array([pose.lat_rad for pose in poses])
    assert abs((np.abs(lat) < np.radians(30)).mean() - 0.5) < 0.1  # by area


def test_places_are_in_the_sources_boxes() -> None:
    box = [170.0, -80.0, 190.0, -70.0]
    wide = {"wraps": True, "bounds_deg": [-180, -90, 180, 90]}
    small = {"wraps": False, "bounds_deg": box}
    assert boxes_of([small]) == [tuple(box)]
    assert len(boxes_of([wide, small])) == 3


def test_a_tally_of_nothing_has_no_figures() -> None:
    nothing = Tally(2.0).figures() | {"views": 0}
    assert NAMES.isdisjoint(nothing)
    assert "no pixel" in summary(nothing)


def test_the_command_says_it_in_words_and_in_json(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(store), "--views", "3", "--threshold", "4", "--size", "64x48"]
    assert guarded(command, words) == 0
    said = capsys.readouterr()
    assert "p95" in said.out
    assert "--look" in said.out
    assert not said.err
    assert guarded(command, [*words, "--seed", "9", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["threshold_px"] == 4.0
    assert report["seed"] == 9


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--views", "0"], "expected a whole number above 0"),
        (["--views", "2.5"], "expected a whole number above 0"),
        (["--seed", "-1"], "--seed is below 0"),
        (["--threshold", "0"], "expected a number above 0"),
    ],
)
def test_bad_words_are_refused_in_one_line(
    words: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert guarded(command, ["x.geopage", *words]) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1


def test_a_folder_that_cannot_be_made_is_refused(store: Path) -> None:
    with pytest.raises(InputError, match="name a folder"):
        accuracy(store, PagerSettings(4.0), Picture((32, 32)), 1, 1, store / "inside")
