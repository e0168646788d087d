# SPDX-License-Identifier: Apache-2.0
"""GeoParquet with a WKB column, through pyarrow (an extra), batch by batch."""

import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.opening import Opening
from ingest.raw_features import RawFeatures, RawLayer, objects, unreadable
from ingest.vectors import from_wkb
from tiles.errors import InputError


def parquet_layer(file: Opening, at_most: int) -> RawLayer:
    """Open a GeoParquet file.

    Parameters
    ----------
    file : Parquet
    at_most : features in a part
    """
    path = file.path
    try:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise InputError(
            path, "GeoParquet needs pyarrow", "pip install geopage[geoparquet]"
        ) from None
    try:
        table = file.closing.enter_context(parquet.ParquetFile(file.place))
        geo = json.loads((table.schema_arrow.metadata or {}).get(b"geo", b"null"))
    except (arrow.ArrowException, OSError, ValueError, RecursionError) as error:
        raise unreadable(path, error) from error
    column, crs = _geometry_column(path, geo)
    if column not in table.schema_arrow.names:
        raise unreadable(path, f"no column {column}")
    parts = _parts(path, table, column, at_most)
    return RawLayer(path.name, crs, _without_arrow_errors(path, arrow, parts))


def _geometry_column(path: Path, geo: Any) -> tuple[str, str | None]:
    """Return the name of the column of geometries and its CRS."""
    try:
        name = geo["primary_column"]
        about = geo["columns"][name]
        encoding = about["encoding"]
    except (TypeError, KeyError):
        raise InputError(
            path, "a Parquet file that is no GeoParquet", "write it with a GeoParquet tool"
        ) from None
    if encoding != "WKB":
        raise InputError(
            path, f"geometries encoded as {encoding}", "write it with WKB geometries"
        )
    if "crs" not in about:
        return str(name), "OGC:CRS84"
    crs = about["crs"]
    return str(name), None if crs is None else json.dumps(crs)


def _without_arrow_errors(
    path: Path, arrow: Any, parts: Iterator[RawFeatures]
) -> Iterator[RawFeatures]:
    try:
        yield from parts
    except (arrow.ArrowException, OSError, ValueError) as error:
        raise unreadable(path, error) from error


def _parts(path: Path, file: Any, column: str, at_most: int) -> Iterator[RawFeatures]:
    number = 0
    for batch in file.iter_batches(batch_size=at_most):
        columns = dict(zip(batch.schema.names, batch.columns, strict=True))
        wkb = objects(columns.pop(column).to_pylist())
        if not all(one is None or isinstance(one, bytes) for one in wkb):
            raise unreadable(path, f"column {column} is no WKB")
        columns.pop("bbox", None)  # the box of the geometry again, to search by
        values = {name: _values(one) for name, one in columns.items()}
        yield from_wkb(number + np.arange(len(wkb)), wkb, values)
        number += len(wkb)


def _values(column: Any) -> NDArray[Any]:
    """Return numbers as numbers; whole ones with gaps, texts and lists as objects."""
    kind = column.type.to_pandas_dtype() if column.type.num_buffers == 2 else object
    try:
        is_number = np.dtype(kind).kind in "iuf"
    except TypeError:
        is_number = False
    if is_number and not column.null_count:
        return np.asarray(column.to_numpy(zero_copy_only=False))
    return objects(column.to_pylist())
