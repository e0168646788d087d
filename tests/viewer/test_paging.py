# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from geopage.settings import MIB, REPLAYED
from tests.geopage.worlds import deep_globe, object_records, write_store
from tiles.errors import InputError
from viewer.cli_replay import replay

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


def test_a_table_has_a_line_for_each_policy_and_throttle(
    flight: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay([*flight, "--policy", "demand,mmr", "--times", "0.5,2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["policy", *["demand", "mmr"] * 2]


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
