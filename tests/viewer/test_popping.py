# SPDX-License-Identifier: Apache-2.0
"""Popping: what changes although it should not."""

import numpy as np
import pytest

from tests.viewer.test_flip import flip
from viewer.popping import popping

GREY = np.full((40, 60, 3), 90, np.uint8)


def with_house(col: int) -> np.ndarray:
    picture = GREY.copy()
    picture[10:30, col : col + 8] = 200
    return picture


def test_what_moves_as_the_reference_does_is_no_popping() -> None:
    change = flip(with_house(20), with_house(22))
    assert change.mean() > 0.01
    assert popping(change, change) == 0


def test_a_house_that_appears_pops() -> None:
    appears, stands = flip(GREY, with_house(20)), flip(with_house(20), with_house(20))
    assert popping(appears, stands) == pytest.approx(float(appears.mean()))


def test_what_changes_less_than_the_reference_does_not_make_up_for_a_pop() -> None:
    left, right = flip(GREY, with_house(4)), flip(GREY, with_house(48))
    assert popping(left + right, right) == pytest.approx(float(left.mean()), rel=1e-5)
    assert popping(left, right) == pytest.approx(float(left.mean()), rel=1e-3)
