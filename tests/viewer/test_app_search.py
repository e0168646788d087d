# SPDX-License-Identifier: Apache-2.0
import math
from pathlib import Path

import pytest

from geopage.find import find_ids
from tests.viewer.small_world import ROWS
from tiles.store import Store
from viewer.app_search import MOST, NEAR_M, Search, place_of, title_of
from viewer.camera import Pose


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
        assert search.message == f"{len(expected)} found"
        assert len(answers(search, "-")) == MOST < ROWS * ROWS  # all names have one
        assert search.message == f"the first {MOST}"
        assert answers(search, "no such name") == []
        assert search.message == "nothing found"
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
