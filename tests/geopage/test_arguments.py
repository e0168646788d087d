# SPDX-License-Identifier: Apache-2.0
"""What people type, and what they get when it makes no sense."""

import json

import numpy as np
import pytest

from geopage.arguments import LAT_LON, LAT_LON_HEIGHT, Parser, positive, print_json, size


@pytest.fixture
def parser() -> Parser:
    parser = Parser("try", "For tests.")
    parser.add_argument("--at", type=LAT_LON_HEIGHT)
    parser.add_argument("--place", type=LAT_LON)
    parser.add_argument("--size", type=size, default=(1280, 720))
    parser.add_argument("--threshold", type=positive, default=2.0)
    parser.add_argument("files", nargs="*")
    return parser


@pytest.mark.parametrize(
    ("words", "at"),
    [
        (["--at", "47.4,8.5,100"], (47.4, 8.5, 100)),
        (["--at", "-33.9,18.4,100"], (-33.9, 18.4, 100)),
        (["--at=-33.9,18.4,-5"], (-33.9, 18.4, -5)),
        (["a", "b", "--at", "-0.1,-0.2,1e7"], (-0.1, -0.2, 1e7)),
    ],
)
def test_places_are_read_south_of_the_equator_too(
    words: list[str], at: tuple[float, ...], parser: Parser
) -> None:
    given = parser.read(words)
    assert given.at == at
    assert given.files == [word for word in words if word in {"a", "b"}]


@pytest.mark.parametrize(
    "words",
    [
        ["--at", "91,0,0"],
        ["--at", "0,400,0"],
        ["--at", "1,2"],
        ["--at", "1,2,3,4"],
        ["--at", "one,2,3"],
        ["--at", "nan,2,3"],
        ["--at", "1,inf,3"],
        ["--at", ""],
        ["--at"],
        ["--place", "-91,0"],
        ["--size", "1280"],
        ["--size", "0x5"],
        ["--size", "99999x100"],
        ["--size", "-5x100"],
        ["--threshold", "0"],
        ["--threshold", "-1"],
        ["--threshold", "nan"],
        ["--threshold", "much"],
        ["--unknown"],
    ],
)
def test_nonsense_is_one_line_and_exit_code_2(
    words: list[str], parser: Parser, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        parser.read(words)
    assert stop.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert err.startswith("geopage try: ")


def test_sizes_are_read_in_either_case(parser: Parser) -> None:
    assert parser.read(["--size", "640X480"]).size == (640, 480)


def test_json_has_no_numbers_that_json_lacks(capsys: pytest.CaptureFixture[str]) -> None:
    value = {
        "a": float("nan"),
        "b": [np.inf, np.float32(1.5), np.int64(3)],
        4: (np.bool_(1),),
    }
    print_json(value)
    found = json.loads(capsys.readouterr().out)
    assert found == {"a": None, "b": [None, 1.5, 3], "4": [True]}
