# SPDX-License-Identifier: Apache-2.0
"""A building's own mesh as a few hundred bytes, and back to meshes that are drawn.

Positions are metres east, north and up around the middle of the footprint's box, up from
the building's lowest point. East and north are angles times the metres per degree at the
middle, so that longitude and latitude come back to the rounding of float32.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.extrude import Prisms
from ingest.repair import metres_per_degree
from tiles import geodesy
from tiles.codec import zstd
from tiles.frames import Floats, Ints
from tiles.mesh import VERTEX

MAX_SOLID_VERTICES = 20_000
"""As a footprint of `repair.MAX_VERTICES` corners has."""
_HEAD = struct.Struct("<4sIIf")
_MAGIC = b"GPS1"
_ZSTD_LEVEL = 5
_VERTEX_BYTES = 3 * 4 + 1
_TRIANGLE_BYTES = 3 * 2
_FOOT_M = 0.05


@dataclass(frozen=True, slots=True)
class Solid:
    """The mesh of one building without its floor; every flat surface has its vertices."""

    place: NDArray[np.float32]
    """(v, 3) m east, north, up"""
    kind: NDArray[np.uint8]
    """(v,) WALL or ROOF"""
    triangles: NDArray[np.uint16]
    """(t, 3) vertices, counter-clockwise seen from outside"""
    roof_m: float
    """mean height of the roofs, weighted by the area below them"""


def encode_solid(solid: Solid) -> bytes:
    """Return a mesh as bytes.

    Raises
    ------
    ValueError
        When it has more than MAX_SOLID_VERTICES vertices.
    """
    if len(solid.place) > MAX_SOLID_VERTICES:
        raise ValueError(f"more than {MAX_SOLID_VERTICES} vertices")
    head = _HEAD.pack(_MAGIC, len(solid.place), len(solid.triangles), solid.roof_m)
    place = np.ascontiguousarray(solid.place.T, "<f4").tobytes()
    kind = np.ascontiguousarray(solid.kind, "u1").tobytes()
    triangles = np.ascontiguousarray(solid.triangles, "<u2").tobytes()
    return zstd.compress(head + place + kind + triangles, _ZSTD_LEVEL)


def decode_solid(body: bytes) -> Solid:
    """Return the mesh of `encode_solid`.

    Raises
    ------
    ValueError
        When the bytes are not those of a solid.
    """
    try:
        raw = zstd.decompress(body)
        magic, vertices, triangles, roof_m = _HEAD.unpack_from(raw)
    except (zstd.ZstdError, struct.error, MemoryError) as error:
        raise ValueError(f"not a solid ({error})") from error
    whole = _HEAD.size + vertices * _VERTEX_BYTES + triangles * _TRIANGLE_BYTES
    if magic != _MAGIC or whole != len(raw):
        raise ValueError("not a solid, or cut off")
    place = np.frombuffer(raw, "<f4", 3 * vertices, _HEAD.size).reshape(3, -1).T
    at = _HEAD.size + 12 * vertices
    kind = np.frombuffer(raw, "u1", vertices, at)
    corner = np.frombuffer(raw, "<u2", 3 * triangles, at + vertices)
    if corner.max(initial=0) >= max(vertices, 1):
        raise ValueError("not a solid: a vertex that is not there")
    return Solid(place, kind, corner.reshape(-1, 3), roof_m)


def widths_m(solids: Sequence[bytes]) -> Floats:
    """Return how far solids reach, (n,) m: twice the farthest east or north of the middle.

    More than the footprint where a roof overhangs.
    """
    found = [2 * np.abs(decode_solid(body).place[:, :2]).max(initial=0) for body in solids]
    return np.array(found, np.float64)


def solid_prisms(
    solids: Sequence[bytes],
    lon_deg: Floats,
    lat_deg: Floats,
    low_m: Floats,
    plinth_m: Floats,
) -> Prisms:
    """Stand buildings of city models on the ground.

    Parameters
    ----------
    solids : n bodies of `encode_solid`
    lon_deg, lat_deg : (n,) middle of each footprint's box
    low_m : (n,) height of each one's lowest point above the ellipsoid
    plinth_m : (n,) how much deeper its foot goes, everything within 5 cm of its lowest
        point

    Returns
    -------
    Like those of `extrude`.
    """
    found = [decode_solid(body) for body in solids]
    size = np.array([len(one.place) for one in found], np.int64)
    faces = np.array([len(one.triangles) for one in found], np.int64)
    vertex_start, triangle_start = _start(size), _start(faces)
    place = _joined([one.place for one in found], (0, 3), np.float64)
    kind = _joined([one.kind for one in found], (0,), np.uint8)
    triangles = _joined([one.triangles for one in found], (0, 3), np.int64)
    triangles += np.repeat(vertex_start[:-1], faces)[:, None]

    per_lon, per_lat = metres_per_degree(lat_deg)
    owner = np.repeat(np.arange(len(found)), size)
    lon_rad = np.radians(lon_deg[owner] + place[:, 0] / per_lon[owner])
    lat_rad = np.radians(lat_deg[owner] + place[:, 1] / per_lat[owner])
    up = place[:, 2]
    foot = np.where(up < _FOOT_M, plinth_m[owner], 0.0)
    axes = geodesy.enu_axes(np.radians(lon_deg), np.radians(lat_deg))
    vertices = np.zeros(len(place), VERTEX)
    normal = np.einsum("ij,ijk->ik", _normals(place, triangles), axes[owner])
    vertices["normal"][:, :3] = np.rint(127 * normal)
    vertices["flags"] = kind
    # Floors are counted from the lowest point, not from the foot; 16 bits with a sign.
    rise = np.clip(np.rint((up - foot) * 10), -32768, 32767)
    vertices["detail"][:, 0] = rise.astype(np.int16).view(np.uint16)
    return Prisms(
        lon_rad, lat_rad, low_m[owner] + up - foot, vertices, triangles, vertex_start,
        triangle_start,
    )  # fmt: skip


def _normals(place: Floats, triangles: Ints) -> Floats:
    """Return outward unit normals, (v, 3) east, north, up."""
    a, b, c = (place[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    corner = triangles.ravel()
    normal = np.column_stack(
        [np.bincount(corner, np.repeat(cross[:, k], 3), len(place)) for k in range(3)]
    )
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    return np.asarray(normal / length[:, None])


def mixed(prisms_a: Prisms, where_a: Ints, prisms_b: Prisms, where_b: Ints) -> Prisms:
    """Put two groups of meshes into one order.

    Parameters
    ----------
    where_a, where_b : (n,) and (m,) places in the result, together 0 to n + m - 1
    """
    order = np.argsort(np.concatenate((where_a, where_b)))
    both = (prisms_a, prisms_b)
    size = np.concatenate([np.diff(one.vertex_start) for one in both])
    faces = np.concatenate([np.diff(one.triangle_start) for one in both])
    from_vertex = _gather(size, order)
    from_triangle = _gather(faces, order)
    shift = len(prisms_a.vertices)
    triangles = np.concatenate((prisms_a.triangles, prisms_b.triangles + shift))
    to_vertex = np.empty(len(from_vertex), np.int64)
    to_vertex[from_vertex] = np.arange(len(from_vertex))
    return Prisms(
        np.concatenate([one.lon_rad for one in both])[from_vertex],
        np.concatenate([one.lat_rad for one in both])[from_vertex],
        np.concatenate([one.height_m for one in both])[from_vertex],
        np.concatenate([one.vertices for one in both])[from_vertex],
        to_vertex[triangles[from_triangle]],
        _start(size[order]),
        _start(faces[order]),
    )


def _gather(size: Ints, order: Ints) -> Ints:
    """Return where the elements of ragged things come from when these are reordered."""
    old, new = _start(size)[:-1][order], _start(size[order])
    return np.arange(int(new[-1])) + np.repeat(old - new[:-1], size[order])


def _start(size: Ints) -> Ints:
    return np.concatenate(([0], np.cumsum(size))).astype(np.int64)


def _joined(
    pieces: list[NDArray[Any]], empty: tuple[int, ...], dtype: type
) -> NDArray[Any]:
    return np.concatenate([np.zeros(empty, dtype), *pieces]).astype(dtype, copy=False)
