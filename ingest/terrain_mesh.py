# SPDX-License-Identifier: Apache-2.0
"""The mesh of one terrain cell: greedy surface, skirt, 16-byte vertices."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edges_rad
from ingest.closing import Under
from ingest.leaf_places import first_ones
from ingest.pole import at_pole, on_pole, quantise_around, tip_of, with_extent
from ingest.removal import Holes
from ingest.triangulation import Triangulation
from tiles import geodesy
from tiles.frames import Ecef, Floats, Local
from tiles.mesh import SKIRT, STEPS, UV_ONE, VERTEX, Mesh, quantise


def snapped(uv: Floats) -> NDArray[np.int64]:
    """Round fractions of a cell to those that a vertex can have, 0..UV_ONE."""
    at = np.rint(uv * UV_ONE).astype(np.int64)
    # Only what lies on an edge may be rounded to it.
    inside = (uv > 1e-9) & (uv < 1 - 1e-9)
    return np.asarray(np.where(inside, np.clip(at, 1, UV_ONE - 1), at))


@dataclass(frozen=True, slots=True)
class Places:
    """What a mesh may use as vertices; the cell's corners come first."""

    at: NDArray[np.int64]
    """(n, 2), 0..UV_ONE, east and north, no two alike"""
    points: Ecef
    """(n, 3) m"""
    lean: int = 1
    """Diagonal of the posts' triangles: 1 north-west to south-east, -1 the other"""

    @classmethod
    def of(cls, at: NDArray[np.int64], points: Floats, lean: int = 1) -> Self:
        """Take the first of places that are alike; the first four are the corners."""
        first = first_ones(at)
        return cls(at[first], Ecef(points[first]), lean)


LEAN = 1 / 16
POLE_RAD = 1e-7
"""So near to a pole, 0.6 m, a map's edge is drawn"""
CORNER_STEPS = np.array([(UV_ONE, 0), (0, UV_ONE)])
CORNERS = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
"""South-west, south-east, north-east, north-west"""


