# SPDX-License-Identifier: Apache-2.0
"""The store's object table: footprints with heights and attributes, as rows.

A row's footprint is WKB in degrees. `raised_m` is the walls' lower edge above the
ground (a bridge, an upper storey), `base_m` that edge above the ellipsoid, without the
plinth; the roof is at `base_m + height_m`.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.footprints import Geometries
from tiles.frames import Floats, Ints
from tiles.store import Store
from tiles.writer import Writer


@dataclass(frozen=True, slots=True)
class ObjectRows:
    """n rows of the object table."""

    id: Ints
    polygon: Geometries
    """(n,) 2-D, degrees"""
    raised_m: Floats
    """(n,) walls' lower edge above the ground"""
    height_m: Floats
    """(n,) roof above the walls' lower edge"""
    cell: Ints
    base_m: Floats
    dimension_m: Floats
    """(n,) as last built; 0 in new rows"""


def read_objects(store: Store) -> ObjectRows:
    """Read the objects of all sources, without their attributes."""
    rows = store.connection.execute(
        "SELECT id, footprint, raised_m, height_m, cell, base_m, dimension_m"
        " FROM object ORDER BY id"
    ).fetchall()
    number, wkb, raised, height, cell, base, dimension = (
        zip(*rows, strict=True) if rows else [()] * 7
    )
    return ObjectRows(
        np.array(number, np.int64),
        np.asarray(shapely.from_wkb(np.array(wkb, object)), object),
        np.array(raised, np.float64),
        np.array(height, np.float64),
        np.array(cell, np.int64),
        np.array(base, np.float64),
        np.array(dimension, np.float64),
    )


def insert_objects(writer: Writer, name: str, new: "NewObjects") -> Ints:
    """Append objects of a source and return their ids; cells are assigned later."""
    found = writer.connection.execute("SELECT COALESCE(MAX(id), 0) FROM object").fetchone()
    number = int(found[0]) + 1 + np.arange(len(new.polygon))
    bounds = shapely.bounds(new.polygon)
    middle = (bounds[:, :2] + bounds[:, 2:]) / 2
    rows = zip(
        number.tolist(),
        [name] * len(number),
        middle[:, 0].tolist(),
        middle[:, 1].tolist(),
        new.raised_m.tolist(),
        new.height_m.tolist(),
        shapely.to_wkb(new.polygon).tolist(),
        new.attributes,
        strict=True,
    )
    writer.connection.executemany(
        "INSERT INTO object(id, source, cell, lon_deg, lat_deg, base_m, raised_m,"
        " height_m, dimension_m, footprint, attributes) VALUES(?,?,0,?,?,0,?,?,0,?,?)",
        rows,
    )
    return number


@dataclass(frozen=True, slots=True)
class NewObjects:
    """n objects to store."""

    polygon: Geometries
    raised_m: Floats
    height_m: Floats
    """(n,) roof above the walls' lower edge"""
    attributes: Sequence[str]
    """(n,) JSON"""


def update_places(
    writer: Writer, rows: ObjectRows, cell: Ints, base_m: Floats, dimension_m: Floats
) -> None:
    """Write down where objects are now, for those that changed."""
    moved = (
        (rows.cell != cell) | (rows.base_m != base_m) | (rows.dimension_m != dimension_m)
    )
    columns = (cell, base_m, dimension_m, rows.id)
    writer.connection.executemany(
        "UPDATE object SET cell=?, base_m=?, dimension_m=? WHERE id=?",
        zip(*(column[moved].tolist() for column in columns), strict=True),
    )


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
    return [json.dumps(one, ensure_ascii=False, default=str) for one in found]
