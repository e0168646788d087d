# SPDX-License-Identifier: Apache-2.0
"""Where a tile is, split on its own grid of steps."""

import numpy as np
import pytest

from viewer.draw_record import EXACT, INSTANCE_FLOATS, put_place

SCALE_M = float(np.float32(20.3))


def placed(offset_m: np.ndarray) -> np.ndarray:
    draw = np.zeros(INSTANCE_FLOATS, np.float32)
    put_place(draw, tuple(offset_m.tolist()), SCALE_M)
    return draw.astype(np.float64)


def test_a_vertex_is_rounded_by_its_own_distance(rng: np.random.Generator) -> None:
    """Vertices within 4 steps of the eye, in tiles whose centre is 25,000 steps away."""
    for _ in range(100):
        step = rng.integers(-25_000, 25_000, 3)
        near_m = rng.uniform(-4.0, 4.0, 3) * SCALE_M
        draw = placed(near_m - step * SCALE_M)
        assert (np.abs(draw[:3]) <= SCALE_M * 0.500001).all()
        assert (np.abs(draw[16:19] + step) <= 5).all()
        seen = (draw[16:19] + step) * draw[3] + draw[:3]
        assert np.abs(seen - near_m).max() < SCALE_M * 2.0**-24


@pytest.mark.parametrize("far", [2.0 * EXACT, np.inf, np.nan])
def test_an_axis_is_all_rest_where_float32_does_not_hold_its_steps(far: float) -> None:
    draw = placed(np.array((far, -far, 1.0)) * SCALE_M)
    assert draw[16:19].tolist() == [0.0, 0.0, 1.0]
    assert np.allclose(draw[:2], (far * SCALE_M, -far * SCALE_M), equal_nan=True)
