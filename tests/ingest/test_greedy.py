# SPDX-License-Identifier: Apache-2.0
"""Greedy insertion keeps its bound, covers the square once, and is Delaunay."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from ingest.triangulation import Triangles, Triangulation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
ONE = 32768
CORNERS = np.array([(0, 0), (ONE, 0), (ONE, ONE), (0, ONE)])


class Ground(NamedTuple):
    """Places, corners first, and their points, 10 m apart for 1/32 of the square."""

    at: Ints
    points: Floats


def leaning(at: Ints, lean: int = 1) -> Floats:
    """Return the map on which triangles are compact: it leans a little."""
    x, y = at.T / ONE
    return np.stack([x + lean * y / 16, y + lean * x / 16], axis=1)


def mesh(one: Ground, bound_m: float, lean: int = 1) -> Triangles:
    net = Triangulation(one.at, leaning(one.at, lean), one.points)
    net.refine(bound_m)
    return net.result()


def ground(at: Ints, height: Floats) -> Ground:
    """Put the corners first."""
    corner = (at[:, None] == CORNERS).all(axis=-1)
    first = corner.argmax(axis=0)
    order = np.concatenate([first, np.flatnonzero(~corner.any(axis=1))])
    points = np.column_stack([at / (ONE / 320), height])
    return Ground(at[order], points[order])


def lattice(height: Floats) -> Ground:
    """Heights of a square of posts, row 0 south."""
    steps = np.linspace(0, ONE, len(height)).astype(int)
    x, y = np.meshgrid(steps, steps)
    return ground(np.stack([x.ravel(), y.ravel()], axis=1), height.ravel())


def rough(side: int, rng: np.random.Generator) -> Floats:
    y, x = np.mgrid[:side, :side]
    wave = 30 * np.sin(x / 5.0) * np.cos(y / 4.0)
    return np.asarray(wave + rng.normal(size=(side, side)))


def scattered(count: int, rng: np.random.Generator) -> Ground:
    """Random places inside and on all four edges, no lattice."""
    inside = rng.integers(1, ONE, (count, 2))
    along = rng.integers(1, ONE, (4, count // 20))
    zero, one = np.zeros_like(along[0]), np.full_like(along[0], ONE)
    edges = [(along[0], zero), (along[1], one), (zero, along[2]), (one, along[3])]
    rim = np.concatenate([np.stack(edge, axis=1) for edge in edges])
    at = np.unique(np.concatenate([CORNERS, inside, rim]), axis=0)
    x, y = at.T / ONE * 32
    noise = rng.normal(size=len(at))
    return ground(at, 30 * np.sin(x / 5) * np.cos(y / 4) + noise)


def twice_area(corner: Ints) -> Ints:
    a, b, c = np.moveaxis(corner, 1, 0)
    return np.asarray(
        (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1])
        - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    )


def worst_place(one: Ground, used: Ints, triangles: Ints) -> float:
    """Distance of each place from its triangle's plane, on the rim from the same place."""
    at, points = one.at[used], one.points[used]
    worst = np.full(len(one.at), np.inf)
    for triangle in triangles:
        edges = np.stack(
            [at[triangle[1]] - at[triangle[0]], at[triangle[2]] - at[triangle[0]]]
        )
        weights = np.linalg.solve(edges.T, (one.at - at[triangle[0]]).T).T
        weights = np.column_stack([1 - weights.sum(axis=1), weights])
        inside = (weights > -1e-9).all(axis=1)
        off = weights[inside] @ points[triangle] - one.points[inside]
        a, b, c = points[triangle]
        normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
        rim = (one.at[inside] % ONE == 0).any(axis=1)
        gap = np.where(rim, np.linalg.norm(off, axis=1), np.abs(off @ normal))
        worst[inside] = np.minimum(worst[inside], gap)
    return float(worst.max())


@pytest.fixture(params=["lattice", "scattered"])
def land(request: pytest.FixtureRequest, rng: np.random.Generator) -> Ground:
    return lattice(rough(33, rng)) if request.param == "lattice" else scattered(1000, rng)


@pytest.mark.parametrize("bound_m", [0.5, 3.0, 20.0])
def test_every_place_is_within_the_bound(bound_m: float, land: Ground) -> None:
    used, _, _, triangles, *_ = mesh(land, bound_m)
    assert worst_place(land, used, triangles) <= bound_m + 1e-9


