# SPDX-License-Identifier: Apache-2.0
"""The meshes of the few large cells above the parts of a zone.

They are made of a lattice, before anything below them, and watched while the parts are
made: every post below is held against them. A lattice misses summits, so here and there
one is too far off. Those places become vertices, and what changed around them is measured
again, until the cell is within its bound.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edge_m, edges_rad, window_in
from ingest.deviation import Gaps
from ingest.fitting import is_beside_rim, on_rim
from ingest.mosaic import Mosaic
from ingest.stored_tile import stored_surface
from ingest.terrain_mesh import CORNERS, Meshing, Surface, snapped
from ingest.terrain_plan import Plan
from ingest.terrain_tile import LEAF_SIDE, inner_bound_m, lattice_of
from ingest.truth import Truth, truth_of
from tiles import cells, geodesy
from tiles.frames import WGS84_B_M, Ecef, Floats
from tiles.mesh import UV_ONE

SHARE = 0.8
"""Of its bound; the places of its lattice are so close"""
ROUNDS = 16
"""Most rounds of mending"""
MOST_TRUTHS = 64
"""Kept from round to round"""


@dataclass(frozen=True, slots=True)
class Miss:
    """A triangle that is beyond its cell's bound, and where it is furthest off."""

    triangle: int
    far_m: float
    u: float
    v: float
    """fractions of the cell"""


def meshing_of(mosaic: Mosaic, cell: int) -> Meshing:
    """Begin a large cell's mesh: as close to its lattice as it should be."""
    meshing = Meshing(cell, lattice_of(mosaic, cell))
    meshing.refine(SHARE * inner_bound_m(cell))
    return meshing


@dataclass(slots=True)
class Watched:
    """A large cell's surface while leaves below it are held against it."""

    surface: Surface
    bound_m: float
    error_m: float = 0.0
    misses: dict[int, Miss] = field(default_factory=dict)
    """by triangle"""
    boxes: Floats | None = None
    """(t, 2, 2) least and largest u, v of triangles that its stored tile has not; on
    unchanged ground all others are within `error_m`"""

    def asks(self, cell: int) -> bool:
        """Say whether an unchanged cell below has to be measured again."""
        if self.boxes is None:
            return True
        u, v, size = window_in(self.surface.cell, cell)
        near = (self.boxes[:, 0] < (u + size, v + size)) & (self.boxes[:, 1] > (u, v))
        return bool(near.all(axis=1).any())

    def hold(self, truth: Truth) -> None:
        """Measure fresh triangles against a leaf; closer than before does not matter."""
        count = len(self.surface.triangles)
        far_m = np.full(count, min(self.error_m, self.bound_m))
        for one in self.misses.values():
            far_m[one.triangle] = one.far_m
        gaps = Gaps(far_m, np.zeros((count, 2)), np.zeros(count, np.int64))
        window = window_in(self.surface.cell, truth.cell)
        gaps.add(self.surface, window, truth, 1)
        self.error_m = max(self.error_m, gaps.largest_m)
        for k in np.flatnonzero((gaps.which == 1) & (gaps.far_m > self.bound_m)).tolist():
            self.misses[k] = Miss(k, float(gaps.far_m[k]), *gaps.uv[k].tolist())


def watched(mosaic: Mosaic, surface: Surface, record: NDArray[np.void] | None) -> Watched:
    """Begin to measure a large cell.

    Parameters
    ----------
    record : of its stored tile, which says how far the triangles that it has, too, are off
    """
    bound_m = inner_bound_m(surface.cell)
    if record is None or record["error_m"] > bound_m:
        return Watched(surface, bound_m)
    shared = shared_with(surface, stored_surface(mosaic.connection, record))
    if not shared.any():
        return Watched(surface, bound_m)
    at = surface.uv[surface.triangles[~shared]]
    boxes = np.stack([at.min(axis=1), at.max(axis=1)], axis=1)
    return Watched(surface, bound_m, float(record["error_m"]), boxes=boxes)


def mended(
    cell: int,
    misses: Iterable[Miss],
    mosaic: Mosaic,
    plan: Plan,
    below: NDArray[np.void],
) -> tuple[Surface, float]:
    """Mesh a large cell anew, with the places that it missed.

    Parameters
    ----------
    misses : of the cell's mesh as it begins, known to all parts below
    below : index records of the cells in the parts

    Returns
    -------
    surface, error_m : of the round that came closest
    """
    bound_m, meshing = inner_bound_m(cell), meshing_of(mosaic, cell)
    made = {int(one["cell"]): one for one in below}
    truths = lru_cache(MOST_TRUTHS)(partial(truth_of, mosaic, side=LEAF_SIDE))
    surface, known = meshing.surface(), worst_of(misses)
    best = surface, max(one.far_m for one in known.values())
    for _ in range(ROUNDS):
        meshing.add(*_places(mosaic, cell, known))
        meshing.refine(SHARE * bound_m)
        surface = meshing.surface()
        # What is left of the mesh, and known to no part, is within the bound.
        watched = Watched(surface, bound_m, bound_m)
        watched.misses = {k: one for k, one in known.items() if not surface.fresh[k]}
        for leaf in leaves_under(plan, surface, made):
            watched.hold(truths(leaf))
        known = watched.misses
        error_m = max([bound_m, *(one.far_m for one in known.values())])
        best = min(best, (surface, error_m), key=lambda one: one[1])
        if not known:
            break
    return best


