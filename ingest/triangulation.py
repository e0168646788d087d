# SPDX-License-Identifier: Apache-2.0
"""A triangulation over a square that is refined, and refined again with more points."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.delaunay import Ints, Net
from ingest.greedy import ALWAYS, CORNERS, Lists, begin, place, refine
from tiles.frames import Floats
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
        )
        self._lists.after[: len(at) - 1] = np.arange(1, len(at))
        self._count = begin(self._net, self._lists, len(at))

    def refine(self, bound_m: float) -> None:
        """Insert worst points until none is above the bound."""
        self._count = refine(self._net, self._lists, self._count, bound_m * bound_m)

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
        first = np.unique(_key(at), return_index=True)[1]
        known = _key(self._net.at[: self._size])
        order = np.argsort(known)
        found = np.searchsorted(known, _key(at[first]), sorter=order)
        same = order[np.minimum(found, self._size - 1)]
        old = known[same] == _key(at[first])
        fresh, end = first[~old], self._size + int((~old).sum())
        if end > len(self._net.at):
            return False
        for held, more in zip(self._net[:3], (at, flat, points), strict=True):
            held[self._size : end] = more[fresh]
        ids = np.concatenate([same[old], np.arange(self._size, end)])
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
        corner = self._net.corner[: self._count]
        used, triangles = np.unique(corner, return_inverse=True)
        triangles = triangles.reshape(-1, 3).astype(np.int64)
        opposite = self._net.opposite[: 3 * self._count].reshape(-1, 3)
        t, edge = np.nonzero(opposite < 0)
        border = np.stack([triangles[t, edge], triangles[t, (edge + 1) % 3]], axis=1)
        must = np.where(self._net.must[used], ALWAYS, 0.0)
        weight_m = np.sqrt(np.maximum(self._lists.weight[used] - must, 0.0))
        at, points = self._net.at[used], self._net.points[used]
        return Triangles(used, at, points, triangles, border, opposite // 3, weight_m)


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


def _roomy(values: NDArray[Any], room: int) -> NDArray[Any]:
    held = np.zeros((room, *values.shape[1:]), values.dtype)
    held[: len(values)] = values
    return held


def _key(at: Ints) -> Ints:
    return at[:, 0] * (2 * UV_ONE) + at[:, 1]
