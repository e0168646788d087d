# SPDX-License-Identifier: Apache-2.0
"""Footprints from vector files: pyogrio to shapely arrays in longitude and latitude.

A file is opened only by the driver that its first bytes name, so that a disguised file
can't make the reader open something else.
"""

import gzip
import json
import logging
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pyogrio.errors
import pyogrio.raw
import pyproj
import shapely
from numpy.typing import NDArray

from tiles.errors import InputError

Geometries = NDArray[np.object_]
_FORMATS = "GeoPackage, GeoJSON, GeoJSON lines, FlatGeobuf or Shapefile"
_LINES = {".geojsonl", ".geojsons", ".jsonl", ".ndjson", ".json-seq"}
_GZIP = b"\x1f\x8b"
_POLYGONAL = ("Polygon", "Surface", "Unknown", "GeometryCollection")
_READ_ERRORS = (
    pyogrio.errors.DataSourceError,
    pyogrio.errors.DataLayerError,
    pyogrio.errors.FeatureError,
    pyogrio.errors.FieldError,
    pyogrio.errors.GeometryError,
    UnicodeError,
    ValueError,
    RuntimeError,
)
# Reports reach the user through InputError and the ingest report, not as log lines.
logging.getLogger("pyogrio").setLevel(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class Footprints:
    """The features of one layer, as read; nothing is left out yet."""

    path: Path
    layer: str
    crs: str
    """CRS of the file, as text"""
    feature: NDArray[np.int64]
    """(n,) feature number in the file"""
    geometry: Geometries
    """(n,) shapely geometries in degrees (EPSG:4326), None where there is none"""
    columns: dict[str, NDArray[Any]]
    """attributes: field name to (n,) values, None or NaN where there is no value"""
    warnings: tuple[str, ...]


def read_footprints(
    path: str | Path, layer: str | None = None, crs: str | None = None
) -> Footprints:
    """Read a polygon layer and turn it to longitude and latitude.

    Parameters
    ----------
    path : GeoPackage, GeoJSON (also .gz), GeoJSON lines, FlatGeobuf or Shapefile
    layer : name of the layer; by default the first one that can hold polygons
    crs : CRS of the coordinates; overrides what the file says

    Raises
    ------
    InputError
        When the file can't be used at all; one line that says why and what to do.
    """
    path = Path(path)
    source = _openable(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        chosen, notes = _choose_layer(path, source, layer)
        meta, fids, wkb, values = _read(path, source, chosen)
        geometry = shapely.from_wkb(wkb, on_invalid="fix")
    _require_polygons(path, geometry)
    system = _system(path, crs or meta["crs"])
    geometry = _to_degrees(path, geometry, system)
    heard = {f"{path.name}: {warning.message}" for warning in caught}
    columns = dict(zip(meta["fields"].tolist(), values, strict=True))
    name = system.to_string()
    return Footprints(path, chosen, name, fids, geometry, columns, (*notes, *sorted(heard)))


def _openable(path: Path) -> str:
    """Return what to hand to GDAL so that only the driver of the first bytes opens it."""
    if not path.is_file():
        raise InputError(path, "no such file", "check the path")
    head, packed = _head(path)
    place = f"/vsigzip/{path.absolute()}" if packed else str(path.absolute())
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text.startswith((b"{", b"\x1e")):
        return ("GeoJSONSeq:" if _is_lines(path, text) else "GeoJSON:") + place
    if packed:
        raise InputError(path, "gzip of something else than GeoJSON", "unpack it first")
    geopackage = head.startswith(b"SQLite format 3\0") and head[68:70] == b"GP"
    if geopackage or head.startswith((b"fgb\x03", b"\x00\x00\x27\x0a")):
        return place
    if head.startswith(b"PK"):
        raise InputError(path, "a ZIP file", "unpack it and name the file inside")
    raise InputError(path, f"not a {_FORMATS} file", "convert it, for example with ogr2ogr")


def _head(path: Path) -> tuple[bytes, bool]:
    try:
        with path.open("rb") as file:
            head = file.read(65536)
        packed = head.startswith(_GZIP)
        if packed:
            with gzip.open(path) as file:
                head = file.read(65536)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(path, f"can't be read ({error})", "check the file") from error
    if not head.strip():
        raise InputError(path, "empty file", "check how it was made")
    return head, packed


def _is_lines(path: Path, text: bytes) -> bool:
    """Tell whether JSON text is one feature a line."""
    suffixes = {suffix.lower() for suffix in path.suffixes}
    if text.startswith(b"\x1e") or suffixes & _LINES:
        return True
    first, newline, rest = text.partition(b"\n")
    if not newline or not rest.lstrip().startswith(b"{"):
        return False
    try:
        return bool(json.loads(first).get("type") == "Feature")
    except (ValueError, AttributeError, RecursionError):
        return False


def _choose_layer(path: Path, source: str, layer: str | None) -> tuple[str, list[str]]:
    try:
        found = [(str(name), str(kind)) for name, kind in pyogrio.list_layers(source)]
    except _READ_ERRORS as error:
        raise _unreadable(path, error) from error
    names = [name for name, _ in found]
    if layer is not None and layer not in names:
        known = ", ".join(names[:10])
        raise InputError(path, f"no layer named {layer}", f"the layers are: {known}")
    fitting = [name for name, kind in found if any(word in kind for word in _POLYGONAL)]
    if layer is not None:
        return layer, []
    if not found:
        raise _unreadable(path, ValueError("no layers"))
    if not fitting:
        raise _no_polygons(path, ", ".join(sorted({kind for _, kind in found})))
    others = [f"{path.name}: took layer {fitting[0]} of {', '.join(fitting)} (--layer)"]
    return fitting[0], others if len(fitting) > 1 else []


def _read(
    path: Path, source: str, layer: str
) -> tuple[dict[str, Any], NDArray[np.int64], Geometries, list[NDArray[Any]]]:
    try:
        read = pyogrio.raw.read(
            source, layer=layer, return_fids=True, force_2d=True, datetime_as_string=True
        )
    except _READ_ERRORS as error:
        raise _unreadable(path, error) from error
    meta, fids, wkb, values = read
    if wkb is None:
        raise _no_polygons(path, f"layer {layer} has no geometry")
    if not len(wkb):
        raise InputError(path, f"no features in layer {layer}", "check how it was made")
    return meta, fids.astype(np.int64), wkb, list(values)


def _unreadable(path: Path, error: Exception) -> InputError:
    words = " ".join(str(error).split()).rstrip(".")
    return InputError(path, f"can't be read ({words[:200]})", "check or convert the file")


def _no_polygons(path: Path, found: str) -> InputError:
    return InputError(
        path, f"a vector without polygons ({found})", "name building footprints"
    )


def _require_polygons(path: Path, geometry: Geometries) -> None:
    kinds = shapely.get_type_id(geometry)
    if not np.isin(kinds, (3, 6, 7)).any():
        words = {g.geom_type for g in geometry[:1000] if g is not None}
        raise _no_polygons(path, ", ".join(sorted(words)) or "no geometry")


def _system(path: Path, crs: str | None) -> pyproj.CRS:
    if crs is None:
        raise InputError(path, "says no CRS", "name it with --crs, such as --crs EPSG:4326")
    try:
        return pyproj.CRS.from_user_input(crs).to_2d()
    except pyproj.exceptions.CRSError as error:
        raise InputError(
            path, f"unknown CRS {crs!r}", "use a code such as --crs EPSG:4326"
        ) from error


def _to_degrees(path: Path, geometry: Geometries, system: pyproj.CRS) -> Geometries:
    """Turn to EPSG:4326; refuse a file most of whose features can't be there."""
    target = pyproj.CRS.from_epsg(4326)
    if system != target:
        turn = pyproj.Transformer.from_crs(system, target, always_xy=True)

        def turned(xy: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.column_stack(turn.transform(xy[:, 0], xy[:, 1]))

        geometry = shapely.transform(geometry, turned)
    outside = outside_world(geometry)
    known = np.count_nonzero(~np.isnan(shapely.bounds(geometry)[:, 0]))
    if 2 * np.count_nonzero(outside) > known:
        west, south = shapely.bounds(geometry)[np.flatnonzero(outside)[0], :2]
        raise InputError(
            path,
            f"coordinates outside longitude +-180, latitude +-90 (such as "
            f"{west:.6g}, {south:.6g})",
            f"name the right CRS with --crs (read as {system.to_string()})",
        )
    return geometry


def outside_world(geometry: Geometries) -> NDArray[np.bool_]:
    """Tell which geometries leave longitude +-180, latitude +-90 (False where empty)."""
    bounds = shapely.bounds(geometry)
    low, high = bounds[:, :2] < (-180, -90), bounds[:, 2:] > (180, 90)
    return np.asarray((low | high).any(axis=1))