def shared_with(surface: Surface, stored: Surface) -> NDArray[np.bool_]:
    """Say which triangles another surface of the cell has, too, (t,).

    None at a pole: there a place may be nearer to a triangle that it does not lie under.
    """
    frames = [(*one.centre, one.scale_m) for one in (surface, stored)]
    if frames[0] != frames[1] or (surface.across >= 0).any():
        return np.zeros(len(surface.triangles), np.bool_)
    rows = [np.column_stack([one.at, one.steps]) for one in (surface, stored)]
    vertex = np.unique(np.concatenate(rows), axis=0, return_inverse=True)[1].ravel()
    count = len(surface.at)
    mine = np.sort(vertex[:count][surface.triangles], axis=1)
    theirs = set(map(tuple, np.sort(vertex[count:][stored.triangles], axis=1).tolist()))
    return np.array([tuple(one) in theirs for one in mine.tolist()], np.bool_)


def worst_of(misses: Iterable[Miss]) -> dict[int, Miss]:
    """Return of each triangle the place where it is furthest off."""
    return {one.triangle: one for one in sorted(misses, key=lambda one: one.far_m)}


def _places(
    mosaic: Mosaic, cell: int, known: dict[int, Miss]
) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Return what becomes a vertex, as `Meshing.add` takes it; see `Fitting`."""
    uv = np.array([(one.u, one.v) for one in known.values()])
    near, beside = np.array(list(known)), is_beside_rim(uv)
    at = snapped(np.concatenate([uv, on_rim(uv[beside])]))
    west, south, east, north = edges_rad(cell)
    u, v = (at / UV_ONE).T
    lon, lat = west + u * (east - west), south + v * (north - south)
    points = geodesy.to_ecef(lon, lat, mosaic.heights(lon, lat, 0.0))
    return at, points, np.concatenate([near, near[beside]])


def leaves_under(
    plan: Plan, surface: Surface, made: Mapping[int, NDArray[np.void]]
) -> Iterator[int]:
    """Yield the leaves from which a surface's fresh triangles may be too far.

    Parameters
    ----------
    made : index records of what is below: a cell between whose least and largest height
        the triangles are near enough is not looked into
    """
    bound_m = inner_bound_m(surface.cell)
    todo = [int(child) for child in cells.children(surface.cell)]
    while todo:
        cell = todo.pop()
        record = made.get(cell)
        low_m, high_m = drawn_between(surface, cell)
        if low_m > high_m or (
            record is not None
            and record["max_height_m"] - low_m < bound_m
            and high_m - record["min_height_m"] < bound_m
        ):
            continue
        if plan.splits(cell):
            todo += [int(child) for child in cells.children(cell)]
        else:
            yield cell


def drawn_between(surface: Surface, cell: int) -> tuple[float, float]:
    """Return least and largest height of a surface's fresh triangles over a cell below.

    Triangles are carried on to the cell's corners. Inf and -inf where there is none.
    """
    u, v, size = window_in(surface.cell, cell)
    corners = np.array([u, v]) + size * CORNERS
    triangles = surface.triangles[surface.fresh]
    at = surface.uv[triangles]
    near = (at.min(axis=1) < (u + size, v + size)) & (at.max(axis=1) > (u, v))
    triangles = triangles[near.all(axis=1)]
    at = surface.uv[triangles]
    inverse = np.linalg.inv(np.concatenate([at, np.ones((*at.shape[:2], 1))], axis=2))
    weights = np.column_stack([corners, np.ones(len(corners))]) @ inverse
    meet = (weights.max(axis=1) > 0).all(axis=1)
    if not meet.any():
        return np.inf, -np.inf
    there = weights[meet] @ surface.points[triangles[meet]] + surface.centre
    heights = geodesy.to_geodetic(Ecef(there.reshape(-1, 3)))[2]
    # Between corners the planet bulges.
    bulge_m = edge_m(cell) ** 2 / (4 * WGS84_B_M)
    return float(heights.min()) - bulge_m, float(heights.max()) + bulge_m
