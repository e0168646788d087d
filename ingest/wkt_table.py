# SPDX-License-Identifier: Apache-2.0
"""CSV with one column of outlines, as WKT or as hexadecimal WKB."""

import csv
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import numpy as np
import shapely

from ingest.raw_features import (
    MAX_ITEM_BYTES,
    MAX_PART_BYTES,
    Geometries,
    RawFeatures,
    RawLayer,
    objects,
    unreadable,
)
from tiles.errors import InputError

_GEOMETRY_NAMES = (
    "wkt", "geom", "geometry", "the_geom", "wkb_geometry", "wkb", "geometry_wkt",
    "geom_wkt", "wkt_geom", "footprint", "polygon", "shape",
)  # fmt: skip
_DELIMITERS = ",;\t|"
_SUFFIXES = (".csv", ".tsv", ".csv.gz", ".tsv.gz")
_HEX = re.compile(r"[0-9A-Fa-f]{10,}")
_SRID = re.compile(r"SRID=(\d+);", re.IGNORECASE)


def is_table(name: str, head: bytes) -> bool:
    """Tell whether text begins with a line of column names, one of them of outlines."""
    if b"\0" in head:
        return False
    _, names = _header(head)
    return _column(names) is not None or (
        len(names) > 1 and name.lower().endswith(_SUFFIXES)
    )


def table_layer(path: Path, text: TextIO, at_most: int) -> RawLayer:
    """Open a CSV.

    Parameters
    ----------
    path : named in errors
    text : its lines
    at_most : features in a part
    """
    csv.field_size_limit(MAX_ITEM_BYTES)
    line = text.readline(1 << 20)
    delimiter, names = _header(line.encode())
    place = _column(names)
    if place is None:
        reason = f"a CSV without a column of WKT (columns: {', '.join(names)[:200]})"
        raise InputError(path, reason, f"call it {_GEOMETRY_NAMES[0]} or geometry")
    rows = csv.reader(text, delimiter=delimiter)
    first = next(rows, None)
    crs, notes = _system(path, first[place] if first and len(first) > place else "")
    parts = _parts(path, _again(first, rows), (names, place), at_most)
    return RawLayer(path.name, crs, parts, notes)


def _header(head: bytes) -> tuple[str, list[str]]:
    line = head.split(b"\n", 1)[0].decode("utf-8", "replace").strip("\r")
    delimiter = max(_DELIMITERS, key=line.count)
    try:
        return delimiter, next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return delimiter, []


def _column(names: list[str]) -> int | None:
    lower = [name.strip().lower() for name in names]
    found = [lower.index(name) for name in _GEOMETRY_NAMES if name in lower]
    return found[0] if found else None


def _system(path: Path, outline: str) -> tuple[str, list[str]]:
    named = _SRID.match(outline)
    if named:
        return f"EPSG:{named[1]}", []
    return "EPSG:4326", [f"{path.name}: a CSV says no CRS; taken as EPSG:4326 (--crs)"]


def _again(first: list[str] | None, rows: Iterator[list[str]]) -> Iterator[list[str]]:
    if first is not None:
        yield first
        yield from rows


def _parts(
    path: Path, rows: Iterator[list[str]], header: tuple[list[str], int], at_most: int
) -> Iterator[RawFeatures]:
    number, size = 0, 0
    held: list[list[str]] = []
    try:
        for row in rows:
            held.append(row)
            size += sum(map(len, row))
            if len(held) >= at_most or size > MAX_PART_BYTES:
                yield _part(held, number, *header)
                number, size, held = number + len(held), 0, []
    except csv.Error as error:
        raise unreadable(path, f"{error}, in row {number + len(held) + 1}") from error
    yield _part(held, number, *header)


def _part(rows: list[list[str]], first: int, names: list[str], place: int) -> RawFeatures:
    full = [k for k, row in enumerate(rows) if row]  # an empty line is no feature
    outline = [rows[k][place] if len(rows[k]) > place else "" for k in full]
    geometry = _geometries(outline)
    empty = np.array([not text.strip() for text in outline], bool)
    bad = (geometry == None) & ~empty  # noqa: E711 - for each element
    kept = np.flatnonzero(~bad)
    number = first + np.array(full, np.int64)
    columns = {
        name: objects([_value(rows[full[k]], column) for k in kept])
        for column, name in enumerate(names)
        if column != place
    }
    listed = tuple((int(k), "outline that is no WKT") for k in number[bad])
    notes = ("characters that are no UTF-8 were replaced",) if _has_marks(columns) else ()
    return RawFeatures(number[kept], geometry[kept], columns, listed, notes)


def _geometries(outline: list[str]) -> Geometries:
    made = np.full(len(outline), None, object)
    plain = [_SRID.sub("", text.strip(), count=1) for text in outline]
    is_hex = np.array([_HEX.fullmatch(text) is not None for text in plain], bool)
    texts = objects(plain)
    made[is_hex] = shapely.from_wkb(texts[is_hex], on_invalid="ignore")
    with np.errstate(over="ignore"):  # the repair finds what is not finite
        made[~is_hex] = shapely.from_wkt(texts[~is_hex], on_invalid="ignore")
    return made


def _value(row: list[str], column: int) -> str | None:
    return row[column] or None if column < len(row) else None


def _has_marks(columns: dict[str, Geometries]) -> bool:
    return any("\ufffd" in (v or "") for column in columns.values() for v in column)