def test_triangles_cover_the_square_once_and_turn_left(land: Ground) -> None:
    found = mesh(land, 2.0)
    used, triangles, border = found.used, found.triangles, found.border
    np.testing.assert_array_equal(found.at, land.at[used])
    np.testing.assert_array_equal(found.points, land.points[used])
    at = land.at[used]
    area = twice_area(at[triangles])
    assert (area > 0).all()
    assert area.sum() == 2 * ONE * ONE
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    assert counts.max() == 2
    assert (counts == 1).sum() == len(border)
    rim = at[border]
    assert (((rim == 0) | (rim == ONE)) & (rim[:, :1] == rim[:, 1:])).any(axis=(1, 2)).all()
    # Directed as the triangles are: once round, counter-clockwise.
    x, y = np.moveaxis(rim, 2, 0)
    assert (x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]).sum() == 2 * ONE * ONE


@pytest.mark.parametrize("lean", [1, -1])
def test_across_every_edge_the_angles_are_as_in_a_delaunay_triangulation(
    lean: int, land: Ground
) -> None:
    """Opposite angles add up to 180 degrees at most; the lean may turn each by 7.2."""
    used, _, _, triangles, *_ = mesh(land, 2.0, lean)
    at = land.at[used].astype(float)
    angle = {}
    for triangle in triangles:
        for k in range(3):
            a, b, c = (int(triangle[(k + n) % 3]) for n in range(3))
            one, other = at[a] - at[c], at[b] - at[c]
            cross = one[0] * other[1] - one[1] * other[0]
            angle[a, b] = np.degrees(np.arctan2(cross, one @ other))
    both = [angle[a, b] + angle[b, a] for a, b in angle if (b, a) in angle]
    assert max(both) <= 180 + 2 * 7.2
    assert np.mean(both) < 150


def test_the_corners_are_the_first_vertices(land: Ground) -> None:
    used, _, _, triangles, *_ = mesh(land, 5.0)
    np.testing.assert_array_equal(used[:4], np.arange(4))
    np.testing.assert_array_equal(land.at[used[:4]], CORNERS)
    assert (np.diff(used) > 0).all()
    np.testing.assert_array_equal(np.unique(triangles), np.arange(len(used)))


def parts(one: Ground, chosen: NDArray[np.bool_]) -> tuple[Ground, Ground]:
    """Return those that are chosen, and the rest; the corners are always among the rest."""
    chosen = chosen & (np.arange(len(one.at)) >= 4)
    order = np.flatnonzero(chosen)
    order = order[np.lexsort((one.at[order, 1], one.at[order, 0]))]
    rest = Ground(one.at[~chosen], one.points[~chosen])
    return Ground(one.at[order], one.points[order]), rest


def added(net: Triangulation, more: Ground) -> bool:
    """Add places; the triangles said to be near are any."""
    near = np.arange(len(more.at)) % len(net.result().triangles)
    return net.add(more.at, leaning(more.at), more.points, near)


def test_places_that_are_added_become_vertices(
    land: Ground, rng: np.random.Generator
) -> None:
    more, rest = parts(land, rng.random(len(land.at)) < 0.1)
    net = Triangulation(rest.at, leaning(rest.at), rest.points * [1, 1, 0])
    net.refine(100.0)
    assert len(net.result().used) == 4
    assert added(net, Ground(more.at, more.points * [1, 1, 0]))
    net.refine(100.0)
    found = net.result()
    assert net.size == len(land.at)
    np.testing.assert_array_equal(found.used[4:], np.arange(len(rest.at), net.size))
    np.testing.assert_array_equal(found.at[4:], more.at)
    assert twice_area(found.at[found.triangles]).sum() == 2 * ONE * ONE


def test_a_place_that_was_known_is_added_as_it_was(land: Ground) -> None:
    net = Triangulation(land.at, leaning(land.at), land.points)
    net.refine(1e4)
    known = np.arange(10, 30)
    assert added(net, Ground(land.at[known], land.points[known] + 1e3))
    net.refine(1e4)
    found = net.result()
    assert net.size == len(land.at)
    np.testing.assert_array_equal(found.used[4:], known)
    np.testing.assert_array_equal(found.points, land.points[found.used])


def test_what_is_added_later_does_not_spoil_the_bound(
    land: Ground, rng: np.random.Generator
) -> None:
    more, rest = parts(land, rng.random(len(land.at)) < 0.05)
    net = Triangulation(rest.at, leaning(rest.at), rest.points)
    net.refine(8.0)
    assert added(net, more)
    net.refine(3.0)
    found = net.result()
    both = Ground(*(np.concatenate(pair) for pair in zip(rest, more, strict=True)))
    np.testing.assert_array_equal(both.at[found.used], found.at)
    assert np.isin(np.arange(len(rest.at), len(both.at)), found.used).all()
    assert worst_place(both, found.used, found.triangles) <= 3.0 + 1e-9


