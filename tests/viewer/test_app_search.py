# SPDX-License-Identifier: Apache-2.0
import math
from pathlib import Path

import pytest

from geopage.find import find_ids
from tests.viewer.flown import CITY
from tests.viewer.small_world import ROWS
from tiles.store import Store
from viewer.app_search import MOST, NEAR_M, Search, place_of, title_of
from viewer.camera import Pose
from viewer.places import named_like


@pytest.mark.parametrize(
    ("words", "place"),
    [
        ("47.37, 8.54", (47.37, 8.54, NEAR_M)),
        ("47.37 8.54", (47.37, 8.54, NEAR_M)),
        (" -33.9,18.4,100 ", (-33.9, 18.4, 100.0)),
        ("47.37°, 8.54°", (47.37, 8.54, NEAR_M)),
        ("37.8;-122.4; 250 m", (37.8, -122.4, 250.0)),
    ],
)
def test_coordinates_are_a_place(words: str, place: tuple[float, float, float]) -> None:
    hit = place_of(words)
    assert hit is not None
    assert (hit.lat_deg, hit.lon_deg, hit.above_m) == place
    pose = hit.pose(lambda _: 400.0)
    assert pose.height_m == 400.0 + hit.above_m
    assert pose.pitch_rad == -math.pi / 2


@pytest.mark.parametrize("words", ["museum", "97, 8", "12", "height>10", "47.3, 8.5, x"])
def test_other_words_are_none(words: str) -> None:
    assert place_of(words) is None


def answers(search: Search, words: str) -> list[str]:
    search.ask(words)
    while search.on:
        search.step()
    return [hit.label for hit in search.hits]


def test_a_search_finds_what_the_command_finds(hill_store: Path) -> None:
    with Store(hill_store) as store:
        search = Search(store)
        expected = store.objects(find_ids(store, "height>=26"))
        found = answers(search, "height>=26")
        assert found == [title_of(one) for one in expected]
        assert search.message == f"{len(expected)} found: click one to fly there"
        assert len(answers(search, "-")) == MOST < ROWS * ROWS  # all names have one
        assert search.message == f"the first {MOST}: click one to fly there"
        assert answers(search, "no such name") == []
        assert search.message == "nothing found; there is hills, city"
        assert answers(search, "95, 200") == []
        assert search.message == "latitude is -90 to 90, longitude -180 to 360"
        assert answers(search, "height>tall") == []
        assert "not a number" in search.message
        assert answers(search, "") == []
        assert not search.message
        search.ask("height>=26", near := Pose(math.radians(11), math.radians(46), 0, 0, 0))
        while search.on:
            search.step()
        north_east = [hit.lat_deg + hit.lon_deg for hit in search.hits]
        assert north_east[0] > north_east[-1]
        assert search.hits[0].away(near) < search.hits[-1].away(near)


def test_a_source_is_found_by_its_name_however_it_is_written(hill_store: Path) -> None:
    with Store(hill_store) as store:
        search = Search(store)
        for words in ("city", "CI_TY", " ci ty"):
            answers(search, words)
            assert search.best is search.hits[0]
            assert search.best.name == "city"
        assert (search.best.lon_deg, search.best.lat_deg) == pytest.approx(CITY, abs=2e-4)
        answers(search, "height>=26")
        assert search.best is None
        answers(search, "Hills")
        assert search.best
        assert search.best.above_m > 1e7


@pytest.mark.parametrize(
    ("name", "words", "alike"),
    [
        ("sanfrancisco", "San Francisco", True),
        ("san_francisco_10m", "sanfrancisco", True),
        ("zürich", "ZÜRICH", True),
        ("sanfrancisco", "oakland", False),
        ("sanfrancisco", "__", False),
    ],
)
def test_case_and_blanks_make_no_other_name(
    name: str,
    words: str,
    alike: bool,  # noqa: FBT001
) -> None:
    assert named_like(name, words) == alike
