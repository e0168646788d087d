# SPDX-License-Identifier: Apache-2.0
import itertools

import pytest

from geopage import tile_state
from geopage.tile_state import State, advance

ARROWS = {
    ("ABSENT", "QUEUED"),
    ("ABSENT", "LOADING"),
    ("QUEUED", "LOADING"),
    ("QUEUED", "ABSENT"),
    ("LOADING", "RESIDENT"),
    ("LOADING", "FAILED"),
    ("LOADING", "ABSENT"),
    ("RESIDENT", "UPLOADED"),
    ("RESIDENT", "ABSENT"),
    ("UPLOADED", "RELEASING"),
    ("RELEASING", "ABSENT"),
    ("RELEASING", "UPLOADED"),
}


@pytest.mark.parametrize(("was", "to"), list(itertools.product(State, State)))
def test_only_the_arrows_of_the_diagram_can_be_gone(was: State, to: State) -> None:
    if (was.name, to.name) in ARROWS:
        assert advance(was, to) is to
    else:
        with pytest.raises(ValueError, match=f"{was.name} to {to.name}"):
            advance(was, to)


def test_the_diagram_names_every_state() -> None:
    assert tile_state.__doc__ is not None
    assert all(state.name in tile_state.__doc__ for state in State)
