# SPDX-License-Identifier: Apache-2.0
"""Greedy insertion keeps its bound, covers the square once, and is Delaunay."""

import numpy as np
import pytest
from numpy.typing import NDArray

from ingest.greedy import simplify

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def posts_of(height: Floats) -> Floats:
    side = height.shape[0]
    y, x = np.mgrid[:side, :side] * 10.0
    return np.stack([x, y, height], axis=-1)


def rough(side: int, rng: np.random.Generator) -> Floats:
    y, x = np.mgrid[:side, :side]
    wave = 30 * np.sin(x / 5.0) * np.cos(y / 4.0)
    return np.asarray(wave + rng.normal(size=(side, side)))


def places(used: Ints, side: int) -> Ints:
    return np.stack([used % side, used // side], axis=1)


def twice_area(corner: Ints) -> Ints:
    a, b, c = np.moveaxis(corner, 1, 0)
    return np.asarray(
        (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1])
        - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    )


def worst_post(posts: Floats, used: Ints, triangles: Ints) -> float:
    """Distance of each post from its triangle at the same place, by brute force."""
    side = posts.shape[0]
    at, points = places(used, side), posts.reshape(-1, 3)[used]
    worst = np.full(side * side, np.inf)
    place = places(np.arange(side * side), side)
    for triangle in triangles:
        edges = np.stack(
            [at[triangle[1]] - at[triangle[0]], at[triangle[2]] - at[triangle[0]]]
        )
        weights = np.linalg.solve(edges.T, (place - at[triangle[0]]).T).T
        weights = np.column_stack([1 - weights.sum(axis=1), weights])
        inside = (weights > -1e-9).all(axis=1)
        flat = weights[inside] @ points[triangle]
        gap = np.linalg.norm(flat - posts.reshape(-1, 3)[inside], axis=1)
        worst[inside] = np.minimum(worst[inside], gap)
    return float(worst.max())


@pytest.mark.parametrize("bound_m", [0.5, 3.0, 20.0])
def test_every_post_is_within_the_bound(bound_m: float, rng: np.random.Generator) -> None:
    posts = posts_of(rough(33, rng))
    used, triangles, _ = simplify(posts, bound_m)
    assert worst_post(posts, used, triangles) <= bound_m + 1e-9


def test_triangles_cover_the_square_once_and_turn_left(rng: np.random.Generator) -> None:
    posts = posts_of(rough(65, rng))
    used, triangles, border = simplify(posts, 2.0)
    area = twice_area(places(used, 65)[triangles])
    assert (area > 0).all()
    assert area.sum() == 2 * 64 * 64
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    once = (np.unique(edges, axis=0, return_counts=True)[1] == 1).sum()
    assert np.unique(edges, axis=0, return_counts=True)[1].max() == 2
    assert once == len(border)
    on_rim = places(used, 65)[border]
    assert ((on_rim == 0) | (on_rim == 64)).any(axis=2).all()


def test_no_neighbour_lies_inside_a_circumcircle(rng: np.random.Generator) -> None:
    used, triangles, _ = simplify(posts_of(rough(33, rng)), 2.0)
    at = places(used, 33).astype(float)
    owner = {
        (int(t[k]), int(t[(k + 1) % 3])): int(t[(k + 2) % 3])
        for t in triangles
        for k in range(3)
    }
    for (a, b), c in owner.items():
        if (b, a) in owner:
            rows = at[[a, b, c]] - at[owner[b, a]]
            in_circle = np.linalg.det(np.column_stack([rows, (rows**2).sum(axis=1)]))
            assert in_circle <= 1e-6


def test_a_flat_square_is_two_triangles() -> None:
    used, triangles, border = simplify(posts_of(np.zeros((65, 65))), 0.0)
    assert len(triangles) == 2
    assert sorted(used.tolist()) == [0, 64, 64 * 65, 65 * 65 - 1]
    assert len(border) == 4


def test_a_bound_of_zero_keeps_every_post_of_rough_ground(rng: np.random.Generator) -> None:
    used, triangles, _ = simplify(posts_of(rough(17, rng)), 0.0)
    assert len(used) == 17 * 17
    assert len(triangles) == 2 * 16 * 16


def test_it_needs_fewer_triangles_than_a_uniform_grid_of_the_same_error() -> None:
    y, x = np.mgrid[:65, :65]
    hill = posts_of(80 * np.exp(-((x - 20) ** 2 + (y - 40) ** 2) / 60.0))
    for step in (16, 8, 4, 2):
        chosen = np.arange(0, 65, step)
        grid = (chosen[:, None] * 65 + chosen).ravel()
        at = np.arange(len(chosen) ** 2).reshape(len(chosen), -1)
        sw, se, nw, ne = at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]
        lower = np.stack([sw, se, ne], axis=-1).reshape(-1, 3)
        upper = np.stack([sw, ne, nw], axis=-1).reshape(-1, 3)
        uniform = np.concatenate([lower, upper])
        error = worst_post(hill, grid, uniform)
        assert len(simplify(hill, error)[1]) < 0.7 * len(uniform)
