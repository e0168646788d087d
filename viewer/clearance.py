# SPDX-License-Identifier: Apache-2.0
"""Keeps the eye outside of what is drawn, so that it never sees a surface from below.

The eye is above the ground; a stand-in is up to its error above the ground too, and so
it may be above the eye. Such a stand-in sinks until it is just below, and all skirts
reach as much deeper. A settled view has none: a cell that holds the eye is refined to
its leaf. (A neighbour sinks too, where it is above the eye, while the eye is so near to
its edge that rounding may put the edge behind the eye.)

Skirts lean outwards over the neighbour. Where the eye is beside a tile, its skirt leans
less, so that it ends before the eye: one then looks at it and not out of it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles import geodesy
from tiles.frames import WGS84_B_M, Floats
from tiles.kernels import brief, inlined
from tiles.lanes import Lane
from tiles.mesh import VERTEX
from viewer.arena import Arena
from viewer.gl import Gl

LEAN = 0.5
"""A skirt leans outwards by this share of its depth."""
CLEAR = 0.5
"""It takes up to this share of the way to the eye."""
ROUNDED = 3.0
"""Steps by which rounding may move a tile's edge across the eye."""
ABOVE_M = 2.0
"""A stand-in ends up so far below the eye."""
MOST = 16
"""Tiles that are looked at; many meet at a pole."""
STEP, DEPTH, ENTRY, LEANING, WHOLE = 3, 7, 12, 14, slice(16, 19)
"""Where a draw's record (viewer/draw_record.py) holds them."""
LOWER_RADIUS_M = WGS84_B_M - 40_000.0
Place = tuple[float, float, float]
"""longitude, latitude, height (rad, rad, m)"""


@inlined
def angles_to_box(box_rad: NDArray[np.float64], place: Place) -> tuple[float, float]:
    """Return how far outside of a cell's box a place is in longitude and latitude, rad."""
    middle = (box_rad[0] + box_rad[2]) / 2
    aside = abs((place[0] - middle + math.pi) % (2 * math.pi) - math.pi)
    aside = max(aside - (box_rad[2] - box_rad[0]) / 2, 0.0)
    return aside, max(box_rad[1] - place[1], place[1] - box_rad[3], 0.0)


@inlined
def level_m(
    box_rad: NDArray[np.float64], place: Place, aside: float, beyond: float
) -> float:
    """Return a distance, m, that nothing over a cell's box is nearer than, height apart.

    Parameters
    ----------
    aside, beyond : of `angles_to_box`, together at most a quarter of pi
    """
    poleward = max(abs(box_rad[1]), abs(box_rad[3]), abs(place[1]))
    axis = math.cos(min(poleward, math.pi / 2))
    # On a parallel, or else across the plane of the cell's nearer meridian.
    east = max(2 * math.sin(aside / 2) * axis, math.sin(aside) * math.cos(place[1]))
    north = 2 * math.sin(beyond / 2)
    along = 2 * math.sin(aside / 2) * axis
    return LOWER_RADIUS_M * max(east, math.sqrt(along * along + north * north))


@inlined
def beside_m(box_rad: NDArray[np.float64], place: Place) -> float:
    """Return how far outside of a cell's box a place is at least, m; infinite when far."""
    aside, beyond = angles_to_box(box_rad, place)
    if aside + beyond > math.pi / 4:
        return math.inf
    return level_m(box_rad, place, aside, beyond)


@inlined
def may_sink(away_m: float, step_m: float, children: int) -> bool:
    """Say whether a tile that reaches above the eye may be one that sinks.

    Parameters
    ----------
    away_m : of `beside_m`
    step_m : of the tile's positions
    children : 0 where it has none
    """
    return away_m <= ROUNDED * step_m and (away_m > 0.0 or children != 0)


class Drawn(NamedTuple):
    """Where the records of a draw list's terrain come from."""

    rows: NDArray[np.int32]
    """of the draw list"""
    slots: NDArray[np.void]
    records: NDArray[np.void]
    children: NDArray[np.int32]
    """(rows, 4) of the forest"""