def test_more_than_there_is_room_for_is_refused(
    land: Ground, rng: np.random.Generator
) -> None:
    net = Triangulation(land.at, leaning(land.at), land.points)
    many = np.unique(rng.integers(1, ONE, (20_000, 2)), axis=0)
    assert not added(net, Ground(many, np.zeros((len(many), 3))))
    assert net.size == len(land.at)


def test_a_vertex_weighs_what_it_was_off_when_it_was_inserted(land: Ground) -> None:
    net = Triangulation(land.at, leaning(land.at), land.points)
    net.refine(1.0)
    found = net.result()
    assert np.isinf(found.weight_m[:4]).all()
    assert np.isfinite(found.weight_m[4:]).all()
    assert (found.weight_m[4:] > 1.0).all()
    heavy = np.flatnonzero(found.weight_m > 5.0)
    only = Ground(found.at[heavy], found.points[heavy])
    rough_mesh = Triangulation(only.at, leaning(only.at), only.points)
    rough_mesh.refine_wholly()
    triangles = rough_mesh.result().triangles
    assert worst_place(land, found.used[heavy], triangles) < 3 * 5.0


def test_across_an_edge_is_the_other_triangle_with_it(land: Ground) -> None:
    found = mesh(land, 2.0)
    for t, (corners, across) in enumerate(zip(found.triangles, found.across, strict=True)):
        for k, other in enumerate(across):
            edge = {int(corners[k]), int(corners[(k + 1) % 3])}
            with_it = (np.isin(found.triangles, list(edge)).sum(axis=1) == 2).nonzero()[0]
            assert set(with_it.tolist()) == ({t, int(other)} if other >= 0 else {t})


def diagonals(used: Ints, triangles: Ints, side: int) -> set[tuple[int, int]]:
    """Directions (east, north) of all edges that are diagonals of squares of posts."""
    steps = ONE // (side - 1)
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    off = (used[edges[:, 1]] - used[edges[:, 0]]) // steps
    slanted = off[(off != 0).all(axis=1)]
    assert len(slanted) == 2 * (side - 1) ** 2
    return {(int(x), int(y)) if x > 0 else (int(-x), int(-y)) for x, y in slanted}


@pytest.mark.parametrize(("lean", "diagonal"), [(1, (1, -1)), (-1, (1, 1))])
@pytest.mark.parametrize("how", ["wholly", "no error allowed"])
def test_with_every_post_the_diagonals_are_those_that_are_stated(
    lean: int, diagonal: tuple[int, int], how: str, rng: np.random.Generator
) -> None:
    land = lattice(rough(17, rng))
    net = Triangulation(land.at, leaning(land.at, lean), land.points)
    net.refine_wholly() if how == "wholly" else net.refine(0.0)
    found = net.result()
    assert len(found.used) == 17 * 17
    assert len(found.triangles) == 2 * 16 * 16
    assert diagonals(found.at, found.triangles, 17) == {diagonal}


def test_a_flat_square_is_two_triangles() -> None:
    land = lattice(np.zeros((65, 65)))
    used, _, _, triangles, border, *_ = mesh(land, 0.0)
    assert len(triangles) == 2
    assert used.tolist() == [0, 1, 2, 3]
    assert len(border) == 4


def test_corners_alone_are_two_triangles() -> None:
    land = Ground(CORNERS, np.random.default_rng(1).normal(size=(4, 3)))
    used, _, _, triangles, border, *_ = mesh(land, 0.0)
    assert (len(used), len(triangles), len(border)) == (4, 2, 4)


def test_it_needs_fewer_triangles_than_a_uniform_grid_of_the_same_error() -> None:
    y, x = np.mgrid[:65, :65]
    hill = lattice(80 * np.exp(-((x - 20) ** 2 + (y - 40) ** 2) / 60.0))
    index = {tuple(place): n for n, place in enumerate((hill.at // 512).tolist())}
    for step in (16, 8, 4, 2):
        chosen = range(0, 65, step)
        grid = np.array([index[x, y] for y in chosen for x in chosen])
        at = np.arange(len(grid)).reshape(len(chosen), -1)
        sw, se, nw, ne = at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]
        lower = np.stack([sw, se, ne], axis=-1).reshape(-1, 3)
        upper = np.stack([sw, ne, nw], axis=-1).reshape(-1, 3)
        uniform = np.concatenate([lower, upper])
        error = worst_place(hill, grid, uniform)
        assert len(mesh(hill, error).triangles) < 0.7 * len(uniform)
