# SPDX-License-Identifier: Apache-2.0
"""Greedy insertion: the fewest triangles within an error, judged in ECEF.

Starting from two triangles, the point that is worst represented is inserted and the
triangulation made Delaunay again, until no point is further than the bound from its
triangle: measured straight up, or to the triangle's plane. A point on the rim is compared
with the point of the rim that has its longitude and latitude. All in ECEF, so that the
planet's curvature counts. Every triangle keeps a list of the points over it, so that an
insertion looks only at those around it.

References
----------
Garland and Heckbert 1995, Fast Polygonal Approximation of Terrains and Height Fields
(CMU-CS-95-181), algorithm III.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import inlined, kernel
from tiles.mesh import UV_ONE

Ints = NDArray[np.int64]


class Net(NamedTuple):
    """A triangulation while it grows."""

    at: Ints
    """(n, 2) places of the points, 0..UV_ONE"""
    flat: Floats
    """(n, 2) the same on a map where triangles are to be compact"""
    points: Floats
    """(n, 3) m"""
    must: NDArray[np.bool_]
    """(n,) points that become vertices however near their triangles are"""
    middle: Floats
    """(3,) m from the earth's centre to the points' origin; 0 to measure to planes"""
    corner: Ints
    """(m, 3) points of every triangle, counter-clockwise"""
    opposite: Ints
    """(3 m,) the half-edge across from each, -1 on the rim"""


class Lists(NamedTuple):
    """Which points lie over each triangle."""

    head: Ints
    """(m,) first point, -1 for none"""
    after: Ints
    """(n,) next point of the same triangle"""
    candidate: Ints
    """(m,) the worst of them"""
    worst: Floats
    """(m,) its squared distance, -1 for none"""
    weight: Floats
    """(n,) squared distance of each vertex when it was inserted"""
    normals: Floats
    """(m, 3) room for unit normals"""


ALWAYS = 1e12
"""Added to the squared distance of points that must be vertices, m2"""
CHUNK = 64
"""Triangles whose largest error is kept together, so that few are looked at again."""
CORNERS = 4
"""The first points are the square's corners, south-west first, counter-clockwise."""
MOST_TRIANGLES = 120_000
"""More would have more vertices than 16 bits can name."""
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
        self._count = _begin(self._net, self._lists, len(at))

    def refine(self, bound_m: float) -> None:
        """Insert worst points until none is above the bound."""
        self._count = _refine(self._net, self._lists, self._count, bound_m * bound_m)

    def refine_wholly(self) -> None:
        """Insert every point."""
        self._count = _refine(self._net, self._lists, self._count, -1.0)

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
        place = np.searchsorted(known, _key(at[first]), sorter=order)
        same = order[np.minimum(place, self._size - 1)]
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
        _place(self._net, self._lists, ids[todo], self._size, start[todo])
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


@kernel
def _set(
    net: Net,
    t: int,
    points: tuple[int, int, int],
    across: tuple[int, int, int],
) -> None:
    """Write triangle t and tell the half-edges across from it."""
    for k in range(3):
        net.corner[t, k] = points[k]
        net.opposite[3 * t + k] = across[k]
        if across[k] >= 0:
            net.opposite[across[k]] = 3 * t + k


@inlined
def _turn(at: Ints, a: int, b: int, p: int) -> int:
    """Twice the signed area of places a, b, p; positive when counter-clockwise."""
    x, y = at[a, 0], at[a, 1]
    return int((at[b, 0] - x) * (at[p, 1] - y) - (at[b, 1] - y) * (at[p, 0] - x))


@inlined
def _in_circle(flat: Floats, a: int, b: int, c: int, p: int) -> bool:
    """Say whether p lies clearly inside the circle through counter-clockwise a, b, c."""
    px, py = flat[p, 0], flat[p, 1]
    ax, ay = flat[a, 0] - px, flat[a, 1] - py
    bx, by = flat[b, 0] - px, flat[b, 1] - py
    cx, cy = flat[c, 0] - px, flat[c, 1] - py
    aa, bb, cc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    det = ax * (by * cc - bb * cy) - ay * (bx * cc - bb * cx) + aa * (bx * cy - by * cx)
    return bool(det > 1e-12 * (aa + bb + cc) ** 2)


