# SPDX-License-Identifier: Apache-2.0
"""Errors are one line, also when they come out of a worker process."""

import pickle
from pathlib import Path

from tiles.errors import InputError, TileFault


def test_errors_say_the_same_after_a_journey_between_processes() -> None:
    for error in (
        InputError(Path("a.tif"), "holds no data", "check its nodata value"),
        InputError("a", "b", "c"),
    ):
        assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert str(error) == "a: b; c"


def test_a_fault_names_lane_and_cell() -> None:
    assert str(TileFault("TERRAIN", "3/1/0/1", "no such row")) == (
        "TERRAIN tile 3/1/0/1: no such row"
    )