def lattice_places(cell: int, side: int, margin: int = 0) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes, (side + 1 + 2 margin) squared, clamped at poles."""
    west, south, east, north = edges_rad(cell)
    steps = np.arange(-margin, side + 1 + margin) / side
    lon, lat = np.meshgrid(west + steps * (east - west), south + steps * (north - south))
    return lon, np.clip(lat, -np.pi / 2, np.pi / 2)


@dataclass(frozen=True)
class Surface:
    """A cell's triangles, as they will be drawn (positions already rounded)."""

    cell: int
    centre: Ecef
    """(3,) m, of the mesh"""
    steps: NDArray[np.int16]
    """(v, 3) rounded positions around it"""
    scale_m: float
    """Metres a step"""
    at: NDArray[np.int64]
    """(v, 2) places, 0..UV_ONE, east and north"""
    triangles: NDArray[np.int64]
    """(t, 3) vertices of the surface, skirts apart"""
    border: NDArray[np.int64]
    """(b, 2) vertices: the directed edges on the cell's rim"""
    used: NDArray[np.int64]
    """(v,) which of the places became vertices"""
    weight_m: Floats
    """(v,) how much each vertex matters: its distance from the surface without it"""
    across: NDArray[np.int64]
    """(t, 3) the triangle across from each edge, -1 on the rim"""
    fresh: NDArray[np.bool_]
    """(t,) triangles that the cell's surface before this one did not have"""

    @cached_property
    def uv(self) -> Floats:
        """Return fractions of the cell, east and north, (v, 2)."""
        return np.asarray(self.at / UV_ONE)

    @cached_property
    def on_rim(self) -> NDArray[np.bool_]:
        """Say which vertices lie on the cell's edge, (v,)."""
        return np.asarray((self.at % UV_ONE == 0).any(axis=1))

    @cached_property
    def points(self) -> Floats:
        """Return positions, (v, 3) float64 m around the mesh's centre."""
        return np.asarray(self.steps.astype(np.float64) * self.scale_m)

    @cached_property
    def nowhere(self) -> NDArray[np.int64]:
        """Return an `across` of triangles that are looked at alone."""
        return np.full_like(self.across, -1)

    @cached_property
    def mesh(self) -> Mesh:
        """Return what is stored, the skirt included."""
        frame = self.centre, self.scale_m
        return meshed(self.cell, frame, self.steps, self.at, [self.shown])[0]

    @cached_property
    def shown(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return triangles and border but for those with two corners at a pole: lines."""
        poles = on_pole(self.cell, self.at)
        return with_extent(self.triangles, poles), with_extent(self.border, poles)


def meshed(
    cell: int,
    frame: tuple[Ecef, float],
    steps: NDArray[np.int16],
    at: NDArray[np.int64],
    surfaces: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]],
) -> tuple[Mesh, list[int]]:
    """Hang skirts under surfaces that share vertices.

    Parameters
    ----------
    frame : centre and metres a step
    steps, at : (v, 3) and (v, 2) of `Surface`
    surfaces : triangles (t, 3) and border (b, 2) of each

    Returns
    -------
    mesh : each surface's indices and then its skirt's
    ends : where each surface's indices end, its skirt's included
    """
    vertices = np.zeros(len(at), VERTEX)
    vertices["position"], vertices["detail"] = steps, at
    west, south, east, north = edges_rad(cell)
    u, v = (at / UV_ONE).T
    up = geodesy.up(west + u * (east - west), south + v * (north - south))
    vertices["normal"][:, :3] = np.rint(up * 127)
    rim = np.unique(np.concatenate([border for _, border in surfaces]))
    hem = vertices[rim].copy()
    hem["flags"] |= SKIRT
    parts, ends, count = [], [], 0
    for triangles, border in surfaces:
        below = np.searchsorted(rim, border) + len(vertices)
        parts += [triangles, _walls(border, below)]
        count += 3 * (len(triangles) + len(parts[-1]))
        ends.append(count)
    indices = np.concatenate(parts).astype("<u2").ravel()
    return Mesh(*frame, np.concatenate([vertices, hem]), indices), ends


def _walls(border: NDArray[np.int64], below: NDArray[np.int64]) -> NDArray[np.int64]:
    """Hang a wall under each directed rim edge; the renderer chooses its depth."""
    a, b = border.T
    low_a, low_b = below.T
    return np.stack([a, low_a, low_b, a, low_b, b], axis=1).reshape(-1, 3)


class Meshing:
    """A cell's mesh while it is refined."""

    def __init__(self, cell: int, places: Places, *, upright: bool = False) -> None:
        """Take what may be a vertex; `upright` to measure along the vertical."""
        self._cell, self._lean = cell, places.lean
        self._centre = Ecef(places.points[:4].mean(axis=0))
        self._tip = tip_of(cell, places.at, places.points)
        local = self._local(places.at, places.points)
        self._rounding_m = np.sqrt(3) / 2 * float(np.abs(local).max()) / STEPS
        flat = on_map(cell, places.at, places.lean)
        middle = np.asarray(self._centre) * float(upright)
        self._net = Triangulation(places.at, flat, local, middle)
        self._scale_m = 0.0

    def _local(self, at: NDArray[np.int64], points: Floats) -> Floats:
        """Return places around the centre, a pole's all in one, (n, 3) m."""
        if self._tip is not None:
            points = np.where(on_pole(self._cell, at)[:, None], self._tip, points)
        return np.ascontiguousarray(points - self._centre)

    def refine(self, bound_m: float) -> None:
        """Insert places until none is further than a bound, rounding included."""
        self._net.refine(max(bound_m - self._rounding_m, 0.0))

    def close(
        self, bound_m: float, posts: NDArray[np.float32], grid: Floats, origin: Ecef
    ) -> float:
        """Do the same between places too, where the posts are.

        Parameters
        ----------
        posts, grid : of the cell's truth
        origin : of the posts

        Returns
        -------
        An error that is kept at places and along edges, infinite if none is known; m
        """
        to_map = np.ascontiguousarray(on_map(self._cell, CORNER_STEPS, self._lean).T)
        offset = np.asarray(origin - self._centre)
        under = Under(posts, grid, offset, to_map)
        # Most of what rounding moves a vertex by is along its triangles.
        goal_m = max(bound_m - self._rounding_m / 2, 0.0)
        return goal_m + self._rounding_m if self._net.close(goal_m, under) else np.inf

    def refine_wholly(self) -> None:
        """Insert all places."""
        self._net.refine_wholly()

    def add(self, at: NDArray[np.int64], points: Floats, near: NDArray[np.int64]) -> bool:
        """Add places, (n, 2), that must be vertices; False when there are too many.

        Parameters
        ----------
        near : (n,) triangles of the last surface that they probably lie over
        """
        flat = on_map(self._cell, at, self._lean)
        return self._net.add(at, flat, self._local(at, points), near)

    def lift(self, bound_m: float) -> Holes | None:
        """Take out vertices that no place minds by more than a bound, until `settle`."""
        return self._net.lift(max(bound_m - self._rounding_m, 0.0))

    def settle(
        self, holes: Holes, bad: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Put back what was in holes with a bad triangle; see `Triangulation`."""
        return self._net.settle(holes, bad)

    def surface(self) -> Surface:
        """Return the mesh as it is now."""
        net, centre = self._net.result(), self._centre
        local = Local(net.points)
        if self._tip is None:
            steps, scale_m = quantise(local)
        else:
            steps, scale_m, aside_m = quantise_around(self._tip - centre, local)
            centre = Ecef(centre + aside_m)
        # Another scale rounds all positions anew.
        fresh = net.fresh | (scale_m != self._scale_m)
        self._scale_m = scale_m
        return Surface(
            self._cell,
            centre,
            steps,
            scale_m,
            net.at,
            net.triangles,
            net.border,
            net.used,
            net.weight_m,
            net.across,
            fresh,
        )


def on_map(cell: int, at: NDArray[np.int64], lean: int) -> Floats:
    """Return places on a map of the cell on which triangles should be compact, (n, 2).

    The map has the cell's proportions, a little longer along one diagonal, so that four
    posts are joined along the other. Of a cell at a pole it is Mercator's: true to shape
    like a stereographic one, but the pole is an edge of it, as it is an edge of the cell.
    Else triangles reach far along that edge which are nothing but a line in the cell, and
    can't be divided.
    """
    west, south, east, north = edges_rad(cell)
    u, v = (at / UV_ONE).T
    if not at_pole(cell):
        wide = (east - west) / (north - south) * math.cos((south + north) / 2)
        return np.stack([wide * (u + LEAN * lean * v), v + LEAN * lean * u], axis=1)
    turn = math.copysign(1.0, south + north)
    beyond = np.maximum(np.pi / 2 - turn * (south + v * (north - south)), POLE_RAD)
    return np.stack([u * (east - west), -turn * np.log(np.tan(beyond / 2))], axis=1)
