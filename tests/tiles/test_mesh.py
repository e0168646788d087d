# SPDX-License-Identifier: Apache-2.0
"""Positions rounded to 16 bits."""

import numpy as np

from tiles.frames import Local
from tiles.mesh import STEPS, VERTEX, quantise


def test_rounding_is_half_a_step_and_uses_all_of_them(rng: np.random.Generator) -> None:
    local = rng.uniform(-1234.5, 1234.5, (1000, 3))
    steps, scale_m = quantise(Local(local))
    assert np.abs(steps * scale_m - local).max() <= scale_m / 2 * (1 + 1e-9)
    assert np.abs(steps).max() == STEPS


def test_a_point_and_nothing_have_a_scale() -> None:
    for local in (np.zeros((1, 3)), np.zeros((0, 3))):
        steps, scale_m = quantise(Local(local))
        assert scale_m > 0
        assert (steps == 0).all()


def test_a_vertex_is_16_bytes() -> None:
    assert VERTEX.itemsize == 16
