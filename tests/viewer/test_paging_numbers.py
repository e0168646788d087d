# SPDX-License-Identifier: Apache-2.0
import json
from pathlib import Path
from typing import Any

import pytest

from geopage.settings import MIB
from tests.geopage.worlds import deep_globe, object_records, write_store
from tiles.errors import InputError
from viewer.cli_paging import paging
from viewer.paging_chart import panels_of
from viewer.paging_numbers import jobs
from viewer.paging_numbers.limits import FLAT, line, read_lines, replayed
from viewer.paging_numbers.routes import SAMPLE, read_routes

PATH = {
    "duration_s": 1.0,
    "height_reference": "ellipsoid",
    "interpolation": "log_height",
    "keyframes": [
        {
            "t_s": t_s,
            "lat_deg": 37.76,
            "lon_deg": -122.447,
            "height_m": height_m,
            "heading_deg": 0.0,
            "pitch_deg": -60.0,
        }
        for t_s, height_m in ((0.0, 1e6), (1.0, 300.0))
    ],
}
POLICIES, TIMES = ["benefit", "demand"], [0.5, 2.0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small store and two paths down to its town."""
    made = tmp_path_factory.mktemp("numbers")
    write_store(made / "w.geopage", deep_globe(), object_records())
    for name in ("down", "again"):
        (made / f"{name}.json").write_text(json.dumps({"name": name, **PATH}))
    return made


@pytest.fixture(scope="module")
def told(folder: Path) -> list[str]:
    """The document of two flights, two policies and two lines, by lines."""
    also = {"numbers": [{"what": FLAT, "limit": "1.10", "found": "1.02", "verdict": "met"}]}
    (folder / "also.json").write_text(json.dumps(also))
    words = [f"{folder}/w.geopage={folder}/down.json,{folder}/again.json"]
    words += ["--policy", ",".join(POLICIES), "--times", "0.5,2", "--rate", "25"]
    words += ["--also", str(folder / "also.json"), "--out", str(folder / "out")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs.os, "cpu_count", lambda: 1)  # no process has to start
        assert paging(words) in {0, 1}
    return (folder / "out" / "PAGING.md").read_text().splitlines()


def tables(told: list[str]) -> list[list[list[str]]]:
    """Return the tables' rows without their heads."""
    found: list[list[list[str]]] = [[]]
    for text in told:
        if text.startswith("|"):
            found[-1].append([cell.strip() for cell in text.strip("|").split("|")])
        elif found[-1]:
            found.append([])
    return [rows[2:] for rows in found if rows]


def test_each_number_of_the_document_stands_beside_its_limit(
    told: list[str], folder: Path
) -> None:
    kept: dict[str, Any] = json.loads((folder / "out" / "paging.json").read_text())
    rows = {row[0]: row[1:] for row in tables(told)[0]}
    assert rows.keys() == {one["what"] for one in kept["numbers"]}
    assert rows[FLAT][:3] == ["1.10", "1.02", "met"]
    for what, row in rows.items():
        assert row[2] in {"met", "**MISSED**", "open"}, what
        assert row[0], what
    assert sum("again over w" in what for what in rows) == 3


def test_its_tables_hold_the_replays_figures(told: list[str], folder: Path) -> None:
    runs: list[dict[str, Any]] = json.loads((folder / "out" / "paging.json").read_text())[
        "runs"
    ]
    assert len(runs) == 2 * len(POLICIES) * (len(TIMES) + 1)
    frames = tables(told)[2]
    assert [row[0] for row in frames] == POLICIES
    for row in frames:
        mine = [run for run in runs if run["policy"] == row[0]][: len(TIMES) + 1]
        for cell, run in zip(row[1:], mine, strict=True):
            assert float(cell.split()[0]) == pytest.approx(
                100 * run["share_frames_within"], abs=0.051
            )
    lead = float(tables(told)[1][0][2].split()[0])
    ours, theirs = (
        next(r for r in runs if (r["policy"], r["times"]) == (name, 0.5))
        for name in POLICIES
    )
    shares = ours["share_frames_within"] - theirs["share_frames_within"]
    assert lead == pytest.approx(100 * shares, abs=0.051)


def test_a_path_twice_gives_the_same_figures(folder: Path, told: list[str]) -> None:
    runs = json.loads((folder / "out" / "paging.json").read_text())["runs"]
    first, again = (
        [{**run, "flight": ""} for run in runs if run["flight"].startswith(name)]
        for name in ("down", "again")
    )
    assert first == again
    assert first[0]["frames"] == 25
    assert any("pictures/policies.svg" in text for text in told)
    assert "<!-- demand -->" in (folder / "out" / "pictures" / "policies.svg").read_text()


def test_a_limit_is_missed_just_above_it() -> None:
    assert line("a", "1", "1", is_met=True).verdict == "met"
    run = {
        "policy": "benefit",
        "times": None,
        "flight": "f over s",
        "bytes_read": 13 * 10**6,
        "bytes_over_ideal": 1.3,
        "tiles_loaded": 100,
        "peak_bytes": 512 * MIB,
        "prediction": {"never_drawn_share": 0.05},
    }
    half = {**run, "times": 0.5, "share_frames_within": 0.7, "threshold_px": 2.0}
    reference = {**half, "policy": "oracle", "share_frames_within": 0.729}
    assert {one.verdict for one in replayed([run, half, reference], 512 * MIB)} == {"met"}
    worse = [
        {**run, "bytes_over_ideal": 1.31, "prediction": {"never_drawn_share": 0.051}},
        {**half, "share_frames_within": 0.69},
        reference,
    ]
    lines = replayed(worse, 512 * MIB - 1)
    assert {one.verdict for one in lines} == {"MISSED"}
    assert len(lines) == 4


def test_a_store_without_paths_is_flown_on_those_of_the_samples(folder: Path) -> None:
    store = str(folder / "w.geopage")
    routes = read_routes([store, f"{store}=monaco"])
    assert [route.path.stem for route in routes] == [*SAMPLE, "monaco"]
    assert routes[0].title == "fly_in over w"


@pytest.mark.parametrize("words", ["none.geopage", "{}=nowhere", "{}=fly_in,fly_in"])
def test_what_cannot_be_flown_is_one_line(folder: Path, words: str) -> None:
    with pytest.raises(InputError):
        read_routes([words.format(folder / "w.geopage")])


@pytest.mark.parametrize("text", ["", "[]", '{"numbers": [{"what": "a"}]}'])
def test_numbers_that_no_benchmark_wrote_are_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(InputError, match=r"bad\.json"):
        read_lines(tmp_path / "bad.json")


def test_the_document_says_with_which_words_it_was_made(told: list[str]) -> None:
    (words,) = [text for text in told if "- command: " in text]
    assert "w.geopage=down,again --policy benefit,demand --times 0.5,2 --rate 25" in words


def test_a_panel_is_the_first_flight_of_a_store_or_the_mean_of_its_others() -> None:
    flights = [("a", "x"), ("a", "y"), ("a", "z"), ("b", "x")]
    runs = [{"store": store, "flight": f"{path} over {store}"} for store, path in flights]
    panels = panels_of(runs)
    assert list(panels) == ["x over a", "mean of 2 other flights over a", "x over b"]
    assert [len(found) for found in panels.values()] == [1, 2, 1]
