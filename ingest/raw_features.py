# SPDX-License-Identifier: Apache-2.0
"""What every vector reader gives: features as the file has them, part by part."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles.errors import InputError
from tiles.frames import Ints

Geometries = NDArray[np.object_]
Columns = dict[str, NDArray[Any]]
MAX_ITEM_BYTES = 64 << 20
"""A single feature longer than this as text is no building; bounds the memory too."""
MAX_PART_BYTES = 128 << 20
"""A part ends here at the latest, however few features it has."""


@dataclass(frozen=True, slots=True)
class RawFeatures:
    """A part of a layer: n features that could be read, and those that could not."""

    feature: Ints
    """(n,) number in the file"""
    geometry: Geometries
    """(n,) shapely geometries in the CRS of the file, None where there is none"""
    columns: Columns
    """attributes: field name to (n,) values, None or NaN where there is no value"""
    unreadable: tuple[tuple[int, str], ...] = ()
    """features that could not be read: number in the file, reason"""
    notes: tuple[str, ...] = ()
    """what the user should know"""


@dataclass(frozen=True, slots=True)
class RawLayer:
    """An open layer."""

    name: str
    crs: str | None
    """CRS as the file says it; None: it says none"""
    parts: Iterator[RawFeatures]
    notes: list[str] = field(default_factory=list)
    bbox: list[float] = field(default_factory=list)
    """west, south, east, north, as the file says; often empty"""


def objects(values: Sequence[Any]) -> NDArray[np.object_]:
    """Return values as an array of Python objects, lists among them kept whole."""
    array = np.empty(len(values), object)
    array[:] = values
    return array


def unreadable(path: Path, error: Exception | str) -> InputError:
    """Return the refusal of a file that a library could not read, in one line."""
    words = " ".join(str(error).split()).rstrip(".")
    return InputError(path, f"can't be read ({words[:200]})", "check or convert the file")


def no_polygons(path: Path, found: str) -> InputError:
    """Return the refusal of a file of points, lines or nothing."""
    return InputError(
        path, f"a vector without polygons ({found})", "name building footprints"
    )
