# SPDX-License-Identifier: Apache-2.0
"""CityJSON and CityJSONSeq: one object a building, with the geometry of its parts.

A sequence is read line by line. A single CityJSON document is one JSON value, so that it
is loaded whole and its size is limited.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np

from ingest.city_objects import (
    NO_GEOMETRY,
    NOT_A_BUILDING,
    CityObject,
    UnusableError,
    flat_attributes,
    joined,
    open_model,
)
from ingest.cityjson_faces import (
    Document,
    bodies_of,
    chosen_geometries,
    kind_of,
    vertices_of,
)
from tiles.errors import InputError
from tiles.frames import Floats

MAX_BYTES = 512 << 20
"""Largest document, and largest line of a sequence, unpacked; parsed it takes ten times
that."""
_ROOTS = {"Building", "BuildingPart", "Bridge", "BridgePart"}
_MEMBERS = {
    *_ROOTS,
    "BuildingInstallation", "BuildingConstructiveElement",
    "BridgeInstallation", "BridgeConstructiveElement",
}  # fmt: skip
_PARTS = {"BuildingPart", "BridgePart"}
_BAD_JSON = (ValueError, RecursionError, MemoryError)


@dataclass(slots=True)
class _Head:
    """What holds for all objects of a file."""

    srs: str | None = None
    scale: Floats = field(default_factory=lambda: np.ones(3))
    translate: Floats = field(default_factory=lambda: np.zeros(3))
    notes: list[str] = field(default_factory=list)
    count: int = 0


def read_cityjson(path: Path, notes: list[str]) -> Iterator[CityObject]:
    """Read the objects of a CityJSON or CityJSONSeq file, also gzip.

    Parameters
    ----------
    notes : filled with warnings about the file

    Raises
    ------
    InputError
        Where the file is not what it says it is, or too large.
    """
    head = _Head(notes=notes)
    with open_model(path) as stream:
        first = _line(path, stream)
        second = _line(path, stream)
        while second and not second.strip():
            second = _line(path, stream)
        if second and _type_of(first) != "CityJSON":
            rest = stream.read(MAX_BYTES - len(first) - len(second) + 1)
            first, second = first + second + rest, b""
            _require_size(path, first)
        yield from _document_objects(path, _parsed(path, first, head), head)
        while second:
            yield from _line_objects(second, head)
            second = _line(path, stream)


def _line(path: Path, stream: IO[bytes]) -> bytes:
    line = stream.readline(MAX_BYTES + 1)
    _require_size(path, line)
    return line


def _require_size(path: Path, text: bytes) -> None:
    if len(text) > MAX_BYTES:
        limit = f"larger than {MAX_BYTES >> 20} MiB unpacked"
        raise InputError(path, limit, "make it a CityJSONSeq, for example with cjseq")


def _type_of(line: bytes) -> str:
    try:
        return str(json.loads(line)["type"])
    except (*_BAD_JSON, KeyError, TypeError):
        return ""


def _parsed(path: Path, text: bytes, head: _Head) -> Document:
    try:
        document = _loads(text, head, path.name)
    except _BAD_JSON as error:
        words = str(error)[:200] or type(error).__name__
        raise InputError(path, f"not JSON ({words})", "check the file") from error
    kind = document.get("type") if isinstance(document, dict) else None
    if kind != "CityJSON":
        raise InputError(
            path,
            f"not CityJSON (type {str(kind)[:40]!r})",
            "a sequence of features begins with a line of type CityJSON",
        )
    version = str(document.get("version"))
    if not version.startswith(("1.", "2.")):
        head.notes.append(f"{path.name}: CityJSON {version[:20]}, read as 2.0")
    return dict(document)


def _loads(text: bytes, head: _Head, name: str) -> Any:
    """Parse JSON; an object that has a name twice is noted, as one of the two is lost."""

    def unique(pairs: list[tuple[str, Any]]) -> Document:
        found = dict(pairs)
        if len(found) < len(pairs):
            head.notes.append(f"{name}: {len(pairs) - len(found)} names occur twice")
        return found

    return json.loads(text, object_pairs_hook=unique)


def _document_objects(path: Path, document: Document, head: _Head) -> Iterator[CityObject]:
    metadata = document.get("metadata")
    srs = metadata.get("referenceSystem") if isinstance(metadata, dict) else None
    head.srs = srs if isinstance(srs, str) else None
    transform = document.get("transform")
    if transform is not None:
        head.scale, head.translate = _transform(path, transform)
    yield from _objects(document, head)


def _transform(path: Path, transform: Any) -> tuple[Floats, Floats]:
    try:
        scale = np.array(transform["scale"], np.float64)
        translate = np.array(transform["translate"], np.float64)
    except (TypeError, ValueError, KeyError, OverflowError):
        scale = translate = np.full(3, np.nan)
    if scale.shape != (3,) or translate.shape != (3,) or not _finite(scale, translate):
        raise InputError(path, "transform without 3 numbers each", "check the file")
    return scale, translate


def _finite(*values: Floats) -> bool:
    return all(np.isfinite(one).all() for one in values)


def _line_objects(line: bytes, head: _Head) -> Iterator[CityObject]:
    if not line.strip():
        return
    try:
        feature = _loads(line, head, "a feature")
    except _BAD_JSON:
        feature = None
    if not isinstance(feature, dict) or feature.get("type") != "CityJSONFeature":
        yield CityObject(_next(head), reason="a line that is no CityJSONFeature")
        return
    yield from _objects(feature, head)


def _next(head: _Head) -> int:
    head.count += 1
    return head.count - 1


def _objects(document: Document, head: _Head) -> Iterator[CityObject]:
    """Yield the objects that are part of no other, with what belongs to them."""
    objects = document.get("CityObjects")
    if not isinstance(objects, dict):
        yield CityObject(_next(head), reason="no CityObjects")
        return
    vertices = vertices_of(document.get("vertices")) * head.scale + head.translate
    children = _children(objects)
    inner = set(chain.from_iterable(children.values()))
    seen: set[str] = set()
    # What is only in a circle of parents comes second, and stands for itself.
    for ident in chain((k for k in objects if k not in inner), objects):
        if ident in seen:
            continue
        family = _family(ident, children, seen)
        number = _next(head)
        try:
            yield _city_object(number, objects, family, vertices, head.srs)
        except UnusableError as error:
            yield CityObject(number, reason=str(error))


def _children(objects: Document) -> dict[str, list[str]]:
    """Return the children of each object, whichever of the two names the other."""
    found: dict[str, list[str]] = {ident: [] for ident in objects}
    for ident, one in objects.items():
        for child in _names(one, "children"):
            if child in found and child != ident:
                found[ident].append(child)
        for parent in _names(one, "parents"):
            if parent in found and parent != ident:
                found[parent].append(ident)
    return found


def _names(one: Any, key: str) -> list[str]:
    names = one.get(key) if isinstance(one, dict) else None
    return [n for n in names if isinstance(n, str)] if isinstance(names, list) else []


def _family(ident: str, children: dict[str, list[str]], seen: set[str]) -> list[str]:
    """Return an object and all below it that belong to no other yet."""
    found, ahead = [], [ident]
    while ahead:
        one = ahead.pop()
        if one not in seen:
            seen.add(one)
            found.append(one)
            ahead += reversed(children[one])
    return found


def _city_object(
    number: int, objects: Document, family: list[str], vertices: Floats, srs: str | None
) -> CityObject:
    root, *rest = (objects[ident] for ident in family)
    kind = kind_of(root)
    if kind not in _ROOTS:
        raise UnusableError(f"{kind[:60] or 'no type'}: {NOT_A_BUILDING}")
    members = [one for one in rest if kind_of(one) in _MEMBERS]
    is_part = [kind_of(one) in _PARTS for one in members]
    attributes = root.get("attributes")
    attributes = dict(attributes) if isinstance(attributes, dict) else {}
    if root.get("address") is not None:
        attributes.setdefault("address", root["address"])
    attributes = flat_attributes(attributes, family[0], sum(is_part))
    own, below = chosen_geometries(root), [chosen_geometries(one) for one in members]
    lods = [lod for (lod, _), part in zip(below, is_part, strict=True) if part]
    fine = max(lods, default=-1.0)
    # A coarse hull of the whole would hide its finer parts.
    shown = [own, *below] if own[0] >= int(fine) else below
    pieces = [
        piece
        for _, chosen in shown
        for geometry in chosen
        for piece in bodies_of(geometry, vertices)
    ]
    if not pieces:
        raise UnusableError(NO_GEOMETRY)
    return CityObject(number, srs, attributes, joined(pieces))
