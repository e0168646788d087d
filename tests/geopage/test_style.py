# SPDX-License-Identifier: Apache-2.0
"""What `--style` may say."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geopage.palettes import RAMPS, category_colours, colour_of, ramp, text_of
from geopage.style import Style, parse_style
from tiles.errors import InputError

RED, GREY = (255, 0, 0), (204, 204, 204)


@pytest.mark.parametrize(
    ("words", "style"),
    [
        ("height", Style("height")),
        ("height:magma", Style("height", "magma")),
        ("building:levels", Style("building:levels")),
        ("building:levels:blues:1,12", Style("building:levels", "blues", (1, 12))),
        ("h:cividis:-2.5,1e2", Style("h", "cividis", (-2.5, 100))),
        ("use=house:#f00", Style("use", colours=(("house", RED),))),
        ("use=a:b, c:#ff0000,*:#ccc", Style("use", colours=(("a:b, c", RED), ("*", GREY)))),
        ("use=a:#f00,use=*:#ccc", Style("use", colours=(("a", RED), ("*", GREY)))),
        ("a:b=1:#FF0000,2 : #ccc", Style("a:b", colours=(("1", RED), ("2", GREY)))),
    ],
)
def test_a_style_is_read_as_it_is_written(words: str, style: Style) -> None:
    assert parse_style(words) == style


@pytest.mark.parametrize(
    "words",
    ["", "=", "=a:#fff", "use=", "use=a", "use=a:red", "use=a:#ff", "h:viridis:5,5",
     "h:viridis:9,5", "h:viridis:a,b", "h:viridis:nan,1", "none.json"],
)  # fmt: skip
def test_a_bad_style_is_one_line(words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_style(words)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("held", "style"),
    [
        ({"field": "h", "ramp": "magma"}, Style("h", "magma")),
        ({"field": "h", "min": 0, "max": 9}, Style("h", "viridis", (0, 9))),
        ({"field": "u", "colours": {"x": "#f00"}}, Style("u", colours=(("x", RED),))),
    ],
)
def test_a_file_says_the_same(held: Any, style: Style, tmp_path: Path) -> None:
    path = tmp_path / "style.json"
    path.write_text(json.dumps(held))
    assert parse_style(str(path)) == style


@pytest.mark.parametrize(
    "held",
    [
        [], {}, {"field": 3}, {"field": "h", "ramp": "rainbow"}, {"field": "h", "min": 1},
        {"field": "h", "min": "a", "max": 3}, {"field": "h", "colors": {}},
        {"field": "h", "colours": {"a": 3}}, {"field": "h", "colours": [1]},
        {"field": "h", "ramp": "magma", "colours": {"a": "#fff"}},
        {"field": "h", "colours": {str(k): "#fff" for k in range(300)}},
    ],
)  # fmt: skip
def test_a_bad_file_is_one_line(held: Any, tmp_path: Path) -> None:
    path = tmp_path / "style.json"
    path.write_text(json.dumps(held))
    with pytest.raises(InputError) as caught:
        parse_style(str(path))
    assert len(str(caught.value).splitlines()) == 1
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("held", ["{", "[" * 100_000, "\udcff"])
def test_a_file_that_is_no_json_is_one_line(held: str, tmp_path: Path) -> None:
    path = tmp_path / "style.json"
    path.write_bytes(held.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError, match="is no JSON") as caught:
        parse_style(str(path))
    assert len(str(caught.value).splitlines()) == 1


def test_ramps_begin_and_end_with_their_stops() -> None:
    for name, stops in RAMPS.items():
        first, *_, last = stops.split()
        colours = ramp(name, 253)
        assert tuple(colours[0]) == colour_of(first)
        assert tuple(colours[-1]) == colour_of(last)
        assert np.abs(np.diff(colours.astype(int), axis=0)).max() <= 4


@pytest.mark.parametrize("name", ["viridis", "cividis"])
def test_ramps_of_many_hues_get_lighter_all_the_way(name: str) -> None:
    linear = (ramp(name, 64) / 255) ** 2.2
    assert (np.diff(linear @ (0.2126, 0.7152, 0.0722)) > 0).all()


def test_colours_of_categories_differ_for_the_colour_blind() -> None:
    # Machado, Oliveira and Fernandes 2009, severity 1; linear RGB.
    seen_as = {
        "none": np.eye(3),
        "protan": [
            (0.152286, 1.052583, -0.204868),
            (0.114503, 0.786281, 0.099216),
            (-0.003882, -0.048116, 1.051998),
        ],
        "deutan": [
            (0.367322, 0.860646, -0.227968),
            (0.280085, 0.672501, 0.047413),
            (-0.011820, 0.042940, 0.968881),
        ],
    }
    colours = np.array(category_colours())
    assert [
        colour_of(text_of(tuple(one))) for one in colours.tolist()
    ] == category_colours()
    for matrix in seen_as.values():
        linear = ((colours / 255) ** 2.2) @ np.array(matrix).T
        shown = 255 * linear.clip(0, 1) ** (1 / 2.2)
        apart = np.linalg.norm(shown[:, None] - shown[None], axis=2)
        assert apart[~np.eye(len(colours), dtype=bool)].min() > 20
