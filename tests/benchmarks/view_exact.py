# SPDX-License-Identifier: Apache-2.0
"""One greedy mesh of all that a view sees of a region: what drawn triangles count against.

Divided by its depth (an affine function of the ground), a point keeps its lines and
planes, and a distance along the vertical becomes one in pixels. So plain insertion judges
all posts by what this view makes of them, each at its own depth. The whole numbers by
which it finds what lies under what are the view's too: between the ends of an edge that
leads away, heights over depths change otherwise than along the ground.

Insertion looks at posts. Between them, where an edge of the mesh crosses a line between
posts, it may be further off: piecewise linear surfaces differ most there, at a post or at
a vertex. `Meshed.close` goes on until those places keep the threshold too.
"""

from typing import NamedTuple

import numpy as np
from matplotlib import tri
from numpy.typing import NDArray

from geopage.view import ViewState
from ingest.boxes import window_in
from ingest.terrain_mesh import CORNERS, LEAN, Places, snapped
from ingest.triangulation import Triangulation
from ingest.truth import Truth, points_at
from tests.ingest.rasters import Floats
from tiles.mesh import UV_ONE

FAR_UP = np.array([0.0, 0.0, 1e15])
"""The earth's centre of a flat earth: measure along the third axis"""
STEPS = 1 << 21
"""of places in the picture, as whole numbers: fine enough for posts that are far away"""
ROUNDS = 16
RIM = 1.5
"""Posts from the region's rim within which nothing is measured: none hold it outside"""
NEAR = 0.02
"""Columns or rows within which a place is a post's: those are rounded"""
FAMILIES = (1, 0), (0, 1), (1, -1)
"""Lines between posts, by columns and rows: these differ from line to line by one"""
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Ground(NamedTuple):
    """The posts of a region, and their triangles."""

    region: int
    places: Places
    """posts and the region's corners"""
    truths: list[Truth]
    lattice: Floats
    """(2, 3) columns and rows of the source as 1, east and north"""

    def surface(self, uv: Floats) -> Floats:
        """Return the points (n, 3) of the posts' triangles at fractions of the region."""
        points = np.full((len(uv), 3), np.nan)
        for truth in self.truths:
            u, v, size = window_in(self.region, truth.cell)
            there = (uv - (u, v)) / size
            mine = ((there >= 0) & (there <= 1)).all(axis=1)
            points[mine] = points_at(truth, there[mine]) + truth.centre
        return points

    def is_inside(self, uv: Floats) -> Bools:
        """Say which places are not beside the rim."""
        rim = RIM / np.abs(self.lattice[:, 1:]).max(axis=1)
        return np.asarray(((uv > rim) & (uv < 1 - rim)).all(axis=1))


class Exact(NamedTuple):
    """What became of a view's mesh."""

    triangles: int
    """in the picture, at least in part"""
    breach: float
    """largest error in the picture, at posts and crossings, by the threshold"""


class Frame:
    """What a view makes of points of a region."""

    def __init__(self, posts: Floats, view: ViewState) -> None:
        self._middle = posts[:4].mean(axis=0)
        up = self._middle / np.linalg.norm(self._middle)
        east = np.cross([0, 0, 1.0], up) / np.linalg.norm(np.cross([0, 0, 1.0], up))
        self._axes = np.stack([east, np.cross(up, east), up], axis=1)
        self._level_m = float(np.median((posts - self._middle) @ up))
        self._view = view
        shown = self.px(posts[in_picture(posts, view)])
        self._steps = STEPS / float(np.abs(shown[:, :2]).max())

    def px(self, points: Floats) -> Floats:
        """Return points, (n, 3), by their depths: two ways along the ground, and up."""
        local = (points - self._middle) @ self._axes
        ground = points - (local[:, 2:] - self._level_m) * self._axes[:, 2]
        depth_m = (ground - self._view.eye) @ self._view.forward
        assert (depth_m > 0).all()
        return np.ascontiguousarray(local * (self._view.focal_px / depth_m)[:, None])

    def at(self, px: Floats) -> Ints:
        """Return whole numbers, (n, 2), odd ones: insertion takes none for a rim's."""
        return 2 * np.rint(px[:, :2] * self._steps).astype(np.int64) + 1

    def flat(self, points: Floats) -> Floats:
        """Return where points are on a map on which triangles are to be compact, (n, 2)."""
        local = (points - self._middle) @ self._axes[:, :2]
        return np.ascontiguousarray(local + LEAN * local[:, ::-1])


