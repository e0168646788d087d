# SPDX-License-Identifier: Apache-2.0
"""A walk to the triangle under a point ends also where triangles are not Delaunay."""

import numpy as np
from numpy.typing import NDArray

from ingest.delaunay import Net
from ingest.greedy import over

Ints = NDArray[np.int64]
SPOKES, RADIUS = 6, 10_000


def pinwheel() -> Net:
    """Triangles around a middle, twisted so that from each the next one seems nearer.

    The first edge of each leads on around the middle.
    """
    turns = np.arange(SPOKES) * 2 * np.pi / SPOKES
    inner = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    outer = 2 * np.stack([np.cos(turns + 1.2), np.sin(turns + 1.2)], axis=1)
    at = np.rint(RADIUS * np.concatenate([[(0, 0)], inner, outer])).astype(np.int64)
    corner = []
    for i in range(SPOKES):
        a, b = 1 + i, 1 + (i + 1) % SPOKES
        c, d = a + SPOKES, b + SPOKES
        corner += [(0, a, b), (c, b, a), (d, b, c)]
    corners = np.array(corner)
    edges = {}
    for t, ids in enumerate(corners.tolist()):
        edges |= {(ids[k], ids[(k + 1) % 3]): 3 * t + k for k in range(3)}
    opposite = [
        edges.get((ids[(k + 1) % 3], ids[k]), -1)
        for ids in corners.tolist()
        for k in (0, 1, 2)
    ]
    none, flags = np.zeros((0, 3)), np.zeros(0, np.bool_)
    parts = none[:, :2], none, flags, np.zeros(3), np.zeros(0)
    return Net(at, *parts, corners, np.array(opposite))


def turn(a: Ints, b: Ints, p: Ints) -> int:
    (x, y), (v, w) = (b - a).tolist(), (p - a).tolist()
    return int(x * w - y * v)


def edges_past(net: Net, t: int, p: int) -> list[int]:
    """Return the triangles across those edges of one that a point lies beyond, in order."""
    at = net.at[net.corner[t]]
    past = [turn(at[k], at[(k + 1) % 3], net.at[p]) < 0 for k in range(3)]
    return [int(net.opposite[3 * t + k]) // 3 for k in range(3) if past[k]]


def test_trying_edges_in_order_goes_round_in_circles_here() -> None:
    net, t, seen = pinwheel(), 1, set[int]()
    while (across := edges_past(net, t, 0)) and t not in seen:
        seen.add(t)
        t = across[0]
    assert across
    assert len(seen) == 2 * SPOKES


def test_a_walk_finds_the_triangle_under_a_point_from_everywhere() -> None:
    net = pinwheel()
    for start in range(len(net.corner)):
        assert edges_past(net, over(net, start, 0), 0) == []
