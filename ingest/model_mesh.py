# SPDX-License-Identifier: Apache-2.0
"""Faces of city models to triangles that look outward, flat, wall or roof, no floor."""

from dataclasses import dataclass

import mapbox_earcut
import numpy as np
import trimesh
from numpy.typing import NDArray

from ingest.city_objects import ANY_SURFACE, FLOOR_SURFACE, ROOF_SURFACE
from ingest.model_rings import Rings
from tiles.frames import Floats, Ints
from tiles.mesh import ROOF, WALL

ROOF_SLOPE = 0.2
"""A face whose normal points up more than this is a roof where the file does not say."""
FLOOR_SLOPE = -0.7
FLOOR_M = 0.05
SEEN_FLOOR_M = 0.5
_SLIVER_M2 = 5e-10
_ONE_SIDED = 0.3
# Across and up in the plane left when an axis is dropped, so that the turn stays.
_ACROSS, _UPWARD = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True, slots=True)
class Bodies:
    """What the faces of a body say together."""

    closed: NDArray[np.bool_]
    """(b,) every edge has a face on both sides"""
    twisted: NDArray[np.bool_]
    """(b,) neighbouring faces contradict each other on where outside is"""
    loose: NDArray[np.bool_]
    """(b,) there are gaps above the floor, so that neighbours can't tell"""
    inside_out: NDArray[np.bool_]
    """(b,) to be turned over"""


@dataclass(frozen=True, slots=True)
class Shells:
    """Triangles to be drawn, of many objects one after the other."""

    corner: Ints
    """(v,) which corner of the rings each vertex is"""
    kind: NDArray[np.uint8]
    """(v,) WALL or ROOF"""
    triangles: Ints
    """(t, 3) vertices, counter-clockwise seen from outside"""
    owner: Ints
    """(t,) object of each triangle, ascending"""
    vertex_owner: Ints
    """(v,) object of each vertex, ascending"""


def triangulate(rings: Rings, normal: Floats) -> tuple[Ints, Ints]:
    """Cut faces into triangles, each in its own plane.

    Returns
    -------
    triangles : (t, 3) corners, turning as the face's outline does
    face : (t,) face of each triangle, ascending
    """
    axis = np.abs(normal).argmax(axis=1)
    turn = np.sign(normal[np.arange(len(axis)), axis])
    at = rings.corner_face
    rows = np.arange(len(at))
    flat = np.column_stack(
        (
            rings.place[rows, _ACROSS[axis[at]]] * turn[at],
            rings.place[rows, _UPWARD[axis[at]]],
        )
    )
    start = rings.ring_start
    corner_start = start[rings.face_start]
    size, simple = np.diff(corner_start), np.diff(rings.face_start) == 1
    first = corner_start[:-1]
    three = np.flatnonzero(simple & (size == 3))
    four = _convex(flat, first, np.flatnonzero(simple & (size == 4)))
    cut, cut_face = _ear_clipped(
        rings, flat, np.setdiff1d(np.arange(len(first)), [*three, *four])
    )
    triangles = np.concatenate(
        (
            first[three, None] + (0, 1, 2),
            first[four, None] + (0, 1, 2),
            first[four, None] + (0, 2, 3),
            cut,
        )
    )
    face = np.concatenate((three, four, four, cut_face))
    double = _turn(flat[triangles])
    backward = double < 0
    triangles[backward] = triangles[backward][:, ::-1]
    kept = np.flatnonzero(trimesh.triangles.area(rings.place[triangles]) > _SLIVER_M2)
    kept = kept[np.argsort(face[kept], kind="stable")]
    return triangles[kept], face[kept]


def _convex(flat: Floats, first: Ints, four: Ints) -> Ints:
    """Return the faces of four corners that turn left at each."""
    corner = first[four, None] + np.arange(4)
    left = np.ones(len(four), bool)
    for k in range(4):
        left &= _turn(flat[corner[:, [k, (k + 1) % 4, (k + 2) % 4]]]) > 0
    return four[left]


def _turn(corners: Floats) -> Floats:
    """Return twice the area of triangles (t, 3, 2), negative where clockwise."""
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.asarray(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])


def _ear_clipped(rings: Rings, flat: Floats, faces: Ints) -> tuple[Ints, Ints]:
    flat = np.ascontiguousarray(flat)
    ring_start, face_start = rings.ring_start, rings.face_start
    found = [np.zeros((0, 3), np.int64)]
    for face in faces.tolist():
        starts = ring_start[face_start[face] : face_start[face + 1] + 1]
        first, ends = starts[0], (starts[1:] - starts[0]).astype(np.uint32)
        cut = mapbox_earcut.triangulate_float64(flat[first : starts[-1]], ends)
        found.append(cut.astype(np.int64).reshape(-1, 3) + first)
    counts = [len(one) for one in found[1:]]
    return np.concatenate(found), np.repeat(faces, counts)


def judge(rings: Rings, triangles: Ints, face: Ints) -> Bodies:
    """Find out of each body whether it is closed, consistent and the right way out."""
    count = int(rings.body.max(initial=-1)) + 1
    a, b = rings.weld, rings.weld[rings.ahead]
    body = rings.body[rings.corner_face]
    low, high = np.minimum(a, b), np.maximum(a, b)
    _, edge = np.unique(low * (len(a) + 1) + high, return_inverse=True)
    net = np.bincount(edge, np.where(a < b, 1.0, -1.0))
    net = np.abs(net[edge])
    closed, twisted = np.ones(count, bool), np.zeros(count, bool)
    closed[body[net > 0]] = False
    twisted[body[net > 1]] = True
    loose = _gapes(rings, body, net > 0, count)
    outward = _volumes(rings, triangles, rings.body[face], count)
    # What has no floor, such as a bridge's deck with walls, is seen from above.
    up, level = _level_areas(rings, triangles, rings.body[face], count)
    one_sided = ~closed & (np.abs(up) > _ONE_SIDED * level)
    outward[one_sided] = up[one_sided]
    return Bodies(closed, twisted, loose, (outward < 0) & ~twisted)


