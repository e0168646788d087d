# SPDX-License-Identifier: Apache-2.0
"""GeoJSON, as a collection or as one feature a line: streamed, broken features listed.

Features are parsed one by one, so that one that is broken costs itself alone. Values of
attributes are what the JSON says, whole numbers whole.
"""

import json
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ingest.attribute_columns import columns_of
from ingest.geojson_feature import (
    BROKEN,
    GEOMETRIES,
    NO_GEOMETRY,
    TOO_DEEP,
    UnreadableError,
    patiently,
    quickly,
    type_of,
    whole_characters,
)
from ingest.json_split import split_features
from ingest.raw_features import (
    MAX_ITEM_BYTES,
    MAX_PART_BYTES,
    RawFeatures,
    RawLayer,
    unreadable,
)
from ingest.rings import Rings
from tiles.errors import InputError

_BLOCK_BYTES = 1 << 20


def geojson_layer(
    path: Path, file: BinaryIO, at_most: int, crs: str | None = None
) -> RawLayer:
    """Open a FeatureCollection, a Feature or a geometry.

    Parameters
    ----------
    path : named in errors
    file : the text, without a byte order mark
    at_most : features in a part
    crs : as the user names it, if so
    """
    outside = bytearray()
    batches = split_features(path, file, outside)
    if next(batches, None) is None:  # no collection: one feature or geometry is all
        _whole(path, bytes(outside))
        return RawLayer(path.name, "OGC:CRS84", _parts([[bytes(outside)]], at_most))
    head = _whole(path, bytes(outside) + b"]}")
    bbox = head.get("bbox")
    crs = crs or _crs_of(path, head)
    parts = _parts(_until_end(path, batches, outside, crs), at_most)
    layer = RawLayer(str(head.get("name", path.name)), crs, parts)
    if isinstance(bbox, list) and len(bbox) in {4, 6}:
        layer.bbox.extend(bbox[:2] + bbox[len(bbox) // 2 :][:2])
    return layer


def geojson_lines_layer(path: Path, file: BinaryIO, at_most: int) -> RawLayer:
    """Open a text of one Feature a line, or of Features each after a record separator."""
    return RawLayer(path.name, "OGC:CRS84", _parts(_records(path, file), at_most))


def _until_end(
    path: Path, batches: Iterator[list[bytes]], outside: bytearray, crs: str | None
) -> Iterator[list[bytes]]:
    yield from batches
    whole = _whole(path, bytes(outside))
    if "crs" in whole and crs == "OGC:CRS84" and _crs_of(path, whole) != crs:
        reason = f"says its CRS ({_crs_of(path, whole)}) only after its features"
        raise InputError(path, reason, "name it with --crs")


def _whole(path: Path, text: bytes) -> dict[str, Any]:
    """Check what is around the features, or the only feature."""
    try:
        found = whole_characters(json.loads(text.decode("utf-8", "replace")))
    except RecursionError:
        raise unreadable(path, TOO_DEEP) from None
    except ValueError as error:
        raise unreadable(path, f"{BROKEN}: {error}") from None
    kind = type_of(found)
    fits = kind == ("FeatureCollection" if "features" in found else "Feature")
    if not fits and (kind not in GEOMETRIES or "features" in found):
        raise unreadable(path, f"JSON of type {kind}, not GeoJSON")
    return dict(found)


def _crs_of(path: Path, head: dict[str, Any]) -> str | None:
    """Return the CRS that an old or a projected GeoJSON names."""
    if "crs" not in head:
        return "OGC:CRS84"
    try:
        return str(head["crs"]["properties"]["name"])
    except (TypeError, KeyError):
        if head["crs"] is None:
            return None
        raise unreadable(path, "a crs member that names no CRS") from None


def _records(path: Path, file: BinaryIO) -> Iterator[list[bytes]]:
    """Give the records of a text sequence, or its lines; empty ones keep their number."""
    rest = file.read(_BLOCK_BYTES)
    separator = b"\x1e" if rest.lstrip().startswith(b"\x1e") else b"\n"
    if separator == b"\x1e":
        rest = rest.lstrip()[1:]
    while block := file.read(_BLOCK_BYTES):
        *whole, rest = (rest + block).split(separator)
        if whole:
            yield whole
        if len(rest) > MAX_ITEM_BYTES:
            raise unreadable(path, "a feature longer than 64 MiB")
    yield rest.split(separator)


def _parts(batches: Iterable[list[bytes]], at_most: int) -> Iterator[RawFeatures]:
    part, size = _Part(0), 0
    for text in chain.from_iterable(batches):
        part.add(text)
        size += len(text)
        if len(part.number) >= at_most or size >= MAX_PART_BYTES:
            yield part.finished()
            part, size = _Part(part.next), 0
    yield part.finished()


class _Part:
    """A part that grows by one feature at a time."""

    def __init__(self, first: int) -> None:
        self.next = first
        self.number: list[int] = []
        self.properties: list[dict[str, Any]] = []
        self.rings = Rings()
        self.others: dict[int, Any] = {}
        self.unreadable: list[tuple[int, str]] = []
        self.notes: dict[str, None] = {}

    def add(self, text: bytes) -> None:
        number = self.next
        self.next += 1
        other = None
        try:
            feature = quickly(text)
            if feature is None:
                if not text.strip():
                    return
                feature, other = patiently(text, self.notes)
        except UnreadableError as error:
            self.unreadable.append((number, str(error)))
            return
        if not self.rings.add(feature.geometry.polygons if feature.geometry else []):
            self.unreadable.append((number, NO_GEOMETRY))
            return
        if other is not None:
            self.others[len(self.number)] = other
        self.number.append(number)
        found = feature.properties or {}
        if isinstance(feature.id, str | int):
            found.setdefault("id", feature.id)
        self.properties.append(found)

    def finished(self) -> RawFeatures:
        geometry = self.rings.geometries()
        for place, other in self.others.items():
            geometry[place] = other
        return RawFeatures(
            np.array(self.number, np.int64),
            geometry,
            columns_of(self.properties),
            tuple(self.unreadable),
            (*self.rings.notes(), *self.notes),
        )
