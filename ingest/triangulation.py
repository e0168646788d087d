# SPDX-License-Identifier: Apache-2.0
"""A triangulation over a square that is refined, and refined again with more points."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ingest.closing import Under, close
from ingest.delaunay import Ints, Net
from ingest.greedy import ALWAYS, Lists, begin, over, refine
from ingest.removal import UNKNOWN, Holes, lift, settle
from ingest.thinning import thin
from ingest.upright import ground_of, high_of, highs
from tiles.frames import Floats
from tiles.kernels import inlined, kernel

SPARE, MOST_SPARE = 1024, 16_384
"""Points that may be added later: half as many again and so many, or twice as many"""
MOST_POINTS = 262_144
"""Where that is too few, there is room for up to so many"""


class Triangulation:
    """Triangles over a square that are refined, and refined again with more points."""

    def __init__(
        self, at: Ints, flat: Floats, points: Floats, middle: Floats | None = None
    ) -> None:
        """Take places and points as `Net` has them, no two places alike, corners first."""
        room = len(at) + max(len(at) // 2 + SPARE, min(2 * len(at), MOST_SPARE))
        self._size = len(at)
        self._net = Net(
            _roomy(at, room),
            _roomy(flat, room),
            _roomy(points, room),
            np.zeros(room, np.bool_),
            np.zeros(3) if middle is None else middle,
            np.zeros(room),
            np.empty((2 * room, 3), np.int64),
            np.empty(6 * room, np.int64),
        )
        self._net.high_m[: len(at)] = highs(points, self._net.middle)
        self._lists = Lists(
            np.full(2 * room, -1),
            np.full(room, -1),
            np.empty(2 * room, np.int64),
            np.full(2 * room, -1.0),
            np.full(room, np.inf),
            np.empty((2 * room, 3)),
            np.empty((2 * room, 9), np.int64),
            np.ones(2 * room, np.bool_),
            np.ones(2 * room, np.bool_),
        )
        self._lists.after[: len(at) - 1] = np.arange(1, len(at))
        self._losses, self._losses_m = np.zeros(0), -1.0
        self._count = begin(self._net, self._lists, len(at))

    def refine(self, bound_m: float) -> None:
        """Insert worst points until none is above the bound."""
        self._count = refine(self._net, self._lists, self._count, bound_m * bound_m)

    def close(self, bound_m: float, under: Under) -> bool:
        """Do the same between points too, and take out what is not needed then.

        Says whether the bound is kept between points.
        """
        net, lists, middle = self._net, self._lists, self._net.middle
        ground = ground_of(under.posts, under.offset, under.grid, middle)
        parts = net, lists, under, ground, self._count, self._size
        self._count, self._size, kept = close(*parts, bound_m * bound_m)
        self._count = thin(net, lists, ground, self._count, self._size, bound_m)
        return kept

    def refine_wholly(self) -> None:
        """Insert every point."""
        self._count = refine(self._net, self._lists, self._count, -1.0)

    def add(self, at: Ints, flat: Floats, points: Floats, near: Ints | None = None) -> bool:
        """Add points that must become vertices; False when there are too many.

        Parameters
        ----------
        near : (n,) triangles, as `result` lists them, that they probably lie over;
            they are looked for from there
        """
        start = np.zeros(len(at), np.int64) if near is None else near
        new = at, flat, points, start
        self._make_room(len(at))
        self._size, fits = _add(self._net, self._lists, self._size, *new)
        return fits

    def _make_room(self, count: int) -> None:
        """Make room for more points, where there is too little and may be more."""
        old = len(self._net.at)
        if self._size + count <= old or old >= MOST_POINTS:
            return
        room = min(2 * old, MOST_POINTS)
        self._net = Net(*(_grown(one, old, room) for one in self._net))
        self._lists = Lists(*(_grown(one, old, room) for one in self._lists))
        self._losses_m = -1.0

    def lift(self, bound_m: float) -> Holes | None:
        """Take out vertices that no point minds by more than a bound, until `settle`."""
        if bound_m != self._losses_m:
            self._losses, self._losses_m = np.full(len(self._net.at), UNKNOWN), bound_m
        parts = self._net, self._lists, self._count, self._size
        holes = lift(*parts, bound_m * bound_m, self._losses[: self._size])
        return holes if len(holes.vertex) else None

    def settle(
        self, holes: Holes, bad: NDArray[np.bool_]
    ) -> tuple[Ints, NDArray[np.bool_]]:
        """Put back what was in holes with a bad triangle.

        Parameters
        ----------
        bad : (t,) triangles, as `result` lists them

        Returns
        -------
        order : the numbers that the triangles had in that list
        back : (t,) those of the list that were put back
        """
        parts = self._net, self._lists, holes, self._count
        self._count, order, back = settle(*parts, bad)
        return order, back

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


@kernel
def _add(
    net: Net, lists: Lists, size: int, at: Ints, flat: Floats, points: Floats, near: Ints
) -> tuple[int, bool]:
    """Make points the next to be inserted; returns how many there are, and if all fit."""
    if size + len(at) > len(net.at):
        return size, False
    for i in range(len(at)):
        net.at[size], net.flat[size], net.points[size] = at[i], flat[i], points[i]
        net.high_m[size] = high_of(net.points, size, net.middle)
        t = over(net, near[i], size)
        q, is_vertex = lists.head[t], False
        for k in range(3):
            is_vertex = is_vertex or _is_same(net.at, net.corner[t, k], size)
        while q >= 0 and not _is_same(net.at, q, size):
            q = lists.after[q]
        if is_vertex:
            continue
        if q < 0:
            q = size
            lists.after[q] = lists.head[t]
            lists.head[t] = q
            size += 1
        net.must[q] = True
        lists.candidate[t], lists.worst[t] = q, ALWAYS
    return size, True


@inlined
def _is_same(at: Ints, p: int, q: int) -> bool:
    return bool(at[p, 0] == at[q, 0] and at[p, 1] == at[q, 1])


def _roomy(values: NDArray[Any], room: int) -> NDArray[Any]:
    held = np.empty((room, *values.shape[1:]), values.dtype)
    held[: len(values)] = values
    return held


def _grown(values: NDArray[Any], old: int, room: int) -> NDArray[Any]:
    """Give arrays of the points, or of triangles, more room; others stay."""
    if len(values) % old or not len(values):
        return values
    held = np.full((len(values) // old * room, *values.shape[1:]), values[-1], values.dtype)
    held[: len(values)] = values
    return held