@kernel
def _legalise(net: Net, stack: Ints, depth: int, star: Ints, size: int) -> int:
    """Flip edges until every stacked half-edge is Delaunay again.

    Every triangle that changes joins the star of the new point; returns its size.
    """
    corner, opposite = net.corner, net.opposite
    while depth > 0:
        depth -= 1
        a = stack[depth]
        b = opposite[a]
        if b < 0:
            continue
        ta, ka, tb, kb = a // 3, a % 3, b // 3, b % 3
        right, left = corner[ta, ka], corner[ta, (ka + 1) % 3]
        top, far = corner[ta, (ka + 2) % 3], corner[tb, (kb + 2) % 3]
        if not _in_circle(net.flat, right, left, top, far):
            continue
        # What is round on the ground may be bent inwards here.
        if _turn(net.at, top, right, far) <= 0 or _turn(net.at, far, left, top) <= 0:
            continue
        a1, a2 = opposite[3 * ta + (ka + 1) % 3], opposite[3 * ta + (ka + 2) % 3]
        b1, b2 = opposite[3 * tb + (kb + 1) % 3], opposite[3 * tb + (kb + 2) % 3]
        _set(net, ta, (top, right, far), (a2, b1, -1))
        _set(net, tb, (far, left, top), (b2, a1, 3 * ta + 2))
        star[size] = tb
        size += 1
        stack[depth] = 3 * ta + 1
        stack[depth + 1] = 3 * tb
        depth += 2
    return size


@kernel
def _split_face(net: Net, count: int, t: int, p: int) -> int:
    """Put p into the inside of triangle t; returns the new count of triangles."""
    opposite = net.opposite
    a, b, c = net.corner[t]
    h0, h1, h2 = opposite[3 * t], opposite[3 * t + 1], opposite[3 * t + 2]
    u, v = count, count + 1
    _set(net, t, (a, b, p), (h0, -1, -1))
    _set(net, u, (b, c, p), (h1, -1, 3 * t + 1))
    _set(net, v, (c, a, p), (h2, 3 * t + 2, 3 * u + 1))
    return count + 2


@kernel
def _split_edge(net: Net, count: int, e: int, p: int) -> int:
    """Put p on half-edge e of its triangle and of the one across; returns the new count."""
    corner, opposite = net.corner, net.opposite
    t, k, f = e // 3, e % 3, opposite[e]
    a, b, c = corner[t, k], corner[t, (k + 1) % 3], corner[t, (k + 2) % 3]
    bc, ca = opposite[3 * t + (k + 1) % 3], opposite[3 * t + (k + 2) % 3]
    u = count
    if f < 0:
        _set(net, t, (a, p, c), (-1, -1, ca))
        _set(net, u, (p, b, c), (-1, bc, 3 * t + 1))
        return count + 1
    s, m, v = f // 3, f % 3, count + 1
    d = corner[s, (m + 2) % 3]
    ad, db = opposite[3 * s + (m + 1) % 3], opposite[3 * s + (m + 2) % 3]
    _set(net, t, (a, p, c), (-1, -1, ca))
    _set(net, u, (p, b, c), (-1, bc, 3 * t + 1))
    _set(net, s, (b, p, d), (3 * u, -1, db))
    _set(net, v, (p, a, d), (3 * t, ad, 3 * s + 1))
    return count + 2


@kernel
def _insert(
    net: Net, count: int, t: int, p: int, stack: Ints, star: Ints
) -> tuple[int, int]:
    """Put p into triangle t; returns the count of triangles and the size of p's star."""
    at, corner, opposite = net.at, net.corner, net.opposite
    edge = -1
    for k in range(3):
        if _turn(at, corner[t, k], corner[t, (k + 1) % 3], p) == 0:
            edge = 3 * t + k
    before, size = count, 1
    star[0] = t
    if edge >= 0:
        if opposite[edge] >= 0:
            star[1], size = opposite[edge] // 3, 2
        count = _split_edge(net, count, edge, p)
    else:
        count = _split_face(net, count, t, p)
    for s in range(before, count):
        star[size] = s
        size += 1
    for n in range(size):
        for k in range(3):
            if corner[star[n], (k + 2) % 3] == p:
                stack[n] = 3 * star[n] + k
    return count, _legalise(net, stack, size, star, size)


@kernel
def _slopes(net: Net, star: Ints, size: int, normals: Floats) -> None:
    """Write what a difference is multiplied by to give the distance from a triangle."""
    points, middle = net.points, net.middle
    upright = middle[0] != 0.0 or middle[1] != 0.0 or middle[2] != 0.0
    for n in range(size):
        a, b, c = net.corner[star[n]]
        x, y, z = points[a]
        ux, uy, uz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
        vx, vy, vz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(x * x + y * y + z * z)
        if upright:
            px, py, pz = middle[0] + points[a, 0], middle[1] + points[a, 1], middle[2]
            pz += points[a, 2]
            length = (x * px + y * py + z * pz) / np.sqrt(px * px + py * py + pz * pz)
        length = max(length, 1e-12)
        normals[n, 0], normals[n, 1], normals[n, 2] = x / length, y / length, z / length


@inlined
def _off(points: Floats, normals: Floats, n: int, a: int, q: int) -> float:
    """Squared distance of a point from the plane of a star's triangle."""
    off = normals[n, 0] * (points[q, 0] - points[a, 0])
    off += normals[n, 1] * (points[q, 1] - points[a, 1])
    off += normals[n, 2] * (points[q, 2] - points[a, 2])
    return float(off * off)