class Meshed:
    """A view's greedy mesh of a region."""

    def __init__(self, ground: Ground, view: ViewState, tau_px: float) -> None:
        """Insert posts until all that the view shows are within a threshold."""
        points = ground.places.points
        self._ground, self._view, self._tau_px = ground, view, tau_px
        self._frame = Frame(points, view)
        seen = in_picture(points, view)
        seen[: len(CORNERS)] = True
        self._uv, self._points = ground.places.at[seen] / UV_ONE, points[seen]
        px, flat = self._frame.px(self._points), self._frame.flat(self._points)
        self._posts = len(px)
        self._at = self._frame.at(px)
        self._net = Triangulation(self._at, flat, px, FAR_UP)
        self._insert()

    def exact(self) -> Exact:
        """Count the triangles, and measure them."""
        count = int(self._shown[self._mesh.triangles].any(axis=1).sum())
        at_posts_px = self.errors_px(self._uv[: self._posts])
        off_px = np.concatenate([at_posts_px, self._crossings()[1]])
        return Exact(count, float(off_px.max()) / self._tau_px)

    def errors_px(self, uv: Floats) -> Floats:
        """Return how far off the mesh is at places of the ground, where it is held."""
        px = self._frame.px(self._ground.surface(uv[self._ground.is_inside(uv)]))
        finder = tri.Triangulation(*self._mesh.points[:, :2].T, self._mesh.triangles)
        under = finder.get_trifinder()(*px[:, :2].T)
        mine = (under >= 0) & self._held[under]
        return self._off_px(under[mine], px[mine])

    def close(self) -> None:
        """Insert where edges cross lines between posts, too, until none is too far off.

        First where no edge of the two triangles beside it is further off; after each
        round of them, posts that are too far off now.
        """
        for _ in range(ROUNDS):
            edge, off_px, uv = self._crossings()
            far = off_px > self._tau_px
            if not far.any():
                return
            edge, off_px, uv = edge[far], off_px[far], uv[far]
            worst_px = np.zeros(len(self._mesh.triangles))
            np.maximum.at(worst_px, edge // 3, off_px)
            across = self._mesh.across.ravel()[edge]
            np.maximum.at(worst_px, across[across >= 0], off_px[across >= 0])
            beside_px = np.where(across >= 0, worst_px[across], 0.0)
            mine = off_px >= np.maximum(worst_px[edge // 3], beside_px)
            self._add(uv[mine], edge[mine] // 3)
            self._insert()
        raise AssertionError

    def _add(self, uv: Floats, near: Ints) -> None:
        points = self._ground.surface(uv)
        px, size = self._frame.px(points), self._net.size
        at = self._frame.at(px)
        assert self._net.add(at, self._frame.flat(points), px, near)
        # Some are posts, and edges may cross where another does.
        new = np.sort(np.unique(at, axis=0, return_index=True)[1])
        new = new[~np.isin(_key(at[new]), _key(self._at))]
        assert self._net.size == size + len(new)
        self._at = np.concatenate([self._at, at[new]])
        self._uv = np.concatenate([self._uv, uv[new]])
        self._points = np.concatenate([self._points, points[new]])

    def _insert(self) -> None:
        self._net.refine(self._tau_px)
        self._mesh = self._net.result()
        used = self._mesh.used
        # Outside of the picture a triangle is not drawn.
        self._shown = in_picture(self._points[used], self._view)
        # Beside the picture and the region there are no posts that hold a triangle.
        mine = self._shown & (used >= len(CORNERS))
        self._held = mine[self._mesh.triangles].all(axis=1) & ~self._is_sliver()

    def _is_sliver(self) -> Bools:
        """Say which triangles have no height: posts in a row are not quite in line."""
        lattice = self._ground.lattice[:, 1:]
        corners = (self._uv[self._mesh.used] @ lattice.T)[self._mesh.triangles]
        sides = np.roll(corners, -1, axis=1) - corners
        double = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        return np.asarray(double < NEAR * np.linalg.norm(sides, axis=2).max(axis=1))

    def _off_px(self, triangle: Ints, px: Floats) -> Floats:
        """Return how far above or below triangles points are."""
        a, b, c = np.moveaxis(self._mesh.points[self._mesh.triangles[triangle]], 1, 0)
        across = np.cross(b - a, c - a)
        return np.asarray(np.abs(((px - a) * across).sum(axis=1) / across[:, 2]))

    def _crossings(self) -> tuple[Ints, Floats, Floats]:
        """Return where held triangles' edges cross lines between posts.

        Returns
        -------
        edge : (n,) three times the triangle, and which of its edges
        off_px, uv : (n,) and (n, 2) how far off, and where
        """
        corner, across = self._mesh.triangles, self._mesh.across.ravel()
        seen = (across >= 0) & (across < np.arange(len(across)) // 3) & self._held[across]
        edge = np.flatnonzero(np.repeat(self._held, 3) & ~seen)
        ends = corner.ravel()[edge], np.roll(corner, -1, axis=1).ravel()[edge]
        one, other = (self._uv[self._mesh.used[end]] for end in ends)
        lattice = self._ground.lattice
        part, mine = crossed(
            *(lattice[:, 0] + uv @ lattice[:, 1:].T for uv in (one, other))
        )
        uv = self._at_posts(one[mine] + part[:, None] * (other - one)[mine])
        px = self._frame.px(self._ground.surface(uv))
        known = np.isin(_key(self._frame.at(px)), _key(self._mesh.at))
        here = self._ground.is_inside(uv) & ~known
        edge = edge[mine[here]]
        return edge, self._off_px(edge // 3, px[here]), uv[here]

    def _at_posts(self, uv: Floats) -> Floats:
        """Put places beside posts where the posts are."""
        lattice = self._ground.lattice
        place = lattice[:, 0] + uv @ lattice[:, 1:].T
        posts = np.linalg.solve(lattice[:, 1:], (np.rint(place) - lattice[:, 0]).T).T
        near = (np.abs(place - np.rint(place)) <= NEAR).all(axis=1)
        return np.where(near[:, None], snapped(posts) / UV_ONE, uv)


def _key(at: Ints) -> Ints:
    """Return a number for each place."""
    return np.asarray(at[:, 0] * (1 << 32) + at[:, 1])


def crossed(one: Floats, other: Floats) -> tuple[Floats, Ints]:
    """Find where lines from columns and rows (n, 2) to others cross those between posts.

    Returns
    -------
    part, number : (m,) at which part of its way, and of which line
    """
    parts, numbers = [], []
    for family in FAMILIES:
        start, end = one @ family, other @ family
        first = np.ceil(np.minimum(start, end) + NEAR).astype(np.int64)
        last = np.floor(np.maximum(start, end) - NEAR).astype(np.int64)
        count = np.maximum(last - first + 1, 0)
        number = np.repeat(np.arange(len(one)), count)
        nth = np.arange(len(number)) - np.repeat(np.cumsum(count) - count, count)
        parts.append((first[number] + nth - start[number]) / (end - start)[number])
        numbers.append(number)
    return np.concatenate(parts), np.concatenate(numbers)


def in_picture(points: Floats, view: ViewState) -> Bools:
    """Say which ECEF points (n, 3) lie in the picture."""
    x, y, z = ((points - view.eye) @ view.rotation.T).T
    wide, high = view.width_px / 2 / view.focal_px, view.height_px / 2 / view.focal_px
    return np.asarray((z < 0) & (np.abs(x) <= -z * wide) & (np.abs(y) <= -z * high))
