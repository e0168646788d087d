# SPDX-License-Identifier: Apache-2.0
"""Objects by attribute, against asking each object's attributes in Python."""

import json
import math
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import geopage
from geopage.cli import main
from geopage.find import Condition, find_ids, find_in_parts, parse, view_of
from tests.tiles.towns import town
from tiles.errors import InputError
from tiles.store import Store

Attributes = dict[str, Any]
NAMES = ("Straße des Friedens", "O'Hara's \"Bar\"", "100 %", "café _ 7")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Attributes]]:
    """A town whose objects have attributes of all kinds: store and attributes by id - 1."""
    path = tmp_path_factory.mktemp("find") / "town.geopage"
    made = town(path, np.random.default_rng(3), per_place=12)
    rng = np.random.default_rng(4)
    attributes = []
    for k in range(len(made.footprint)):
        one: Attributes = {"Number": k, "addr:street": NAMES[k % 4]}
        if k % 3:
            one["levels"] = (
                f"{rng.integers(1, 12)}" if k % 2 else float(rng.integers(1, 12))
            )
        if k % 5 == 0:
            one["listed"] = bool(k % 2)
        attributes.append(one)
    with sqlite3.connect(path) as connection:
        connection.executemany(
            "UPDATE object SET attributes=? WHERE id=?",
            [
                (json.dumps(one, ensure_ascii=False), k + 1)
                for k, one in enumerate(attributes)
            ],
        )
    connection.close()
    return path, attributes


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        ("Number=17", lambda a: a["Number"] == 17),
        ("number = 17.0", lambda a: a["Number"] == 17),
        ("levels>7", lambda a: "levels" in a and float(a["levels"]) > 7),
        ("levels<=2.5", lambda a: "levels" in a and float(a["levels"]) <= 2.5),
        ("levels!=3", lambda a: "levels" in a and float(a["levels"]) != 3),
        ("listed=TRUE", lambda a: a.get("listed") is True),
        ("addr:street=strasse des friedens", lambda a: a["addr:street"] == NAMES[0]),
        ("addr:street~CAFÉ _", lambda a: a["addr:street"] == NAMES[3]),
        ("hara's \"b", lambda a: a["addr:street"] == NAMES[1]),
        ("0 %", lambda a: a["addr:street"] == NAMES[2]),
        ("addr", lambda a: False),
    ],
)
def test_conditions_mean_what_they_say(
    condition: str,
    holds: Callable[[Attributes], bool],
    world: tuple[Path, list[Attributes]],
) -> None:
    path, attributes = world
    wanted = [k + 1 for k, one in enumerate(attributes) if holds(one)]
    with geopage.open(path) as opened:
        found = opened.find(condition)
        assert opened.find(condition, limit=2) == found[:2]
    assert [one["id"] for one in found] == wanted
    assert [one["attributes"] for one in found] == [attributes[k - 1] for k in wanted]


def test_what_the_store_knows_is_a_field_too(world: tuple[Path, list[Attributes]]) -> None:
    with geopage.open(world[0]) as opened:
        everything = opened.find("source=TOWN")
        tall, large = opened.find("height>8.5"), opened.find("dimension_m>=600")
    assert len(everything) == len(tall) == len(world[1])
    assert [one for one in everything if one["dimension_m"] >= 600] == large
    assert 0 < len(large) < len(everything)


def test_an_attribute_called_source_does_not_hide_the_sources(tmp_path: Path) -> None:
    path = tmp_path / "town.geopage"
    count = len(town(path, np.random.default_rng(3), per_place=2).footprint)
    with sqlite3.connect(path) as connection:
        connection.execute(
            'UPDATE object SET attributes=\'{"source": "survey"}\' WHERE id<3'
        )
    connection.close()
    with geopage.open(path) as opened:
        found = {
            words: len(opened.find(words))
            for words in ("source=town", "source=survey", "source!=survey", "source!=town")
        }
    assert found == {
        "source=town": count,
        "source=survey": 2,
        "source!=survey": count - 2,
        "source!=town": 0,
    }


@pytest.mark.parametrize(
    "words", ["", "  ", "=", "levels=", "=3", "levels>many", "nosuch>3"]
)
def test_a_bad_condition_is_one_line(
    words: str, world: tuple[Path, list[Attributes]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["find", str(world[0]), words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert words.split(">", maxsplit=1)[0] in err


def test_the_command_prints_objects_and_where_to_see_them(
    world: tuple[Path, list[Attributes]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["find", str(world[0]), "levels>3", "--limit", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["count"] > len(found["objects"]) == 2
    assert main(["find", str(world[0]), "levels>3", "--limit", "2"]) == 0
    out, err = capsys.readouterr()
    for line, one in zip(out.splitlines(), found["objects"], strict=True):
        assert line.startswith(f"object {one['id']} of town  --at {one['at']} ")
    assert f"{found['count']} of 'levels>3'" in err
    assert main(["find", str(world[0]), "nothing like it"]) == 1


def test_render_looks_at_what_was_found() -> None:
    one = {"lon_deg": 190.0, "lat_deg": 40.0, "height_m": 30.0, "dimension_m": 50.0}
    lat, lon, height_m = (float(part) for part in view_of(one).split(","))
    south_m = (40.0 - lat) * 111_000
    down = math.degrees(math.atan2(height_m - 15.0, south_m))
    assert down == pytest.approx(30.0, abs=0.5)
    assert lon == pytest.approx(-170.0)
    assert math.degrees(math.atan2(25.0, math.hypot(height_m, south_m))) < 30


def test_conditions_are_read_from_left_to_right() -> None:
    assert parse("a~x=1") == Condition("a", "~", "x=1")
    assert parse("a:b >= 1") == Condition("a:b", ">=", "1")
    with pytest.raises(InputError, match="not a number"):
        parse("a>b=1")


def test_a_search_in_parts_finds_the_same(world: tuple[Path, list[Attributes]]) -> None:
    with Store(world[0]) as store:
        whole = find_ids(store, "levels>3")
        parts = list(find_in_parts(store, "levels>3", at_once=3))
    assert max(map(len, parts)) <= 3
    assert [one for part in parts for one in part] == whole
