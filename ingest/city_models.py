# SPDX-License-Identifier: Apache-2.0
"""City models (CityJSON, CityJSONSeq, CityGML) as footprints with meshes of their own.

Textures and materials are left out: what is drawn is the shape, wall or roof.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.city_objects import CityObject, Faces, open_model
from ingest.citygml import read_citygml
from ingest.cityjson import read_cityjson
from ingest.footprints import Footprints
from ingest.model_crs import Placement, place_model
from ingest.model_solids import Built, build
from tiles.errors import InputError

_JSON_MODEL = re.compile(rb'"type"\s*:\s*"CityJSON(Feature)?"|"CityObjects"\s*:')
_MAX_CORNERS = 500_000
"""Corners of one part, so that it fits in memory whatever it holds."""
_MAX_COLUMNS = 500
_REST = "other_attributes"
_SAMPLE = 1000


def is_city_model(head: bytes, name: str) -> bool:
    """Tell whether a file is a city model.

    Parameters
    ----------
    head : its first 64 KiB, unpacked
    name : its name
    """
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text.startswith(b"<"):
        return b"opengis.net/citygml" in text
    if not text.startswith(b"{"):
        return False
    named = ".city.json" in name.lower() and b'"Feature' not in text
    return named or _JSON_MODEL.search(text) is not None


def read_city_model(
    path: str | Path,
    layer: str | None = None,
    crs: str | None = None,
    at_most: int = 50_000,
) -> Iterator[Footprints]:
    """Read a city model in parts of at most so many buildings.

    Parameters
    ----------
    path : CityJSON, CityJSONSeq or CityGML, also gzip
    layer : not for city models, which have none
    crs : CRS of the coordinates; overrides what the file says

    Raises
    ------
    InputError
        When the file can't be used at all; one line that says why and what to do.
    """
    path = Path(path)
    if layer is not None:
        raise InputError(path, f"no layer named {layer}", "a city model has no layers")
    if not path.is_file():
        raise InputError(path, "no such file", "check the path")
    notes: list[str] = []
    is_xml = _is_xml(path)
    objects = (read_citygml if is_xml else read_cityjson)(path, notes)
    reader = _Reader(path, crs, by_authority=is_xml)
    for group in _groups(objects, at_most):
        if group.usable:
            yield reader.part(group, notes)
        else:
            _refuse_empty(path, group)


def _is_xml(path: Path) -> bool:
    with open_model(path) as file:
        head: bytes = file.read(4096)
    return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<")


@dataclass(frozen=True, slots=True)
class _Group:
    """Objects of one CRS that are built together, and those that can't be used."""

    usable: list[CityObject]
    unusable: list[tuple[int, str]]


def _groups(objects: Iterator[CityObject], at_most: int) -> Iterator[_Group]:
    usable: list[CityObject] = []
    unusable: list[tuple[int, str]] = []
    corners = 0
    for one in objects:
        if one.faces is None:
            unusable.append((one.number, one.reason))
            continue
        full = len(usable) >= at_most or corners >= _MAX_CORNERS
        if usable and (full or one.srs != usable[0].srs):
            yield _Group(usable, unusable)
            usable, unusable, corners = [], [], 0
        usable.append(one)
        corners += len(one.faces.corner)
    yield _Group(usable, unusable)


def _refuse_empty(path: Path, group: _Group) -> None:
    reasons = Counter(reason for _, reason in group.unusable).most_common(3)
    words = ", ".join(f"{count} x {reason}" for reason, count in reasons)
    raise InputError(
        path, f"a city model without buildings ({words or 'no objects'})", "check the file"
    )


@dataclass(slots=True)
class _Reader:
    """Turns groups of objects to footprints; remembers the CRS."""

    path: Path
    crs: str | None
    by_authority: bool
    placements: dict[str | None, Placement] = field(default_factory=dict)

    def part(self, group: _Group, notes: list[str]) -> Footprints:
        faces = [one.faces for one in group.usable if one.faces is not None]
        placement = self._placement(group.usable[0].srs, faces, notes)
        built = build(faces, placement)
        notes += self._remarks(built)
        good = built.reason == ""
        objects = [one for one, fine in zip(group.usable, good, strict=True) if fine]
        bad = [
            (one.number, str(reason))
            for one, reason in zip(group.usable, built.reason, strict=True)
            if reason
        ]
        heard = tuple(dict.fromkeys(notes))
        notes.clear()
        return Footprints(
            self.path,
            "",
            placement.system.to_string(),
            np.array([one.number for one in objects], np.int64),
            built.geometry[good],
            columns_of([one.attributes for one in objects]),
            heard,
            built.solid[good],
            built.height_m[good],
            tuple(sorted(group.unusable + bad)),
        )

    def _placement(
        self, srs: str | None, faces: list[Faces], notes: list[str]
    ) -> Placement:
        if srs not in self.placements:
            xy = np.concatenate([one.corner[:1, :2] for one in faces[:_SAMPLE]])
            found = place_model(
                self.path, srs, self.crs, xy, by_authority=self.by_authority
            )
            notes += found.notes
            self.placements[srs] = found
        return self.placements[srs]

    def _remarks(self, built: Built) -> list[str]:
        name, found = self.path.name, []
        if built.dropped:
            found.append(f"{name}: {built.dropped} faces left out: no area, or there twice")
        if built.heavy:
            found.append(f"{name}: {built.heavy} buildings too detailed, drawn as prisms")
        return found


def columns_of(rows: Sequence[dict[str, Any]]) -> dict[str, NDArray[Any]]:
    """Return attributes by name, each (n,) numbers and texts, None where there is none.

    Lists and objects become JSON text. Of very many names the rare ones share a column.
    """
    counts = Counter(name for row in rows for name in row)
    names = [name for name, _ in counts.most_common(_MAX_COLUMNS)]
    columns = {name: np.full(len(rows), None, object) for name in names}
    rest = np.full(len(rows), None, object)
    for k, row in enumerate(rows):
        others = {}
        for name, value in row.items():
            if name in columns:
                columns[name][k] = _value(value)
            else:
                others[name] = value
        if others:
            rest[k] = _value(others)
    found = {_text(name): column for name, column in columns.items()}
    return found if len(counts) <= _MAX_COLUMNS else {**found, _REST: rest}


def _value(value: Any) -> Any:
    """Return a value that a JSON object and a database can hold."""
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float):
        return value
    try:
        return _text(json.dumps(value, ensure_ascii=False))
    except RecursionError:
        return "nested too deeply"


def _text(text: str) -> str:
    """Return text without halves of characters, which no encoding takes."""
    return text.encode("utf-8", "replace").decode("utf-8")
