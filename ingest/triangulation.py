# SPDX-License-Identifier: Apache-2.0
"""A triangulation over a square that is refined, and refined again with more points."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.closing import Under, close
from ingest.delaunay import Ints, Net
from ingest.greedy import ALWAYS, CORNERS, Lists, begin, place, refine
from tiles.frames import Floats
from tiles.kernels import kernel
from tiles.mesh import UV_ONE

SPARE = 1024
"""Points that may be added later, besides half as many again"""


class Triangulation:
    """Triangles over a square that are refined, and refined again with more points."""

    def __init__(
        self, at: Ints, flat: Floats, points: Floats, middle: Floats | None = None
    ) -> None:
        """Take places and points as `Net` has them, no two places alike, corners first."""
        room = len(at) + len(at) // 2 + SPARE
        self._size = len(at)
        self._net = Net(
            _roomy(at, room),
            _roomy(flat, room),
            _roomy(points, room),
            np.zeros(room, np.bool_),
            np.zeros(3) if middle is None else middle,
            np.zeros((2 * room, 3), np.int64),
            np.full(6 * room, -1, np.int64),
        )
        self._lists = Lists(
            np.full(2 * room, -1),
            np.full(room, -1),
            np.full(2 * room, -1),
            np.full(2 * room, -1.0),
            np.full(room, np.inf),
            np.empty((2 * room, 3)),
            np.ones(2 * room, np.bool_),
            np.ones(2 * room, np.bool_),
        )
        self._lists.after[: len(at) - 1] = np.arange(1, len(at))
        self._ids = self._keys = np.zeros(0, np.int64)
        self._count = begin(self._net, self._lists, len(at))

    def refine(self, bound_m: float) -> None:
        """Insert worst points until none is above the bound."""
        self._count = refine(self._net, self._lists, self._count, bound_m * bound_m)

    def close(self, bound_m: float, under: Under) -> bool:
        """Do the same between points too; says whether the bound is kept there."""
        parts = self._net, self._lists, under, self._count, self._size
        self._count, self._size, kept = close(*parts, bound_m * bound_m)
        return kept

    def refine_wholly(self) -> None:
        """Insert every point."""
        self._count = refine(self._net, self._lists, self._count, -1.0)

    def add(self, at: Ints, flat: Floats, points: Floats, near: Ints | None = None) -> bool:
        """Add points that must become vertices; False when there is no room left.

        Parameters
        ----------
        near : (n,) triangles, as `result` lists them, that they probably lie over;
            they are looked for from there
        """
        if len(self._ids) != self._size:
            known = _key(self._net.at[: self._size])
            self._ids = np.argsort(known)
            self._keys = known[self._ids]
        keys, first = np.unique(_key(at), return_index=True)
        place_of = np.searchsorted(self._keys, keys)
        same = self._ids[np.minimum(place_of, self._size - 1)]
        old = _key(self._net.at[same]) == keys
        fresh, end = first[~old], self._size + int((~old).sum())
        if end > len(self._net.at):
            return False
        for held, more in zip(self._net[:3], (at, flat, points), strict=True):
            held[self._size : end] = more[fresh]
        new = np.arange(self._size, end)
        self._keys = np.insert(self._keys, place_of[~old], keys[~old])
        self._ids = np.insert(self._ids, place_of[~old], new)
        ids = np.concatenate([same[old], new])
        start = np.zeros(len(at), np.int64) if near is None else near
        start = start[np.concatenate([first[old], fresh])]
        todo = np.isinf(self._lists.weight[ids]) & (ids >= CORNERS)
        self._net.must[ids[todo]] = True
        place(self._net, self._lists, ids[todo], self._size, start[todo])
        self._size = end
        return True

    @property
    def size(self) -> int:
        """Return the number of points, vertices or not."""
        return self._size

    def result(self) -> "Triangles":
        """Return the triangles as they are now."""
        net, lists, count = self._net, self._lists, self._count
        used, triangles, border = _numbered(net.corner, net.opposite, count, self._size)
        must = np.where(net.must[used], ALWAYS, 0.0)
        weight_m = np.sqrt(np.maximum(lists.weight[used] - must, 0.0))
        fresh = lists.fresh[:count].copy()
        lists.fresh[:count] = False
        across = net.opposite[: 3 * count].reshape(-1, 3) // 3
        return Triangles(
            used, net.at[used], net.points[used], triangles, border, across, weight_m, fresh
        )


@kernel
def _numbered(corner: Ints, opposite: Ints, count: int, size: int) -> tuple[Ints, ...]:
    """Return the points that are vertices, the triangles and the rim's edges by them."""
    number = np.full(size, -1)
    for t in range(count):
        for k in range(3):
            number[corner[t, k]] = 0
    used = np.flatnonzero(number == 0)
    for i in range(len(used)):
        number[used[i]] = i
    triangles, border = np.empty((count, 3), np.int64), np.empty((3 * count, 2), np.int64)
    edges = 0
    for t in range(count):
        for k in range(3):
            triangles[t, k] = number[corner[t, k]]
            if opposite[3 * t + k] < 0:
                border[edges, 0] = number[corner[t, k]]
                border[edges, 1] = number[corner[t, (k + 1) % 3]]
                edges += 1
    return used, triangles, border[:edges].copy()


class Triangles(NamedTuple):
    """What a triangulation has come to."""

    used: Ints
    """(v,) the points that are vertices, as they were given and added"""
    at: Ints
    """(v, 2) their places"""
    points: Floats
    """(v, 3) m"""
    triangles: Ints
    """(t, 3) vertices, counter-clockwise with x east and y north"""
    border: Ints
    """(b, 2) vertices: the directed edges on the square's rim"""
    across: Ints
    """(t, 3) the triangle across from the edge of corners k and k + 1, -1 on the rim"""
    weight_m: Floats
    """(v,) how far each vertex was from the surface when it was inserted"""
    fresh: NDArray[np.bool_]
    """(t,) triangles that are not the same as in the result before"""


def _roomy(values: NDArray[Any], room: int) -> NDArray[Any]:
    held = np.zeros((room, *values.shape[1:]), values.dtype)
    held[: len(values)] = values
    return held


def _key(at: Ints) -> Ints:
    return at[:, 0] * (2 * UV_ONE) + at[:, 1]