def _gapes(
    rings: Rings, body: Ints, is_open: NDArray[np.bool_], count: int
) -> NDArray[np.bool_]:
    """Tell which bodies have an open edge that is not on their floor, (count,)."""
    up = rings.place[:, 2]
    floor = np.full(count, np.inf)
    np.minimum.at(floor, body, up)
    high = np.maximum(up, up[rings.ahead]) > floor[body] + FLOOR_M
    return np.asarray(np.bincount(body[is_open & high], minlength=count) > 0)


def _level_areas(
    rings: Rings, triangles: Ints, body: Ints, count: int
) -> tuple[Floats, Floats]:
    """Return twice the area that looks up less what looks down, and both together, m2."""
    double = _turn(rings.place[triangles][:, :, :2])
    net, all_of_it = (
        np.bincount(body, value, count).astype(np.float64)
        for value in (double, np.abs(double))
    )
    return net, all_of_it


def _volumes(rings: Rings, triangles: Ints, body: Ints, count: int) -> Floats:
    """Return six times the volume of each body, from the middle of its foot, m3."""
    corner = rings.place[triangles]
    low = np.full((count, 3), np.inf)
    high = -low
    np.minimum.at(low, body, corner.min(axis=1))
    np.maximum.at(high, body, corner.max(axis=1))
    has_any = np.bincount(body, minlength=count)[:, None] > 0
    low, high = np.where(has_any, low, 0.0), np.where(has_any, high, 0.0)
    eye = (low + high) / 2
    eye[:, 2] = low[:, 2]
    corner = corner - eye[body][:, None]
    six = np.einsum("ij,ij->i", corner[:, 0], trimesh.triangles.cross(corner))
    return np.asarray(np.bincount(body, six, count), np.float64)


def level_areas(rings: Rings, triangles: Ints, face: Ints) -> Floats:
    """Return the area of each face as seen from above, (f,) m2, holes left out."""
    double = np.abs(_turn(rings.place[triangles][:, :, :2]))
    return np.bincount(face, double / 2, len(rings.owner)).astype(np.float64)


def turned(rings: Rings, normal: Floats, bodies: Bodies) -> NDArray[np.bool_]:
    """Tell which faces, (f,), are to be turned over to look outward."""
    over = bodies.inside_out[rings.body]
    up = unit_up(normal) * np.where(over, -1, 1)
    # An open body can't say where outside is, but nobody sees a roof from below.
    loose = ~bodies.closed[rings.body] & (rings.surface == ROOF_SURFACE)
    return np.asarray(over ^ (loose & (up < -ROOF_SLOPE)))


def unit_up(normal: Floats) -> Floats:
    """Return the upward component of each normal's direction."""
    return np.asarray(normal[:, 2] / np.linalg.norm(normal, axis=1))


def shells(
    rings: Rings, normal: Floats, triangles: Ints, face: Ints, bodies: Bodies
) -> Shells:
    """Leave out floors, and give every flat surface vertices of its own.

    Parameters
    ----------
    normal : (f, 3) pointing outward
    triangles : (t, 3) turning accordingly
    """
    drawn = ~_floors(rings, normal)[face]
    triangles, face = triangles[drawn], face[drawn]
    # Of a body whose faces may contradict each other both sides are drawn.
    both = (bodies.twisted | bodies.loose)[rings.body[face]]
    triangles = np.concatenate((triangles, triangles[both][:, ::-1]))
    sign = np.where(np.arange(len(triangles)) < len(face), 1, -1)
    face = np.concatenate((face, face[both]))
    order = np.argsort(rings.owner[face], kind="stable")
    triangles, face, sign = triangles[order], face[order], sign[order]

    unit = normal / np.linalg.norm(normal, axis=1)[:, None]
    unit = unit[face] * sign[:, None]
    kind = _kinds(rings.surface[face], unit[:, 2])
    code = np.rint(unit * 127).astype(np.int64) + 128
    code = ((code[:, 0] << 8 | code[:, 1]) << 8 | code[:, 2]) << 1 | kind
    key = rings.weld[triangles] << 25 | code[:, None]
    _, corner, inverse = np.unique(key.ravel(), return_index=True, return_inverse=True)
    return Shells(
        triangles.ravel()[corner],
        kind[corner // 3],
        inverse.reshape(-1, 3),
        rings.owner[face],
        rings.owner[face[corner // 3]],
    )


def _kinds(surface: NDArray[np.uint8], up: Floats) -> NDArray[np.uint8]:
    said = (surface == ROOF_SURFACE) & (up > -ROOF_SLOPE)
    roof = said | ((surface == ANY_SURFACE) & (up > ROOF_SLOPE))
    return np.where(roof, ROOF, WALL).astype(np.uint8)


def _floors(rings: Rings, normal: Floats) -> NDArray[np.bool_]:
    """Tell which faces nobody sees: what lies on the ground."""
    high = np.maximum.reduceat(
        rings.place[:, 2], rings.ring_start[rings.face_start[:-1]]
    ) if len(normal) else np.zeros(0)  # fmt: skip
    lowest = (unit_up(normal) < FLOOR_SLOPE) & (high < FLOOR_M)
    # A floor that follows a slope is seen from below where the ground drawn is level.
    said = (rings.surface == FLOOR_SURFACE) & (high < SEEN_FLOOR_M)
    return np.asarray(said | ((rings.surface == ANY_SURFACE) & lowest))
