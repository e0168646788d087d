# SPDX-License-Identifier: Apache-2.0
"""Vertices that are not needed go, the others stay, and the mesh stays whole."""

import numpy as np
import pytest

from ingest.removal import Holes
from ingest.triangulation import Triangles, Triangulation
from tests.ingest.test_greedy import (
    ONE,
    Ground,
    lattice,
    leaning,
    rough,
    scattered,
    twice_area,
    worst_place,
)

BOUND_M = 3.0


@pytest.fixture(params=["lattice", "scattered"])
def land(request: pytest.FixtureRequest, rng: np.random.Generator) -> Ground:
    return lattice(rough(33, rng)) if request.param == "lattice" else scattered(1000, rng)


def begun(land: Ground) -> Triangulation:
    """Return a mesh within the bound, looked at once."""
    net = Triangulation(land.at, leaning(land.at), land.points)
    net.refine(BOUND_M)
    return net


def lifted(net: Triangulation) -> tuple[Holes, Triangles]:
    holes = net.lift(BOUND_M)
    assert holes is not None
    return holes, net.result()


def thinned(net: Triangulation) -> Triangles:
    """Take out all that can go."""
    net.result()
    while holes := net.lift(BOUND_M):
        none = np.zeros(len(net.result().triangles), np.bool_)
        assert len(holes.vertex) > 0
        net.settle(holes, none)
    return net.result()


def corners(found: Triangles) -> set[tuple[tuple[int, ...], ...]]:
    """Return triangles by the places of their corners, the least first."""
    turned = found.at[found.triangles]
    key = turned[..., 0] * 2 * ONE + turned[..., 1]
    first = key.argmin(axis=1)
    order = (first[:, None] + np.arange(3)) % 3
    return {
        tuple(map(tuple, one))
        for one in np.take_along_axis(turned, order[..., None], axis=1).tolist()
    }


def is_whole(found: Triangles) -> bool:
    """Say whether triangles turn left, cover the square, and meet edge to edge."""
    area = twice_area(found.at[found.triangles])
    edges = found.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ways, counts = np.unique(edges, axis=0, return_counts=True)
    back = set(map(tuple, ways[:, ::-1].tolist()))
    alone = set(map(tuple, ways.tolist())) - back
    rim = set(map(tuple, found.border.tolist()))
    covers = bool((area > 0).all()) and int(area.sum()) == 2 * ONE * ONE
    return covers and bool((counts == 1).all()) and alone == rim


def test_fewer_triangles_keep_the_bound_at_every_place(land: Ground) -> None:
    net = begun(land)
    before = net.result()
    after = thinned(net)
    assert len(after.triangles) < 0.97 * len(before.triangles)
    assert worst_place(land, after.used, after.triangles) <= BOUND_M + 1e-9
    assert is_whole(after)
    # The rim and the corners are no one's to take.
    assert (before.at % ONE == 0).any(axis=1).sum() == (after.at % ONE == 0).any(
        axis=1
    ).sum()


def test_every_hole_that_is_not_good_enough_is_as_it_was(land: Ground) -> None:
    net = begun(land)
    before = net.result()
    holes, trial = lifted(net)
    order, back = net.settle(holes, np.ones(len(trial.triangles), np.bool_))
    after = net.result()
    np.testing.assert_array_equal(order, np.arange(len(before.triangles)))
    assert back.sum() == holes.size.sum()
    assert corners(after) == corners(before)
    assert not after.fresh.any()


def test_holes_are_judged_one_by_one_and_triangles_keep_track(
    land: Ground, rng: np.random.Generator
) -> None:
    net = begun(land)
    before = net.result()
    holes, trial = lifted(net)
    refused = rng.random(len(holes.vertex)) < 0.5
    bad = np.zeros(len(trial.triangles), np.bool_)
    # One bad triangle is enough.
    bad[holes.star[refused, 0]] = True
    order, back = net.settle(holes, bad)
    after = net.result()
    assert is_whole(after)
    assert len(after.triangles) == len(before.triangles) - 2 * int((~refused).sum())
    gone = holes.vertex[~refused]
    assert not np.isin(gone, after.used).any()
    assert np.isin(holes.vertex[refused], after.used).all()
    assert set(np.flatnonzero(back)) == {
        t for h in np.flatnonzero(refused) for t in holes.star[h, : holes.size[h]]
    }
    for now, number in enumerate(order.tolist()):
        source = before if back[number] else trial
        mine = set(map(tuple, source.at[source.triangles[number]].tolist()))
        assert set(map(tuple, after.at[after.triangles[now]].tolist())) == mine


def test_no_two_holes_touch_along_an_edge(land: Ground) -> None:
    net = begun(land)
    before = net.result()
    holes, _ = lifted(net)
    owner = np.full(len(before.triangles), -1)
    for h, size in enumerate(holes.size):
        assert (owner[holes.star[h, :size]] == -1).all()
        owner[holes.star[h, :size]] = h
    mine = owner[:, None]
    beside = np.where(before.across >= 0, owner[before.across], -1)
    assert ((beside == mine) | (beside == -1) | (mine == -1)).all()


def test_what_nobody_has_measured_is_left_alone(land: Ground) -> None:
    net = begun(land)
    assert net.lift(BOUND_M) is None
    net.result()
    assert net.lift(BOUND_M) is not None


def test_a_thinned_mesh_is_refined_on(land: Ground) -> None:
    """Places taken out are looked at again, and those added become vertices."""
    net = begun(land)
    thinned(net)
    place = np.array([(ONE // 3, ONE // 5)])
    added = net.add(place, leaning(place), np.array([[107.0, 64.0, 500.0]]))
    net.refine(0.5 * BOUND_M)
    found = net.result()
    assert added
    assert (found.at == place).all(axis=1).any()
    assert is_whole(found)
    every = Ground(
        np.concatenate([land.at, place]), np.concatenate([land.points, [[107, 64, 500]]])
    )
    assert worst_place(every, found.used, found.triangles) <= 0.5 * BOUND_M + 1e-9