class Clearance:
    """Finds the tiles that hold the eye, and reads their meshes back when they change."""

    def __init__(self, calls: Gl, arena: Arena) -> None:
        self._gl, self._arena = calls, arena
        self._meshes: dict[int, tuple[Floats, NDArray[np.uint16]]] = {}

    def forget(self, row: int) -> None:
        """Say that a terrain tile was freed."""
        self._meshes.pop(row, None)

    def apply(self, instances: NDArray[np.float32], drawn: Drawn, place: Place) -> float:
        """Sink what is above the eye, and choose how far each skirt leans.

        Parameters
        ----------
        instances : (n, 20) records of the visible terrain draws, changed in place
        drawn : what they were made of
        place : of the eye

        Returns
        -------
        How far a tile sank, m
        """
        near = _near_eye(instances, drawn, place)[:MOST]
        if not len(near):
            self._meshes.clear()
            return 0.0
        axes, sunk_m = geodesy.enu_axes(place[0], place[1]), 0.0
        for at in near.tolist():
            down_m = self._down_m(instances[at], drawn, axes)
            instances[at, :3] -= down_m * axes[2]
            sunk_m = max(sunk_m, down_m)
        instances[:, DEPTH] += sunk_m
        return sunk_m

    def _down_m(self, instance: NDArray[np.float32], drawn: Drawn, axes: Floats) -> float:
        """Return how far a tile must sink; beside its edge, what is just inside counts."""
        steps, corners = self._mesh(int(drawn.rows[int(instance[ENTRY])]))
        points = ((instance[WHOLE] + steps) * float(instance[STEP]) + instance[:3]) @ axes.T
        over_m = above_m(points, corners)
        if over_m == -np.inf:
            inwards = points.mean(axis=0) * (1.0, 1.0, 0.0)
            inwards *= 2 * ROUNDED * float(instance[STEP]) / float(np.linalg.norm(inwards))
            over_m = above_m(points - inwards, corners)
        return max(over_m + ABOVE_M, 0.0)

    def _mesh(self, row: int) -> tuple[Floats, NDArray[np.uint16]]:
        """Return positions in steps and triangles of an uploaded tile."""
        if row not in self._meshes:
            slot = self._arena.slots[Lane.TERRAIN][row]
            vertices = np.empty(int(slot["vertex_count"]), VERTEX)
            corners = np.empty((int(slot["surface_count"]) // 3, 3), np.uint16)
            first = int(slot["base_vertex"]) * VERTEX.itemsize
            self._get(self._arena.vertices.name, first, vertices)
            first = int(slot["first_index"]) * corners.itemsize
            self._get(self._arena.indices.name, first, corners)
            self._meshes[row] = vertices["position"].astype(np.float64), corners
        return self._meshes[row]

    def _get(self, buffer: int, offset: int, into: NDArray[np.generic]) -> None:
        data = into.ctypes.data
        self._gl.call("glGetNamedBufferSubData", buffer, offset, into.nbytes, data)


@brief
def _near_eye(
    instances: NDArray[np.float32], drawn: Drawn, place: Place
) -> NDArray[np.int64]:
    """Shorten the skirts beside the eye, and return the draws that may be above it."""
    found, count = np.empty(len(instances), np.int64), 0
    for i in range(len(instances)):
        instance = instances[i]
        row = drawn.rows[int(instance[ENTRY])]
        if drawn.records[row]["max_height_m"] <= place[2]:
            continue
        away_m = beside_m(drawn.slots[row]["box_rad"], place)
        if away_m > ROUNDED * instance[STEP]:
            instance[LEANING] = min(LEAN, CLEAR * away_m / max(instance[DEPTH], 1e-3))
        elif may_sink(away_m, instance[STEP], drawn.children[row, 0] + 1):
            found[count] = i
            count += 1
    return found[:count]


@brief
def above_m(points: Floats, corners: NDArray[np.uint16]) -> float:
    """Return how far above the eye a mesh is, m; negative below, -inf where it is not.

    Parameters
    ----------
    points : (v, 3) m east, north and up of the eye
    corners : (t, 3)
    """
    highest = -np.inf
    for t in range(len(corners)):
        a, b, c = points[corners[t, 0]], points[corners[t, 1]], points[corners[t, 2]]
        u = b[0] * c[1] - b[1] * c[0]
        v = c[0] * a[1] - c[1] * a[0]
        w = a[0] * b[1] - a[1] * b[0]
        area = u + v + w
        if area > 0.0 and min(u, v, w) >= 0.0:
            highest = max(highest, (u * a[2] + v * b[2] + w * c[2]) / area)
    return float(highest)
