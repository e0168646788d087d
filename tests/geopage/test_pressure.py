# SPDX-License-Identifier: Apache-2.0
from itertools import pairwise

from geopage.pressure import FULL, STEP, MemoryPressure
from tests.geopage.worlds import view_at


def test_the_factor_rises_in_small_steps_until_the_view_fits() -> None:
    pressure, view = MemoryPressure(1000), view_at(100.0)
    factors = [1.0]
    while pressure.update(int(4000 / pressure.factor**2), view):
        factors.append(pressure.factor)
    assert all(b / a <= STEP * 1.0001 for a, b in pairwise(factors))
    assert 4000 / pressure.factor**2 <= FULL * 1000
    assert f"{pressure.factor:.2f}" in pressure.message


def test_a_static_view_comes_to_rest_even_when_one_step_changes_much() -> None:
    pressure, view = MemoryPressure(1000), view_at(100.0)
    changes = [
        pressure.update(2000 if pressure.factor < 1.2 else 10, view) for _ in range(50)
    ]
    assert not any(changes[10:])
    assert pressure.factor >= 1.2


def test_the_factor_falls_back_to_one_when_the_view_has_moved_away() -> None:
    pressure = MemoryPressure(1000)
    for _ in range(10):
        pressure.update(2000, view_at(100.0))
    while pressure.update(10, view_at(200.0)):
        assert pressure.factor >= 1.0
    assert pressure.factor == 1.0
    assert pressure.message == ""


def test_there_is_a_band_in_which_nothing_moves() -> None:
    pressure = MemoryPressure(1000)
    pressure.update(2000, view_at(100.0))
    assert not pressure.update(int(FULL * 1000 * 0.95), view_at(150.0))
