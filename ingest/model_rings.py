# SPDX-License-Identifier: Apache-2.0
"""Faces of many city objects as flat arrays: welded corners, clean rings, normals.

Positions are metres east, north and up around each object's own middle; up is counted
from its lowest point. East and north are angles times the metres per degree there, so
that turning them back to longitude and latitude is exact.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats, Ints

WELD_M = 1e-3
MIN_FACE_M2 = 1e-4


@dataclass(frozen=True, slots=True)
class Rings:
    """f faces with holes: r rings, the first of each face its outline; p corners."""

    place: Floats
    """(p, 3) m east, north, up"""
    source: Ints
    """(p,) which corner of the input it is"""
    weld: Ints
    """(p,) the same number for the same place in the same body, ascending by body"""
    ring: Ints
    """(p,) ring of each corner"""
    face: Ints
    """(r,) face of each ring"""
    owner: Ints
    """(f,) object of each face"""
    body: Ints
    """(f,) body of each face"""
    surface: NDArray[np.uint8]
    """(f,) what the file says that it is"""

    @property
    def ring_start(self) -> Ints:
        """(r + 1,) where each ring's corners begin."""
        return np.searchsorted(self.ring, np.arange(len(self.face) + 1))

    @property
    def face_start(self) -> Ints:
        """(f + 1,) where each face's rings begin."""
        return np.searchsorted(self.face, np.arange(len(self.owner) + 1))

    @property
    def corner_face(self) -> Ints:
        """(p,) face of each corner."""
        return self.face[self.ring]

    @property
    def ahead(self) -> Ints:
        """(p,) the corner after each one in its ring."""
        start = self.ring_start
        ahead = np.arange(1, len(self.ring) + 1)
        ahead[start[1:] - 1] = start[:-1]
        return ahead

    def take(self, corner: NDArray[np.bool_], face: NDArray[np.bool_]) -> "Rings":
        """Keep some corners and faces; rings of less than three corners go too."""
        corner = corner & face[self.corner_face]
        size = np.bincount(self.ring[corner], minlength=len(self.face))
        whole = size >= 3
        outlined = whole[self.face_start[:-1]]
        kept_face = face & outlined
        kept_ring = whole & kept_face[self.face]
        corner &= kept_ring[self.ring]
        return replace(
            self,
            place=self.place[corner],
            source=self.source[corner],
            weld=self.weld[corner],
            ring=(np.cumsum(kept_ring) - 1)[self.ring[corner]],
            face=(np.cumsum(kept_face) - 1)[self.face[kept_ring]],
            owner=self.owner[kept_face],
            body=self.body[kept_face],
            surface=self.surface[kept_face],
        )


def welded(place: Floats, body: Ints) -> Ints:
    """Return numbers of places, (p,): the same for a body's corners within 1 mm."""
    steps = np.rint(place / WELD_M)
    order = np.lexsort((steps[:, 2], steps[:, 1], steps[:, 0], body))
    sorted_steps, sorted_body = steps[order], body[order]
    new = np.ones(len(order), bool)
    new[1:] = (sorted_steps[1:] != sorted_steps[:-1]).any(axis=1)
    new[1:] |= sorted_body[1:] != sorted_body[:-1]
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(new) - 1
    return numbers


def clean(rings: Rings) -> tuple[Rings, Floats]:
    """Drop repeated corners, degenerate faces and faces that are there twice.

    Returns
    -------
    rings
    normal : (f, 3) m2, twice the area of each outline along its normal
    """
    if not len(rings.place):
        return rings, np.zeros((0, 3))
    every = np.ones(len(rings.owner), bool)
    # Also where a ring closes: its last corner may be the first one again.
    rings = rings.take(rings.weld != rings.weld[rings.ahead], every)
    normal = newell(rings)
    large = np.linalg.norm(normal, axis=1) > 2 * MIN_FACE_M2
    kept = large & ~_repeated(rings, normal)
    rings = rings.take(np.ones(len(rings.place), bool), kept)
    return rings, normal[kept]


def newell(rings: Rings) -> Floats:
    """Return the vector area, doubled, of each face's outline, (f, 3) m2."""
    if not len(rings.place):
        return np.zeros((0, 3))
    start = rings.ring_start[:-1]
    from_first = rings.place - rings.place[start][rings.ring]
    cross = np.cross(from_first, from_first[rings.ahead])
    return np.asarray(np.add.reduceat(cross, start))[rings.face_start[:-1]]


def _repeated(rings: Rings, normal: Floats) -> NDArray[np.bool_]:
    """Tell which faces have the corners and the direction of an earlier one."""
    if not len(rings.place):
        return np.zeros(0, bool)
    start = rings.ring_start[rings.face_start]
    with np.errstate(over="ignore"):
        mixed = rings.weld.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
        corners = np.add.reduceat(mixed ^ (mixed >> np.uint64(32)), start[:-1])
    axis = np.abs(normal).argmax(axis=1)
    forward = normal[np.arange(len(normal)), axis] > 0
    key = np.column_stack((corners.view(np.int64), np.diff(start), axis, forward))
    _, first = np.unique(key, axis=0, return_index=True)
    repeated = np.ones(len(normal), bool)
    repeated[first] = False
    return repeated
