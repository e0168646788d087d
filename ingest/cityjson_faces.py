# SPDX-License-Identifier: Apache-2.0
"""Geometries of CityJSON: which one to take, its outer faces, what they are."""

from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np

from ingest.city_objects import (
    ANY_SURFACE,
    NO_GEOMETRY,
    SURFACES,
    Faces,
    UnusableError,
    chosen_lod,
)
from tiles.frames import Floats, Ints

_SURFACE_KINDS = {"MultiSurface", "CompositeSurface"}
_SOLID_KINDS = {"Solid", "MultiSolid", "CompositeSolid"}

Document = dict[str, Any]


def vertices_of(values: Any) -> Floats:
    """Return (n, 3) vertices; NaN where one is not three numbers."""
    if not isinstance(values, list) or not values:
        return np.zeros((0, 3))
    try:
        found = np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.shape == (len(values), 3):
        return found
    return np.array([_vertex(value) for value in values], np.float64)


def _vertex(value: Any) -> tuple[float, float, float]:
    try:
        x, y, z = value
        return float(x), float(y), float(z)
    except (TypeError, ValueError, OverflowError):
        return np.nan, np.nan, np.nan


def kind_of(one: Any) -> str:
    """Return the type of an object or a geometry, empty where it has none."""
    kind = one.get("type") if isinstance(one, dict) else None
    return kind if isinstance(kind, str) else ""


def chosen_geometries(one: Document) -> tuple[float, list[Document]]:
    """Return the chosen level of detail, -1 for none, and the geometries to take."""
    found = _listed(one.get("geometry"))
    solid = [g for g in found if kind_of(g) in _SOLID_KINDS]
    flat = [g for g in found if kind_of(g) in _SURFACE_KINDS]
    if not solid and not flat:
        return -1.0, []
    lod = chosen_lod([_lod(g) for g in solid + flat])
    solid, flat = ([g for g in some if _lod(g) == lod] for some in (solid, flat))
    # Both say the same; surfaces win only where they alone say what is roof and floor.
    return lod, flat if _told(flat) > _told(solid) or not solid else solid


def _told(geometries: list[Document]) -> bool:
    return any(isinstance(g.get("semantics"), dict) for g in geometries)


def _lod(geometry: Document) -> float:
    try:
        lod = float(geometry.get("lod", 1))
    except (TypeError, ValueError):
        return 1.0
    return lod if 0 <= lod < 10 else 1.0


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def bodies_of(geometry: Document, vertices: Floats) -> Iterator[Faces]:
    """Yield the outer shell of each solid, or all surfaces."""
    boundaries = _listed(geometry.get("boundaries"))
    semantics = geometry.get("semantics")
    semantics = semantics if isinstance(semantics, dict) else {}
    kinds = [_surface(surface) for surface in _listed(semantics.get("surfaces"))]
    values = _listed(semantics.get("values"))
    if geometry["type"] in _SURFACE_KINDS:
        shells = [(boundaries, values)]
    elif geometry["type"] == "Solid":
        shells = [(_first(boundaries), _first(values))]
    else:
        values += [None] * (len(boundaries) - len(values))
        pairs = zip(boundaries, values, strict=False)
        shells = [(_first(_listed(b)), _first(_listed(v))) for b, v in pairs]
    for faces, value in shells:
        if faces:
            yield _faces(faces, value, kinds, vertices)


def _first(shells: list[Any]) -> list[Any]:
    return _listed(shells[0]) if shells else []


def _surface(surface: Any) -> int:
    return SURFACES.get(kind_of(surface), ANY_SURFACE)


def _faces(
    faces: list[Any], values: list[Any], kinds: list[int], vertices: Floats
) -> Faces:
    try:
        rings = list(chain.from_iterable(faces))
        index = np.array(list(chain.from_iterable(rings)))
        ring_size, face_size = list(map(len, rings)), list(map(len, faces))
    except (TypeError, ValueError, OverflowError) as error:
        raise UnusableError("boundaries that are no rings of vertices") from error
    if not index.size:
        raise UnusableError(NO_GEOMETRY)
    if index.dtype.kind != "i" or index.ndim != 1:
        raise UnusableError("boundaries that are no rings of vertices")
    if index.min() < 0 or index.max() >= len(vertices):
        raise UnusableError("a vertex that is not there")
    surface = np.full(len(faces), ANY_SURFACE, np.uint8)
    if len(values) == len(faces):
        surface[:] = [_kind(value, kinds) for value in values]
    corner = vertices[index]
    if not np.isfinite(corner).all():
        raise UnusableError("a vertex that is not three numbers")
    return Faces(
        corner, _start(ring_size), _start(face_size), surface,
        np.zeros(len(faces), np.int64),
    )  # fmt: skip


def _kind(value: Any, kinds: list[int]) -> int:
    known = isinstance(value, int) and 0 <= value < len(kinds)
    return kinds[value] if known else ANY_SURFACE


def _start(sizes: list[int]) -> Ints:
    return np.concatenate(([0], np.cumsum(sizes))).astype(np.int64)
