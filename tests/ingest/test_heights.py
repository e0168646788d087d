# SPDX-License-Identifier: Apache-2.0
"""Heights: what people write, in metres; what is no height is counted, not believed."""

from typing import Any, cast

import numpy as np
import pytest

from ingest.heights import HeightRules, count_how, heights_of, numbers_of
from tiles.errors import InputError


def column(*values: object) -> np.ndarray:
    array = np.empty(len(values), object)
    array[:] = values
    return array


def find(
    columns: dict[str, np.ndarray], **rules: str | float
) -> tuple[list[float], dict[str, int]]:
    count = len(next(iter(columns.values())))
    found = heights_of("city.gpkg", columns, count, HeightRules(**cast("Any", rules)))
    return found.top_m.tolist(), count_how(found.how)


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("12", 12),
        ("12.5", 12.5),
        ("12,5", 12.5),
        ("12 m", 12),
        ("12m", 12),
        (" ~10 ", 10),
        ("ca. 8 metres", 8),
        ("40 ft", 12.192),
        ("40'", 12.192),
        ("5'6\"", 1.6764),
        (15, 15),
    ],
)
def test_what_people_write_is_understood(text: object, metres: float) -> None:
    value, given = numbers_of(column(text, None), 1.0)
    assert value[0] == pytest.approx(metres)
    assert np.isnan(value[1])
    assert given.tolist() == [True, False]


@pytest.mark.parametrize(
    "text", ["tall", "-3", "0", "10-20", "nan", "1e9", "12 parsecs", "5;6", "10000", True]
)
def test_nonsense_falls_back_to_levels_then_the_default_and_is_counted(
    text: object,
) -> None:
    columns = {"height": column(text, text), "levels": column("4", None)}
    top, how = find(columns, default_height_m=7.0)
    assert top == [12.0, 7.0]
    assert how["from_levels"] == how["default"] == 1
    assert how["unreadable_value"] == 2


def test_numbers_of_every_type_and_missing_ones_are_told_apart() -> None:
    floats = {"Height": np.array([3.5, np.nan, -1.0, np.inf, 2000.0])}
    top, how = find(floats)
    assert top == [3.5, 6, 6, 6, 6]
    assert (how["from_attribute"], how["default"], how["unreadable_value"]) == (1, 4, 3)
    assert find({"HEIGHT": np.array([9], np.int32)})[0] == [9.0]


def test_a_height_of_the_roof_alone_is_no_height_of_the_building() -> None:
    top, how = find({"roof_height": column("3"), "num_floors": column("4")})
    assert top == [12.0]
    assert how["from_levels"] == 1


def test_usual_names_hold_in_any_case() -> None:
    assert find({"Building:Levels": column("2")})[0] == [6.0]
    assert find({"measuredHeight": column("7.5")})[0] == [7.5]
    found = heights_of("x", {"height": column(9), "min_floor": column(1)}, 1, HeightRules())
    assert found.foot_m.tolist() == [3.0]


def test_a_value_that_is_no_number_type_is_counted_and_none_is_not() -> None:
    values = ([12], {"m": 3}, float("nan"), "", None, 1, True)
    top, how = find({"height": column(*values)})
    assert top == [6, 6, 6, 6, 6, 1, 6]
    assert how["unreadable_value"] == 3


def test_feet_hold_for_bare_numbers_and_not_for_levels() -> None:
    columns = {"height": column("100", "10 m", None), "floors": column(None, None, "2")}
    assert find(columns, units="ft")[0] == pytest.approx([30.48, 10, 6])


def test_the_best_of_the_usual_names_wins_and_the_next_fills_its_gaps() -> None:
    columns = {"building:height": column("5", "6"), "height": column(None, "9")}
    assert find(columns)[0] == [5.0, 9.0]


def test_a_raised_part_begins_at_its_base_unless_the_base_is_above_its_top() -> None:
    columns = {
        "height": column("20", "20", "20"),
        "min_height": column("8", "30", None),
        "building:min_level": column(None, None, "2"),
    }
    found = heights_of("x", columns, 3, HeightRules())
    assert found.foot_m.tolist() == [8.0, 0.0, 6.0]
    counts = count_how(found.how)
    assert (counts["raised"], counts["base_ignored"]) == (2, 1)


@pytest.mark.parametrize("option", ["height", "levels", "base"])
def test_a_named_field_must_exist_and_the_others_are_listed(option: str) -> None:
    rules = HeightRules(**{option: "tallness"})
    with pytest.raises(InputError, match=r"no field named tallness.*fields are: name, h"):
        heights_of("city.shp", {"name": column("a"), "h": column(1)}, 1, rules)


def test_a_named_field_is_the_only_one_looked_at() -> None:
    columns = {"height": column("50"), "roof_z": column("11")}
    assert find(columns, height="roof_z")[0] == [11.0]


def test_every_feature_has_one_origin() -> None:
    columns = {
        "height": column("5", None, "x", None),
        "levels": column("1", "2", "0", None),
    }
    _, how = find(columns)
    assert how["from_attribute"] + how["from_levels"] + how["default"] == 4
