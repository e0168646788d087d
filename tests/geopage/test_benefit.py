# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from geopage.benefit import LATER, merged_ranks, ranks
from geopage.selection import Wants

BENEFITS = st.dictionaries(st.integers(0, 30), st.floats(0, 1e15))


def wants(benefit: dict[int, float]) -> Wants:
    rows, values = (
        np.array(list(benefit), np.int32),
        np.array(list(benefit.values()), float),
    )
    return Wants(rows, values, values)


def test_more_benefit_is_a_smaller_rank() -> None:
    assert (np.diff(ranks(wants({1: 0.0, 2: 1e-3, 3: 1.0, 4: 1e12}))) < 0).all()


@given(BENEFITS, BENEFITS, BENEFITS)
def test_each_row_comes_once_and_the_newest_view_comes_first(
    now: dict[int, float], soon: dict[int, float], later: dict[int, float]
) -> None:
    rows, keys = merged_ranks(wants(now), [(0.7, wants(soon)), (0.5, wants(later))])
    assert sorted(rows.tolist()) == sorted({*now, *soon, *later})
    assert (np.diff(keys) >= 0).all()
    assert set(rows[: len(now)].tolist()) == set(now)
    assert (keys[len(now) :] > LATER / 2).all()


def test_a_nearer_prediction_weighs_more() -> None:
    rows, _ = merged_ranks(wants({}), [(0.5, wants({1: 1.0})), (0.7, wants({2: 1.0}))])
    assert rows.tolist() == [2, 1]
