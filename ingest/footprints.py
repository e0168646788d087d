# SPDX-License-Identifier: Apache-2.0
"""Footprints from vector files: shapely arrays in longitude and latitude, streamed."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.attribute_columns import MAX_COLUMNS
from ingest.degrees import ToDegrees
from ingest.geojson import geojson_layer, geojson_lines_layer
from ingest.geoparquet import parquet_layer
from ingest.opening import Kind, Opening, opened
from ingest.osm import osm_layer
from ingest.raw_features import Geometries, RawFeatures, RawLayer, no_polygons, objects
from ingest.vectors import gdal_layer
from ingest.wkt_table import table_layer
from tiles.errors import InputError
from tiles.frames import Floats

__all__ = ["Footprints", "Geometries", "read_parts"]
_POLYGONAL = (3, 6, 7)


@dataclass(frozen=True, slots=True)
class Footprints:
    """Features of one layer, as read; nothing is left out yet."""

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
    solid: NDArray[np.object_] | None = None
    """(n,) body of a city model, as bytes, None where a feature has none"""
    height_m: Floats | None = None
    """(n,) height from the geometry, NaN where unknown"""
    unreadable: tuple[tuple[int, str], ...] = ()
    """features that could not be read: number in the file, reason"""


def read_parts(
    path: str | Path,
    layer: str | None = None,
    crs: str | None = None,
    at_most: int = 50_000,
) -> Iterator[Footprints]:
    """Read a polygon layer in parts, turned to longitude and latitude.

    Memory is bounded by the size of a part, not of the file. Where every feature names
    its own fields (GeoJSON, OSM), a part may have columns that parts before it lack.

    Parameters
    ----------
    path : any of `opening.FORMATS`, text also as .gz, one file also in a .zip
    layer : by default the first one that can hold polygons, rather one called buildings
    crs : CRS of the coordinates; overrides what the file says
    at_most : features in a part

    Raises
    ------
    InputError
        When the file can't be used at all, also after some parts; one line that says
        why and what to do.
    """
    path = Path(path)
    with opened(path) as file:
        if file.kind is Kind.MODEL:
            yield from _model(file, layer, crs, at_most)
        else:
            yield from _degrees(file, _layer(file, layer, crs, at_most), crs)


def _model(
    file: Opening, layer: str | None, crs: str | None, at_most: int
) -> Iterator[Footprints]:
    # It makes Footprints, so it can't be imported before they are.
    from ingest.city_models import read_city_model  # noqa: PLC0415

    try:
        for part in read_city_model(file.place, layer, crs, at_most):
            yield replace(part, path=file.path)
    except InputError as error:
        _, *words = error.args
        raise InputError(file.path, *words) from error


def _layer(file: Opening, layer: str | None, crs: str | None, at_most: int) -> RawLayer:
    if file.kind is Kind.GDAL:
        return gdal_layer(file.path, str(file.place.absolute()), layer, at_most)
    if file.kind is Kind.OSM:
        packed = "/vsigzip/" if file.is_gzip else ""
        return osm_layer(file.path, f"{packed}{file.place.absolute()}", layer, at_most)
    if file.kind is Kind.PARQUET:
        found = parquet_layer(file, at_most)
    elif file.kind is Kind.TABLE:
        found = table_layer(file.path, file.lines(), at_most)
    elif file.kind is Kind.LINES:
        found = geojson_lines_layer(file.path, file.text(), at_most)
    else:
        found = geojson_layer(file.path, file.text(), at_most, crs)
    if layer not in {None, found.name}:
        reason = f"no layer named {layer}"
        raise InputError(file.path, reason, f"the layers are: {found.name}")
    return found


def _degrees(file: Opening, layer: RawLayer, crs: str | None) -> Iterator[Footprints]:
    """Turn part by part; the first one with coordinates shows whether the CRS is right."""
    turn = ToDegrees.of(file.path, crs or layer.crs)
    said: dict[str, None] = {}
    kinds: set[int] = set()
    checked, count, first_bad = False, 0, ""
    names: dict[str, None] = {}
    for part in layer.parts:
        geometry = turn.turn(part.geometry)
        notes = [*layer.notes, *(f"{file.path.name}: {note}" for note in part.notes)]
        if not checked and len(geometry):
            notes += turn.check(part.geometry, geometry, layer.bbox)
            checked = True
        fresh = tuple(note for note in dict.fromkeys(notes) if note not in said)
        said.update(dict.fromkeys(fresh))
        kinds |= set(np.unique(shapely.get_type_id(geometry)).tolist())
        count += len(part.feature) + len(part.unreadable)
        if part.unreadable and not first_bad:
            first_bad = f"feature {part.unreadable[0][0]}: {part.unreadable[0][1]}"
        if len(names) <= MAX_COLUMNS:
            names.update(dict.fromkeys(part.columns))
        for name in names:  # a field that a user names is in all parts, or in none
            if name not in part.columns:
                part.columns[name] = objects([None] * len(part.feature))
        if len(part.feature) or part.unreadable:
            yield _footprints(file.path, layer.name, turn, (part, geometry, fresh))
    if not count:
        raise InputError(
            file.path, f"no features in layer {layer.name}", "check how it was made"
        )
    if not kinds.intersection(_POLYGONAL):
        words = [shapely.GeometryType(kind).name.title() for kind in sorted(kinds - {-1})]
        raise no_polygons(file.path, ", ".join(words) or first_bad or "no geometry")


def _footprints(
    path: Path,
    layer: str,
    turn: ToDegrees,
    part: tuple[RawFeatures, Geometries, tuple[str, ...]],
) -> Footprints:
    raw, geometry, notes = part
    return Footprints(
        path,
        layer,
        turn.system.to_string(),
        raw.feature,
        shapely.force_2d(geometry),
        raw.columns,
        notes,
        unreadable=raw.unreadable,
    )
