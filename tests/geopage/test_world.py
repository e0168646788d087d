# SPDX-License-Identifier: Apache-2.0
"""The door for scripts and notebooks."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import geopage
from tests.geopage.worlds import deep_globe, object_records, write_store
from tests.tiles.towns import Town, town
from tiles.errors import InputError


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Town:
    path = tmp_path_factory.mktemp("world") / "town.geopage"
    return town(path, np.random.default_rng(5), per_place=6)


def test_a_place_and_places_are_asked_alike(place: Town) -> None:
    lon, lat = place.centre_deg[::2].T
    with geopage.open(place.path) as world:
        many = world.objects_at(lon, lat)
        assert [world.objects_at(x, y) for x, y in zip(lon, lat, strict=True)] == many
        sampled = world.sample(lon, lat)
        assert [one["objects"] for one in sampled] == many
        assert world.sample(lon[0], lat[0]) == sampled[0]
    assert sum(map(len, many)) > 5
    for standing in many:
        for one in standing:
            assert one["attributes"] == {"number": one["id"] - 1}


def test_what_is_no_place_is_refused(place: Town) -> None:
    with geopage.open(place.path) as world:
        for lon, lat in (
            (0.0, 91.0),
            (np.nan, 0.0),
            (np.zeros(2), np.array([0.0, np.nan])),
        ):
            with pytest.raises(ValueError, match="expected finite degrees"):
                world.sample(lon, lat)


def test_a_world_without_objects_has_none(tmp_path: Path) -> None:
    write_store(tmp_path / "bare.geopage", deep_globe(), object_records()[:0])
    with geopage.open(tmp_path / "bare.geopage") as world:
        assert world.objects_at(3.0, 4.0) == []
        assert world.find("anything") == []


def test_no_store_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such store"):
        geopage.open(tmp_path / "none.geopage")


def test_importing_it_brings_nothing_heavy() -> None:
    code = "import sys, geopage; print('numpy' in sys.modules, 'numba' in sys.modules)"
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert out.split() == ["False", "False"]
