# SPDX-License-Identifier: Apache-2.0
"""`geopage accuracy` on a real store, small enough to be made here."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geopage.cli import guarded
from tiles.errors import InputError
from tiles.store import Store
from tiles.surface import Surface
from tiles.writer import Writer
from viewer.accuracy import Asked, accuracy
from viewer.accuracy_table import percent
from viewer.accuracy_words import summary
from viewer.cli_accuracy import accuracy as command
from viewer.random_views import boxes_of, random_poses
from viewer.tally import Tally

SIZE_PX = (96, 64)
NAMES = {"p50", "p95", "p99", "max", "share_within_threshold", "share_limited_by_leaf"}


@pytest.fixture(scope="module")
def store(hill_store: Path) -> Path:
    return hill_store


@pytest.fixture(scope="module")
def found(store: Path) -> dict[str, Any]:
    return accuracy(store, Asked((2.0,), 12, 5, SIZE_PX), store.parent / "out")


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


def test_several_thresholds_are_measured_on_the_same_views(
    store: Path, found: dict[str, Any]
) -> None:
    report = accuracy(store, Asked((2.0, 64.0), 12, 5, SIZE_PX))
    fine, coarse = report["thresholds"]
    assert [one["threshold_px"] for one in report["thresholds"]] == [2.0, 64.0]
    assert all(one["share_within_threshold"] == 1.0 for one in report["thresholds"])
    assert fine["triangles_mean"] > coarse["triangles_mean"]
    assert fine["where_no_leaf_limits"]["p95"] < coarse["where_no_leaf_limits"]["p95"]
    assert fine["p95"] == pytest.approx(found["p95"], rel=0.1)  # as when measured alone


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
    found = accuracy(moved, Asked((2.0,), 6, 5, SIZE_PX))
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
        accuracy(damaged, Asked((2.0,), 1, 1, SIZE_PX))
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


def test_all_that_is_measured_is_in_the_document(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(store), "--views", "2", "--threshold", "8,2", "--size", "64x48", "--all"]
    assert guarded(command, [*words, "--out", str(tmp_path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    text = (tmp_path / "ACCURACY.md").read_text()
    assert "| 2 | " in text
    assert "| 8 | " in text
    assert report["heights"][0]["places"] == 10_000
    assert "| hills | " in text
    assert len(report["flights"]) == 8
    assert "| north pole | 2 | " in text
    assert report["selection"][0]["cells"] < 10_000 < report["selection"][1]["cells"]
    assert (tmp_path / "pictures" / "accuracy.svg").read_text().count("threshold") >= 2
    with (tmp_path / "views.csv").open() as file:
        assert [row["threshold_px"] for row in csv.DictReader(file)] == ["2.0"] * 2 + [
            "8.0"
        ] * 2


def test_only_all_is_100_percent_and_only_nothing_is_0() -> None:
    assert percent(1.0) == "100 %"
    assert percent(1 - 1e-7) == "99.99999 %"
    assert percent(0.12345) == "12.35 %"
    assert percent(2e-7) == "0.00002 %"
    assert percent(0.0) == "0.00 %"


def test_the_command_says_it_in_words_and_in_json(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(store), "--views", "3", "--threshold", "4", "--size", "64x48"]
    assert guarded(command, words) == 0
    said = capsys.readouterr()
    assert "p95" in said.out
    assert "--look" in said.out
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
        (["--threshold", "0"], "expected numbers above 0"),
        (["--threshold", "2,-1"], "expected numbers above 0"),
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
        accuracy(store, Asked((4.0,), 1, 1, (32, 32)), store / "inside")
