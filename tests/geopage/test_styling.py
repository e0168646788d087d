# SPDX-License-Identifier: Apache-2.0
"""Which entry of the palette objects and proxies get, against plain Python."""

import json
import sqlite3
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geopage.scale import FIRST, MISSING_ENTRY, OTHER_ENTRY, STEPS, legend_lines
from geopage.style import parse_style
from geopage.styling import Styling, styling_of
from tests.tiles.towns import town
from tiles import cells
from tiles.errors import InputError
from tiles.store import Store

Row = tuple[int, int, float, dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Place:
    """A store, and its objects as id, cell, dimension, attributes."""

    path: Path
    rows: list[Row]

    def styling(self, words: str) -> Styling:
        with Store(self.path) as store:
            return styling_of(store, parse_style(words))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """Every fifth object has no use, every seventh no height; heights are texts, too."""
    path = tmp_path_factory.mktemp("styling") / "town.geopage"
    made = town(path, np.random.default_rng(8), per_place=20)
    rng = np.random.default_rng(9)
    uses = [f"use {int(k)}" for k in rng.geometric(0.2, len(made.footprint))]
    with sqlite3.connect(path) as connection:
        for k, use in enumerate(uses):
            one: dict[str, Any] = {"listed": k % 2 == 0}
            height = float(rng.uniform(2, 90))
            if k % 5:
                one["use"] = use.upper() if k % 2 else use
            if k % 7:
                one["tall"] = f"{height}" if k % 3 else height
            connection.execute(
                "UPDATE object SET attributes=? WHERE id=?", (json.dumps(one), k + 1)
            )
        found = connection.execute("SELECT id, cell, dimension_m, attributes FROM object")
        rows = [(*row[:3], json.loads(row[3])) for row in found]
    connection.close()
    return Place(path, rows)


def entries(styling: Styling, ids: list[int]) -> list[int]:
    """The entries of objects."""
    found: list[int] = styling.of_objects(np.array(ids)).tolist()
    return found


def test_the_commonest_values_get_the_colours(place: Place) -> None:
    styling = place.styling("use")
    count = Counter(row[3]["use"].lower() for row in place.rows if "use" in row[3])
    shown = styling.legend["categories"]
    assert len(shown) == 11 < len(count)
    assert [one["count"] for one in shown] == sorted(count.values(), reverse=True)[:11]
    values = [one["value"].lower() for one in shown]
    wanted = []
    for row in place.rows:
        use = row[3].get("use", "").lower()
        named = FIRST + values.index(use) if use in values else OTHER_ENTRY
        wanted.append(named if use else MISSING_ENTRY)
    assert entries(styling, [row[0] for row in place.rows]) == wanted
    rest = styling.legend["other"]["count"] + styling.legend["missing"]["count"]
    assert rest + sum(one["count"] for one in shown) == len(place.rows)
    for one, colour in zip(shown, styling.palette[FIRST:], strict=False):
        assert one["colour"] == "#" + bytes(colour).hex()


def test_stated_values_get_the_stated_colours(place: Place) -> None:
    styling = place.styling("use=USE 2:#102030,nowhere:#000,use 1:#ffffff,*:#0000ff")
    wanted = []
    for row in place.rows:
        use = row[3].get("use", "").lower()
        named = {"use 2": FIRST, "use 1": FIRST + 2}.get(use, OTHER_ENTRY)
        wanted.append(named if use else MISSING_ENTRY)
    assert entries(styling, [row[0] for row in place.rows]) == wanted
    assert styling.palette[FIRST].tolist() == [16, 32, 48]
    assert styling.palette[OTHER_ENTRY].tolist() == [0, 0, 255]
    assert styling.legend["categories"][1]["count"] == 0


def test_truth_values_are_categories(place: Place) -> None:
    legend = place.styling("listed").legend
    assert {one["value"] for one in legend["categories"]} == {"true", "false"}


@pytest.mark.parametrize("words", ["tall", "tall:magma", "TALL:blues:10,40"])
def test_numbers_get_a_ramp(words: str, place: Place) -> None:
    styling = place.styling(words)
    number = np.array([float(row[3].get("tall", "nan")) for row in place.rows])
    low, high = np.nanquantile(number, (0.02, 0.98)) if "10" not in words else (10, 40)
    assert (styling.legend["min"], styling.legend["max"]) == pytest.approx((low, high))
    share = ((number - low) / (high - low)).clip(0, 1)
    found = np.array(entries(styling, [row[0] for row in place.rows]))
    assert (found[np.isnan(number)] == MISSING_ENTRY).all()
    there = ~np.isnan(number)
    assert np.abs(found[there] - FIRST - share[there] * (STEPS - 1)).max() <= 0.5001
    assert (styling.legend["quantiles"] is None) == ("10" in words)


def test_few_numbers_are_categories_unless_a_ramp_is_asked_for(place: Place) -> None:
    assert "categories" in place.styling("height_m").legend
    ramp = place.styling("height:viridis")
    assert ramp.legend["min"] == ramp.legend["max"] == 9.0
    assert set(entries(ramp, [1, 2, 3])) == {FIRST}


def test_an_object_that_came_later_is_missing(place: Place) -> None:
    assert entries(place.styling("use"), [10**6, 1 << 40]) == [MISSING_ENTRY] * 2


@pytest.mark.parametrize("words", ["use", "tall"])
def test_a_proxy_has_the_colour_of_what_it_stands_for(words: str, place: Place) -> None:
    styling = place.styling(words)
    of = dict(
        zip(
            (row[0] for row in place.rows),
            entries(styling, [row[0] for row in place.rows]),
            strict=True,
        )
    )
    several = 0
    above = sorted({int(cells.ancestor(row[1], 0)) for row in place.rows})
    for cell, shown in zip(above, styling.of_children(np.array(above)), strict=True):
        for child, found in zip(cells.children(cell), shown.tolist(), strict=True):
            below = [row for row in place.rows if cells.contains(child, row[1])]
            weight = dict.fromkeys(range(256), 0.0)
            for row in below:
                weight[of[row[0]]] += row[2] ** 2
            if words == "use":
                best = max(weight.values())
                assert weight[found] == pytest.approx(best) if below else found == 1
            else:
                valued = {k: w for k, w in weight.items() if k >= FIRST and w}
                total = sum(valued.values())
                mean = sum(k * w for k, w in valued.items()) / total if total else 1
                assert abs(found - mean) <= 0.51
            several += len(below) > 5
    assert several > 5


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("nosuch", "no object has"),
        ("tall:rainbow", "ramps are viridis"),
        ("use:magma", "no numbers"),
    ],
)
def test_a_style_that_does_not_suit_is_one_line(
    words: str, says: str, place: Place
) -> None:
    with pytest.raises(InputError, match=says) as caught:
        place.styling(words)
    assert len(str(caught.value).splitlines()) == 1


def test_a_legend_in_words_names_each_colour_once(place: Place) -> None:
    for words in ("use", "tall", "use=use 1:#123456"):
        legend = place.styling(words).legend
        lines = legend_lines(legend)
        assert lines[0] == f"{legend['field']}:"
        colours = [line.split()[0] for line in lines if "#" in line]
        assert len(colours) == len(set(colours)) >= 2
        assert any("missing" in line for line in lines)
