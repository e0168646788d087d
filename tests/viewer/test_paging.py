# SPDX-License-Identifier: Apache-2.0
import csv
import json
from dataclasses import replace as with_these
from pathlib import Path

import numpy as np
import pytest

from geopage.screen_error import lens_of
from geopage.selection import Thresholds, select
from geopage.settings import MIB, REPLAYED, PagerSettings
from tests.geopage.worlds import SPOT, deep_globe, object_records, write_store
from tiles.errors import InputError
from tiles.lanes import Lane
from viewer.camera_path import read_path
from viewer.cli_replay import replay
from viewer.paging import Paging
from viewer.stability.site import Site

KEYS = [(0.0, 1e6), (1.0, 2e4), (2.0, 300.0)]


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A small store and a path down to its town."""
    folder = tmp_path_factory.mktemp("paging")
    write_store(folder / "w.geopage", deep_globe(), object_records())
    frames = [
        {
            "t_s": t_s,
            "lat_deg": 37.76,
            "lon_deg": -122.447,
            "height_m": height_m,
            "heading_deg": 0.0,
            "pitch_deg": -60.0,
        }
        for t_s, height_m in KEYS
    ]
    path = {"name": "down", "duration_s": 2.0, "height_reference": "ellipsoid"}
    path |= {"interpolation": "log_height", "keyframes": frames}
    (folder / "down.json").write_text(json.dumps(path))
    return [str(folder / "w.geopage"), str(folder / "down.json")]


def runs(words: list[str], capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    assert replay([*words, "--json"]) == 0
    found: list[dict[str, object]] = json.loads(capsys.readouterr().out)["runs"]
    return found


@pytest.mark.parametrize("policy", REPLAYED)
def test_two_replays_give_the_same_figures(
    flight: list[str], policy: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*flight, "--policy", policy, "--throttle", "0.005,10"]
    first, again = runs(words, capsys), runs(words, capsys)
    assert first == again
    assert first[0]["frames"] == 120
    assert first[0]["tiles_loaded"]


def test_without_a_throttle_every_frame_but_the_first_few_is_good(
    flight: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (found,) = runs(flight, capsys)
    assert float(str(found["share_frames_within"])) > 0.95
    assert found["throttle"] is None


def test_a_slower_line_carries_less_and_shows_less(
    flight: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    found = runs([*flight, "--times", "0.1,0.4,3"], capsys)
    shares = [float(str(one["share_frames_within"])) for one in found]
    assert shares == sorted(shares)
    assert shares[0] < shares[-1]
    for one in found:
        rate = one["throttle"][0] * MIB  # type: ignore[index]
        assert one["bytes_read"] <= 2.0 * rate + 200  # type: ignore[operator]


def test_a_table_has_a_line_for_each_policy_and_throttle_and_then_the_leads(
    flight: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--policy", "benefit,demand,oracle", "--times", "0.3,2"]
    chart = tmp_path / "chart.svg"
    assert replay([*flight, *words, "--chart", str(chart)]) == 0
    lines = capsys.readouterr().out.splitlines()
    begin = [line.split()[0] for line in lines]
    assert begin == ["policy", *["benefit", "demand", "oracle"] * 2, "at", "at"]
    within = {line.split()[0]: float(line.split()[2].rstrip("%")) for line in lines[1:4]}
    lead = within["benefit"] - within["demand"]
    assert f"{lead:+.1f} points to demand" in lines[7]
    assert within["oracle"] - 3 <= within["benefit"] >= within["demand"]
    assert all(f"<!-- {name} -->" in chart.read_text() for name in within)


def test_a_trace_has_a_line_for_each_tile_that_was_loaded(
    flight: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*flight, "--throttle", "0.005,10", "--out", str(tmp_path)]
    (found,) = runs(words, capsys)
    with (tmp_path / "trace.csv").open(newline="") as file:
        tiles = list(csv.DictReader(file))
    there = [tile for tile in tiles if tile["uploaded_s"]]
    assert abs(len(there) - int(str(found["tiles_loaded"]))) <= 8
    for tile in there:
        times = [float(tile[name]) for name in ("asked_s", "taken_s", "decoded_s")]
        assert times == sorted(times)
        assert float(tile["decoded_s"]) <= float(tile["uploaded_s"])
    late = [tile for tile in there if float(tile["late_ms"]) > 1]
    assert len(late) == found["prediction"]["tiles_late"]  # type: ignore[index]
    page = (tmp_path / "index.html").read_text()
    assert "trace.svg" in page
    assert (tmp_path / "trace.svg").is_file()


def test_a_tile_is_missing_where_coarser_ones_are_drawn_but_not_where_finer_are(
    flight: list[str],
) -> None:
    paging, site = Paging(Path(flight[0]), PagerSettings(fade_s=0.0)), Site(*SPOT)
    with paging.pager:
        paging.settle(site.view(1e6))
        low = site.view(1e4)
        drawn, tree = paging.frame(low), paging.trees[Lane.OBJECTS]
        limits = Thresholds(2.0, 2.0)
        missing = select(paging.trees, lens_of(low), paging._there, limits)
        rows = missing.wants[Lane.OBJECTS].rows
        assert len(rows) > 1
        assert paging.objects_missing(drawn, low) == len(rows)
        coarser = with_these(drawn, objects=tree.parent[rows])
        assert paging.objects_missing(coarser, low) == len(rows)
        below = tree.children[rows[:1]]
        finer = with_these(drawn, objects=below[below >= 0])
        assert len(finer.objects)
        assert paging.objects_missing(finer, low) < len(rows)


def test_a_recorded_flight_is_paged_like_its_path(
    flight: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = read_path(Path(flight[1]))
    lines = ["t_s,lat_deg,lon_deg,height_m,heading_deg,pitch_deg"]
    for i in range(121):
        pose = path.pose_at(i / 60)
        angles = pose.lat_rad, pose.lon_rad, pose.heading_rad, pose.pitch_rad
        lat, lon, heading, pitch = np.degrees(angles).tolist()
        values = i / 60, lat, lon, pose.height_m, heading, pitch
        lines.append(",".join(map(repr, values)))
    frames = tmp_path / "frames.csv"
    frames.write_text("\n".join(lines) + "\n")
    (of_path,) = runs(flight, capsys)
    (of_frames,) = runs([flight[0], str(frames)], capsys)
    assert of_frames["bytes_read"] == of_path["bytes_read"]
    assert of_frames["share_frames_within"] == of_path["share_frames_within"]


@pytest.mark.parametrize(
    "words", [["--policy", "fastest"], ["--times", "0"], ["--throttle", "1"]]
)
def test_words_that_mean_nothing_are_refused(flight: list[str], words: list[str]) -> None:
    with pytest.raises(SystemExit) as left:
        replay([*flight, *words])
    assert left.value.code == 2


def test_a_path_that_is_not_there_is_one_line(flight: list[str]) -> None:
    with pytest.raises(InputError, match=r"none\.json"):
        replay([flight[0], "none.json"])
