# SPDX-License-Identifier: Apache-2.0
"""What is taken out of a mesh is not missed: at no post, and nowhere between posts."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from ingest import triangulation
from ingest.closing import Under
from ingest.delaunay import Net
from ingest.triangulation import Triangles, Triangulation
from ingest.upright import highs, sag
from tests.ingest.test_greedy import (
    CORNERS,
    ONE,
    Floats,
    Ints,
    ground,
    leaning,
    rough,
    twice_area,
)

SIDE = 33
POSTS = SIDE - 1
FAR_UP = np.array([0.0, 0.0, 1e15])
"""The earth's centre of a flat earth"""


class Land(NamedTuple):
    """Posts 10 m apart, and the mesh's net over them."""

    high_m: Floats
    """(SIDE, SIDE) row 0 south"""
    under: Under
    start: Callable[[], Triangulation]


def land_of(high_m: Floats) -> Land:
    """Put posts on a flat earth, squares cut from the south-west to the north-east."""
    x, y = np.meshgrid(*[np.arange(SIDE)] * 2)
    posts = np.stack([10 * x, 10 * y, high_m], axis=-1).astype(np.float32)
    at = np.stack([x.ravel(), y.ravel()], axis=1) * (ONE // POSTS)
    places = ground(at, posts[..., 2].astype(np.float64).ravel())
    grid = np.zeros((2, 6))
    grid[0, 1] = grid[1, 2] = POSTS
    to_map = np.ascontiguousarray(leaning(np.array([(ONE, 0), (0, ONE)]), -1).T)
    under = Under(posts, grid, np.zeros(3), to_map)
    flat = leaning(places.at, -1)
    start = lambda: Triangulation(places.at, flat, places.points, FAR_UP)  # noqa: E731
    return Land(posts[..., 2].astype(np.float64), under, start)


def true_m(high_m: Floats, xy: Floats) -> Floats:
    """Heights of the posts' triangles at columns and rows (n, 2)."""
    c, r = np.minimum(xy.astype(int), POSTS - 1).T
    fx, fy = (xy - np.stack([c, r], axis=1)).T
    side = np.where(fx > fy, high_m[r, c + 1], high_m[r + 1, c])
    near, far = 1 - np.maximum(fx, fy), np.minimum(fx, fy)
    beside = np.abs(fx - fy)
    return np.asarray(near * high_m[r, c] + beside * side + far * high_m[r + 1, c + 1])


def worst_m(land: Land, found: Triangles) -> float:
    """Largest difference at posts, and where edges cross lines between posts."""
    x, y = np.meshgrid(*[np.arange(SIDE)] * 2)
    posts = np.stack([x.ravel(), y.ravel()], axis=1)
    off = np.full(len(posts), np.inf)
    across = 0.0
    vertices = found.at / (ONE / POSTS)
    for corners in found.triangles:
        a, b, c = vertices[corners]
        weights = np.linalg.solve(np.stack([b - a, c - a], axis=1), (posts - a).T).T
        weights = np.column_stack([1 - weights.sum(axis=1), weights])
        over = (weights > -1e-9).all(axis=1)
        drawn = weights[over] @ found.points[corners, 2]
        off[over] = np.abs(drawn - true_m(land.high_m, posts[over].astype(float)))
        for p, q in zip(corners, np.roll(corners, 1), strict=True):
            one, other = vertices[p], vertices[q]
            part = [np.zeros(1)]
            for way in ((1, 0), (0, 1), (1, -1)):
                start, end = one @ way, other @ way
                lines = np.arange(np.ceil(min(start, end)), max(start, end))
                part.append((lines - start) / (end - start if end != start else 1.0))
            f = np.concatenate(part)[:, None]
            low, high = found.points[[p, q], 2]
            drawn = low + f[:, 0] * (high - low)
            true = true_m(land.high_m, one + f * (other - one))
            across = max(across, float(np.abs(drawn - true).max()))
    return max(float(off.max()), across)


@pytest.fixture
def land(rng: np.random.Generator) -> Land:
    return land_of(rough(SIDE, rng))


@pytest.mark.parametrize("wholly", [False, True])
@pytest.mark.parametrize("bound_m", [1.0, 4.0])
def test_every_post_and_every_crossing_is_within_the_bound(
    bound_m: float, *, wholly: bool, land: Land
) -> None:
    net = land.start()
    if wholly:
        net.refine_wholly()
    assert net.close(bound_m, land.under)
    worst = worst_m(land, net.result())
    assert 0.8 * bound_m < worst <= bound_m + 1e-6


def test_triangles_still_cover_the_square_once_and_know_their_neighbours(
    land: Land,
) -> None:
    net = land.start()
    net.close(3.0, land.under)
    found = net.result()
    area = twice_area(found.at[found.triangles])
    assert (area > 0).all()
    assert area.sum() == 2 * ONE * ONE
    np.testing.assert_array_equal(found.at[:4], CORNERS)
    mine: dict[tuple[int, int], int] = {}
    for t, (a, b, c) in enumerate(found.triangles.tolist()):
        mine |= {(a, b): t, (b, c): t, (c, a): t}
    assert len(mine) == 3 * len(found.triangles)
    for t, corners in enumerate(found.triangles.tolist()):
        for k in range(3):
            beyond = mine.get((corners[(k + 1) % 3], corners[k]), -1)
            assert found.across[t, k] == beyond
            on_rim = (found.at[[corners[k], corners[(k + 1) % 3]]] % ONE == 0).all(axis=0)
            assert (beyond < 0) <= on_rim.any()


def test_a_tenth_of_the_triangles_is_taken_out(
    land: Land, monkeypatch: pytest.MonkeyPatch
) -> None:
    net = land.start()
    net.close(2.0, land.under)
    thinned = len(net.result().triangles)

    def kept(_net: Net, _lists: object, _ground: object, count: int, *_: object) -> int:
        return count

    monkeypatch.setattr(triangulation, "thin", kept)
    whole = land.start()
    whole.close(2.0, land.under)
    assert thinned < 0.9 * len(whole.result().triangles)


def test_of_all_posts_of_a_plane_the_corners_are_left() -> None:
    x, y = np.meshgrid(*[np.arange(SIDE)] * 2)
    land = land_of(3.0 * x - 2.0 * y)
    net = land.start()
    net.refine_wholly()
    net.close(0.01, land.under)
    found = net.result()
    assert (len(found.triangles), found.used.tolist()) == (2, [0, 1, 2, 3])


def test_what_was_added_stays(land: Land, rng: np.random.Generator) -> None:
    net = land.start()
    net.close(3.0, land.under)
    places = np.unique(rng.integers(1, ONE, (40, 2)), axis=0)
    x, y = (places / (ONE / 320)).T
    height = true_m(land.high_m, places / (ONE / POSTS))
    near = np.zeros(len(places), np.int64)
    points = np.column_stack([x, y, height])
    assert net.add(places, leaning(places, -1), points, near)
    net.close(3.0, land.under)
    found = net.result()
    assert set(map(tuple, places.tolist())) <= set(map(tuple, found.at.tolist()))
    assert worst_m(land, found) <= 3.0 + 1e-6


def test_a_thinned_mesh_is_refined_on(land: Land) -> None:
    net = land.start()
    counts = []
    for bound_m in (10.0, 3.0, 1.0):
        net.close(bound_m, land.under)
        found = net.result()
        assert worst_m(land, found) <= bound_m + 1e-6
        counts.append(len(found.triangles))
    assert counts == sorted(counts)
    net.refine_wholly()
    posts = set(map(tuple, net.result().at.tolist()))
    assert posts >= {
        (x, y) for x in range(0, ONE + 1, 1024) for y in range(0, ONE + 1, 1024)
    }


def test_triangles_that_stay_are_told_from_new_ones(land: Land) -> None:
    net = land.start()
    net.close(6.0, land.under)
    before = net.result()
    net.close(5.0, land.under)
    after = net.result()
    old = np.flatnonzero(~after.fresh)
    assert 0 < len(old) < len(after.triangles)
    corners: tuple[Ints, Ints] = (
        before.used[before.triangles[old]],
        after.used[after.triangles[old]],
    )
    np.testing.assert_array_equal(*corners)


def test_the_same_posts_give_the_same_mesh(land: Land) -> None:
    one, other = land.start(), land.start()
    for net in (one, other):
        net.close(2.0, land.under)
    for a, b in zip(one.result(), other.result(), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("size_m", [100.0, 1e4, 5e5])
def test_heights_along_a_straight_line_sag(size_m: float, rng: np.random.Generator) -> None:
    """Against lengths in extended precision."""
    middle = 6.37e6 * np.array([0.6, 0.48, 0.64])
    away = rng.normal(size=(50, 3))
    away -= np.outer(away @ middle, middle) / (middle @ middle)
    places = middle + size_m * away
    places *= (6.37e6 + rng.uniform(0, size_m / 20, 50))[:, None] / np.linalg.norm(
        places, axis=1, keepdims=True
    )
    points = places - middle
    high_m, f = highs(points, middle), 0.3
    for p, q in zip(range(0, 50, 2), range(1, 50, 2), strict=True):
        sag_m = sag(points, high_m, 2 * 6.37e6, p, q)
        high = (1 - f) * high_m[p] + f * high_m[q] - f * (1 - f) * sag_m
        there = (1 - f) * places[p].astype(np.longdouble) + f * places[q]
        true = np.sqrt((there**2).sum()) - np.sqrt(
            (middle.astype(np.longdouble) ** 2).sum()
        )
        assert abs(high - true) <= 0.02 * sag_m + 1e-6
