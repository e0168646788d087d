# SPDX-License-Identifier: Apache-2.0
"""What the readers of city models hand on: one object, its attributes and its faces."""

import gzip
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from tiles.errors import InputError
from tiles.frames import Floats, Ints

ANY_SURFACE, WALL_SURFACE, ROOF_SURFACE, FLOOR_SURFACE = 0, 1, 2, 3
SURFACES: Final = {
    "WallSurface": WALL_SURFACE,
    "ClosureSurface": WALL_SURFACE,
    "RoofSurface": ROOF_SURFACE,
    "GroundSurface": FLOOR_SURFACE,
}
NOT_A_BUILDING = "not a building"
NO_GEOMETRY = "no geometry"


class UnusableError(Exception):
    """Why one object of a city model can't be used; the others can."""


@dataclass(frozen=True, slots=True)
class Faces:
    """Polygons with holes; the first ring of each is its outline."""

    corner: Floats
    """(p, 3) corners of all rings in the file's order, axes and units"""
    ring_start: Ints
    """(r + 1,) where each ring's corners begin"""
    face_start: Ints
    """(f + 1,) where each face's rings begin"""
    surface: NDArray[np.uint8]
    """(f,) what it is, ANY_SURFACE where the file does not say"""
    body: Ints
    """(f,) which of the object's geometries it belongs to"""


@dataclass(frozen=True, slots=True)
class CityObject:
    """A building (or a bridge) with its parts, or what else a file holds."""

    number: int
    """its number in the file"""
    srs: str | None = None
    """the CRS that the file names"""
    attributes: dict[str, Any] = field(default_factory=dict)
    faces: Faces | None = None
    reason: str = ""
    """why it can't be used; empty where it can"""


def joined(pieces: list[Faces]) -> Faces:
    """Put the faces of several geometries or objects one after the other."""
    if len(pieces) == 1:
        return pieces[0]
    corners = np.cumsum([0] + [len(piece.corner) for piece in pieces])
    rings = np.cumsum([0] + [len(piece.ring_start) - 1 for piece in pieces])
    bodies = np.cumsum([0] + [int(piece.body.max(initial=-1)) + 1 for piece in pieces])
    return Faces(
        np.concatenate([piece.corner for piece in pieces]),
        _starts([piece.ring_start for piece in pieces], corners),
        _starts([piece.face_start for piece in pieces], rings),
        np.concatenate([piece.surface for piece in pieces]),
        np.concatenate([p.body + k for p, k in zip(pieces, bodies, strict=False)]),
    )


def _starts(pieces: list[Ints], shift: Ints) -> Ints:
    ends = [piece[1:] + k for piece, k in zip(pieces, shift, strict=False)]
    return np.concatenate(([0], *ends)).astype(np.int64)


def chosen_lod(lods: list[float]) -> float:
    """Return the level of detail to take: 2 before 1, else the least above, else 0."""
    usual = [lod for lod in lods if 1 <= lod < 3]
    fine = [lod for lod in lods if lod >= 3]
    return max(usual) if usual else min(fine) if fine else max(lods)


def flat_attributes(values: dict[str, Any], ident: str, parts: int) -> dict[str, Any]:
    """Return attributes as numbers and texts, with the object's id and its parts."""
    found = {str(name): value for name, value in values.items() if value is not None}
    found.setdefault("id", ident)
    if parts:
        found.setdefault("parts", parts)
    return found


@contextmanager
def open_model(path: Path) -> Iterator[IO[bytes]]:
    """Open a file, unpacked where it is gzip; what goes wrong in reading is one line."""
    try:
        with path.open("rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            if packed:
                with gzip.open(file) as unpacked:
                    yield cast("IO[bytes]", unpacked)
            else:
                yield file
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(path, f"can't be read ({error})", "check the file") from error
