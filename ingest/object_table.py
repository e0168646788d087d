# SPDX-License-Identifier: Apache-2.0
"""The store's object table: footprints with heights and attributes, as rows.

A row's footprint is WKB in degrees. `raised_m` is the walls' lower edge above the
ground (a bridge, an upper storey), `base_m` that edge above the ellipsoid, without the
plinth; the roof is at `base_m + height_m`.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ingest.extrude import CORNER_VERTICES
from ingest.object_plan import Outline
from tiles.codec import zstd
from tiles.frames import Floats, Ints
from tiles.store import Store
from tiles.writer import Writer

AT_ONCE = 50_000
_CORNER_BYTES = 16
_SOLID_VERTEX_BYTES = 15
"""A vertex of a solid, and its third of a triangle"""
_OUTLINE = (
    "SELECT id, lon_deg, lat_deg, dimension_m, length(footprint), substr(solid, 1, 18)"
    " FROM object ORDER BY id"
)
_SHAPES = (
    "SELECT id, footprint, raised_m, height_m, solid FROM object"
    " WHERE id IN (SELECT value FROM json_each(?)) ORDER BY id"
)
_INSERT = (
    "INSERT INTO object(id, source, cell, lon_deg, lat_deg, base_m, raised_m, height_m,"
    " dimension_m, footprint, solid, attributes) VALUES(?,?,0,?,?,0,?,?,?,?,?,?)"
)


@dataclass(frozen=True, slots=True)
class ObjectRows:
    """What n objects look like, as stored."""

    id: Ints
    footprint: list[bytes]
    """(n,) WKB, degrees"""
    raised_m: Floats
    """(n,) walls' lower edge above the ground"""
    height_m: Floats
    """(n,) roof above the walls' lower edge"""
    solid: NDArray[np.object_]
    """(n,) bodies of city models, None for prisms"""


@dataclass(frozen=True, slots=True)
class NewObjects:
    """n objects to store."""

    footprint: list[bytes]
    lon_deg: Floats
    lat_deg: Floats
    raised_m: Floats
    height_m: Floats
    dimension_m: Floats
    solid: list[bytes | None]
    attributes: list[str]
    """(n,) JSON"""


def outline_of(store: Store) -> Outline:
    """Read a few numbers of the objects of all sources."""
    found = store.connection.execute(_OUTLINE)
    none = [np.zeros((0, 5))]
    columns = np.concatenate(none + [_outline(rows) for rows in _many(found)]).T
    number, lon_deg, lat_deg, dimension_m, vertex_count = columns
    whole = number.astype(np.int64), vertex_count.astype(np.int64)
    return Outline(whole[0], lon_deg, lat_deg, dimension_m, whole[1])


def _outline(rows: Sequence[tuple[Any, ...]]) -> Floats:
    columns = list(zip(*rows, strict=True))
    found = np.array(columns[:5], np.float64).T
    found[:, 4] = CORNER_VERTICES * (found[:, 4] // _CORNER_BYTES)
    solid = [k for k, head in enumerate(columns[5]) if head is not None]
    found[solid, 4] = [vertices_at_most(columns[5][k]) for k in solid]
    return found


def vertices_at_most(head: bytes) -> int:
    """Return an upper bound of a solid's vertices, from the first 18 bytes of its body."""
    return zstd.get_frame_info(head).decompressed_size // _SOLID_VERTEX_BYTES


def _many(cursor: Any) -> Iterator[list[tuple[Any, ...]]]:
    while rows := cursor.fetchmany(AT_ONCE):
        yield rows


def read_shapes(store: Store, ids: Ints) -> ObjectRows:
    """Read what objects look like, in the order of `ids`, (n,)."""
    found = store.connection.execute(_SHAPES, (json.dumps(ids.tolist()),)).fetchall()
    rank = np.argsort(np.argsort(ids)).tolist()
    columns = zip(*[found[k] for k in rank], strict=True) if found else [()] * 5
    _, footprint, raised, height, solid = columns
    return ObjectRows(
        ids,
        list(footprint),
        np.array(raised, np.float64),
        np.array(height, np.float64),
        np.array([*solid, None], object)[:-1],
    )


def highest_id(store: Store) -> int:
    """Return the highest id in use, 0 in an empty table."""
    found = store.connection.execute("SELECT COALESCE(MAX(id), 0) FROM object").fetchone()
    return int(found[0])


def insert_objects(writer: Writer, name: str, first: int, new: NewObjects) -> Ints:
    """Append objects of a source and return their ids; cells are assigned later.

    Parameters
    ----------
    first : id of the first of them
    """
    number = first + np.arange(len(new.footprint))
    rows = zip(
        number.tolist(),
        [name] * len(number),
        new.lon_deg.tolist(),
        new.lat_deg.tolist(),
        new.raised_m.tolist(),
        new.height_m.tolist(),
        new.dimension_m.tolist(),
        new.footprint,
        new.solid,
        new.attributes,
        strict=True,
    )
    writer.connection.executemany(_INSERT, rows)
    return number


def delete_objects(writer: Writer, ids: Ints) -> None:
    """Take objects out again."""
    rows = ((one,) for one in ids.tolist())
    writer.connection.executemany("DELETE FROM object WHERE id=?", rows)


def update_places(writer: Writer, ids: Ints, cell: Ints, base_m: Floats) -> None:
    """Write down where objects are now, (n,) each; ids ascend."""
    for k in range(0, len(ids), AT_ONCE):
        columns = (cell, base_m, ids)
        rows = zip(*(column[k : k + AT_ONCE].tolist() for column in columns), strict=True)
        writer.connection.executemany("UPDATE object SET cell=?, base_m=? WHERE id=?", rows)


def attributes_json(columns: Mapping[str, NDArray[Any]], rows: Ints) -> list[str]:
    """Return the attributes of some features as JSON objects; missing values left out."""
    found: list[dict[str, Any]] = [{} for _ in range(len(rows))]
    for name, column in columns.items():
        values = column[rows]
        if values.dtype.kind == "f":
            present = np.flatnonzero(np.isfinite(values))
        else:
            present = np.flatnonzero([value is not None for value in values.tolist()])
        for row, value in zip(present.tolist(), values[present].tolist(), strict=True):
            found[row][name] = value
    encode = msgspec.json.Encoder(enc_hook=str).encode
    return [encode(one).decode() for one in found]
