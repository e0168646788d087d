# SPDX-License-Identifier: Apache-2.0
"""Right-triangulated networks: whole, without T-junctions, finer where it is rough."""

import numpy as np
import pytest

from tiles.frames import Ecef
from viewer.rtin import rtin

SIDE = 32


def lattice(height: np.ndarray) -> tuple[Ecef, np.ndarray]:
    x, y = np.meshgrid(np.arange(SIDE + 1.0), np.arange(SIDE + 1.0))
    points = np.stack((x, y, height), axis=-1).reshape(-1, 3)
    return Ecef(points), np.tile((0.0, 0.0, 1.0), (len(points), 1))


def rough(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(SIDE + 1, SIDE + 1))


def areas(points: Ecef, triangles: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(points[triangles][..., :2], 1, 0)
    return np.linalg.det(np.stack((b - a, c - a), axis=1)) / 2


def test_flat_ground_is_two_triangles() -> None:
    points, up = lattice(np.zeros((SIDE + 1, SIDE + 1)))
    assert len(rtin(points, up, SIDE, 0.0)) == 2


def test_rough_ground_without_tolerance_is_the_whole_lattice() -> None:
    points, up = lattice(rough(1))
    assert len(rtin(points, up, SIDE, 0.0)) == 2 * SIDE * SIDE


@pytest.mark.parametrize("bound", [0.5, 1.0, 2.0])
def test_a_network_fills_the_square_and_has_no_t_junction(bound: float) -> None:
    points, up = lattice(rough(2))
    triangles = rtin(points, up, SIDE, bound)
    found = areas(points, triangles)
    assert (found > 0).all()
    assert found.sum() == pytest.approx(SIDE * SIDE)
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edge, count = np.unique(edges, axis=0, return_counts=True)
    ends = points[edge][..., :2]
    rim = ((ends == 0).all(1) | (ends == SIDE).all(1)).any(1)
    assert (count == np.where(rim, 1, 2)).all()


def test_a_looser_bound_takes_fewer_triangles_and_a_spike_is_kept() -> None:
    points, up = lattice(rough(3))
    counts = [len(rtin(points, up, SIDE, bound)) for bound in (0.0, 0.5, 1.0, 2.0, 9.0)]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 2
    spike = np.zeros((SIDE + 1, SIDE + 1))
    spike[13, 7] = 5.0
    points, up = lattice(spike)
    assert 13 * (SIDE + 1) + 7 in rtin(points, up, SIDE, 1.0)
