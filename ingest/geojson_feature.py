# SPDX-License-Identifier: Apache-2.0
"""One GeoJSON feature: parsed the fast way, or patiently where that refuses it."""

import json
import math
from typing import Any

import msgspec
import shapely

from ingest.vectors import LATIN

BROKEN = "broken JSON"
TOO_DEEP = "nested too deep"
_NO_FEATURE = "not a Feature"
NO_GEOMETRY = "a geometry that is no GeoJSON"
_NO_PROPERTIES = "properties that are no object"
GEOMETRIES = {
    "Point", "MultiPoint", "LineString", "MultiLineString",
    "Polygon", "MultiPolygon", "GeometryCollection",
}  # fmt: skip


class _Polygon(msgspec.Struct, tag_field="type", tag="Polygon", gc=False):
    coordinates: list[list[list[float]]]

    @property
    def polygons(self) -> list[list[list[list[float]]]]:
        return [self.coordinates]


class _MultiPolygon(msgspec.Struct, tag_field="type", tag="MultiPolygon", gc=False):
    coordinates: list[list[list[list[float]]]]

    @property
    def polygons(self) -> list[list[list[list[float]]]]:
        return self.coordinates


class Feature(msgspec.Struct, gc=False):
    """A feature with a polygon, or without a geometry."""

    type: str
    geometry: _Polygon | _MultiPolygon | None = None
    properties: dict[str, Any] | None = None
    id: Any = None


_decode = msgspec.json.Decoder(Feature).decode


class UnreadableError(Exception):
    """Why a feature can't be read."""


def quickly(text: bytes) -> Feature | None:
    """Read an ordinary feature; None where it is none."""
    try:
        feature = _decode(text)
    except (ValueError, RecursionError):
        return None
    return feature if feature.type == "Feature" else None


def patiently(
    text: bytes, notes: dict[str, None]
) -> tuple[Feature, shapely.Geometry | None]:
    """Read what the fast way refused: other geometries, NaN, bytes that are no UTF-8.

    Parameters
    ----------
    text : JSON of a feature, or of a bare geometry
    notes : gets what the user should know

    Raises
    ------
    UnreadableError
    """
    try:
        return _converted(_loaded(_decoded(text, notes), notes))
    except RecursionError:
        raise UnreadableError(TOO_DEEP) from None


def _loaded(text: str, notes: dict[str, None]) -> dict[str, Any]:
    try:
        found = json.loads(text, parse_constant=_nothing, parse_float=_finite)
    except ValueError:
        raise UnreadableError(BROKEN) from None
    whole = whole_characters(found)
    if whole != found:
        notes["halves of characters were replaced"] = None
        found = whole
    kind = type_of(found)
    if kind in GEOMETRIES:
        return {"type": "Feature", "geometry": found}
    if kind != "Feature":
        raise UnreadableError(_NO_FEATURE)
    return dict(found)


def type_of(found: object) -> str:
    """Return the type that a JSON object states, as text."""
    return str(found.get("type"))[:40] if isinstance(found, dict) else ""


def _converted(found: dict[str, Any]) -> tuple[Feature, shapely.Geometry | None]:
    properties = found.get("properties")
    if not isinstance(properties, dict | None):
        raise UnreadableError(_NO_PROPERTIES)
    try:
        return msgspec.convert(found, Feature), None
    except msgspec.ValidationError:
        feature = Feature("Feature", None, properties, found.get("id"))
        return feature, _other_geometry(found.get("geometry"))


def _decoded(text: bytes, notes: dict[str, None]) -> str:
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        notes[LATIN] = None
        return text.decode("iso-8859-1")


def _other_geometry(found: object) -> shapely.Geometry:
    if type_of(found) not in GEOMETRIES - {"Polygon", "MultiPolygon"}:
        raise UnreadableError(NO_GEOMETRY)
    try:
        return shapely.from_geojson(json.dumps(found))
    except (shapely.errors.GEOSException, ValueError):
        raise UnreadableError(NO_GEOMETRY) from None


def whole_characters(found: Any) -> Any:
    """Put a mark in place of halves of characters, which no UTF-8 can hold."""
    return json.loads(json.dumps(found, ensure_ascii=False).encode("utf-8", "replace"))


def _nothing(_: str) -> None:
    """Return no value for NaN and Infinity."""


def _finite(text: str) -> float | None:
    value = float(text)
    return value if math.isfinite(value) else None