@kernel
def _off_rim(net: Net, t: int, q: int) -> float:
    """Squared distance of a point on the rim from the triangle at the same place."""
    points = net.points
    a, b, c = net.corner[t]
    w0, w1 = _turn(net.at, b, c, q), _turn(net.at, c, a, q)
    w2, squared = _turn(net.at, a, b, q), 0.0
    for k in range(3):
        there = w0 * points[a, k] + w1 * points[b, k] + w2 * points[c, k]
        squared += (there / (w0 + w1 + w2) - points[q, k]) ** 2
    return float(squared)


@kernel
def _assign(net: Net, lists: Lists, orphans: int, star: Ints, size: int) -> None:
    """Give every orphan to the triangle of a star that it lies over; note the worst."""
    at, corner, points = net.at, net.corner, net.points
    head, after, candidate, worst = lists.head, lists.after, lists.candidate, lists.worst
    normals = lists.normals
    _slopes(net, star, size, normals)
    for n in range(size):
        t = star[n]
        head[t], candidate[t], worst[t] = -1, -1, -1.0
    while orphans >= 0:
        q = orphans
        orphans = after[q]
        for n in range(size):
            t = star[n]
            a, b, c = corner[t]
            if q in (a, b, c):
                break
            w2, w0, w1 = _turn(at, a, b, q), _turn(at, b, c, q), _turn(at, c, a, q)
            if w0 < 0 or w1 < 0 or w2 < 0:
                continue
            after[q] = head[t]
            head[t] = q
            if at[q, 0] % UV_ONE == 0 or at[q, 1] % UV_ONE == 0:
                squared = _off_rim(net, t, q)
            else:
                squared = _off(points, normals, n, a, q)
            if net.must[q]:
                squared += ALWAYS
            if squared > worst[t]:
                worst[t], candidate[t] = squared, q
            break


@kernel
def _orphaned(head: Ints, after: Ints, star: Ints, size: int) -> int:
    """Join the lists of a star's triangles to one; returns its first point."""
    first = -1
    for n in range(size):
        q = head[star[n]]
        head[star[n]] = -1
        while q >= 0:
            following = after[q]
            after[q] = first
            first, q = q, following
    return first


@kernel
def _begin(net: Net, lists: Lists, points: int) -> int:
    """Make the first two triangles and give all points to them; returns their count."""
    _set(net, 0, (0, 1, 2), (-1, -1, -1))
    _set(net, 1, (0, 2, 3), (2, -1, -1))
    star = np.arange(2)
    _assign(net, lists, CORNERS if points > CORNERS else -1, star, 2)
    return 2


@kernel
def _over(net: Net, t: int, q: int) -> int:
    """Walk from triangle t to the one that q lies over."""
    at, corner, opposite = net.at, net.corner, net.opposite
    k = 0
    while k < 3:
        across = opposite[3 * t + k]
        if across >= 0 and _turn(at, corner[t, k], corner[t, (k + 1) % 3], q) < 0:
            t, k = across // 3, 0
        else:
            k += 1
    return t


@kernel
def _place(net: Net, lists: Lists, ids: Ints, size: int, near: Ints) -> None:
    """Find the triangles of points that must be inserted; those from `size` are new."""
    for i in range(len(ids)):
        q, t = ids[i], _over(net, near[i], ids[i])
        if q >= size:
            lists.after[q] = lists.head[t]
            lists.head[t] = q
        lists.candidate[t], lists.worst[t] = q, ALWAYS


@kernel
def _refine(net: Net, lists: Lists, count: int, bound: float) -> int:
    """Insert worst points until none is above the bound; returns the count of triangles."""
    capacity, worst = len(net.corner), lists.worst
    star, stack = np.zeros(capacity, np.int64), np.zeros(3 * capacity + 8, np.int64)
    peak = np.zeros((capacity + CHUNK - 1) // CHUNK)
    for chunk in range(len(peak)):
        peak[chunk] = worst[chunk * CHUNK : (chunk + 1) * CHUNK].max()
    while True:
        chunk = int(np.argmax(peak[: (count + CHUNK - 1) // CHUNK]))
        t = chunk * CHUNK + int(np.argmax(worst[chunk * CHUNK : (chunk + 1) * CHUNK]))
        if worst[t] <= bound or lists.candidate[t] < 0 or count > MOST_TRIANGLES:
            return count
        p = lists.candidate[t]
        lists.weight[p] = worst[t]
        count, size = _insert(net, count, t, p, stack, star)
        _assign(net, lists, _orphaned(lists.head, lists.after, star, size), star, size)
        for n in range(size):
            chunk = star[n] // CHUNK
            peak[chunk] = worst[chunk * CHUNK : (chunk + 1) * CHUNK].max()
