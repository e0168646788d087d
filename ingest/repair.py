# SPDX-License-Identifier: Apache-2.0
"""Polygons that can be built on: invalid ones repaired, hopeless ones named.

A feature stays one object, also when it is a MultiPolygon (an object with several
parts); its attributes are one row, and it is found again as one thing.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.antimeridian import unwrapped
from ingest.degrees import outside_world
from ingest.raw_features import Geometries
from tiles.frames import WGS84_A_M, WGS84_E2, Floats

MIN_AREA_M2 = 0.5
MAX_WIDTH_M = 5000.0
MAX_VERTICES = 4000
"""More than this is simplified: 16-bit indices end at 65,535 vertices, 5 per corner."""
MAX_SPAN_DEG = 180.0
_TOLERANCES_DEG = 1e-6 * 2.0 ** np.arange(8)
"""From about 0.1 m to 14 m."""
_POLYGON, _MULTIPOLYGON, _COLLECTION = 3, 6, 7


@dataclass(frozen=True, slots=True)
class Repaired:
    """Usable polygons and what became of every feature."""

    polygon: Geometries
    """(n,) 2-D Polygon or MultiPolygon, degrees, shells anticlockwise; None: skipped.
    Longitudes run past +-180 where a footprint lies astride it."""
    was_repaired: NDArray[np.bool_]
    """(n,) usable, but not as it came"""
    reason: NDArray[np.object_]
    """(n,) why a feature is skipped; empty where it is not"""


def metres_per_degree(lat_deg: Floats) -> tuple[Floats, Floats]:
    """Return metres per degree of longitude and of latitude on the ellipsoid."""
    lat = np.radians(lat_deg)
    w2 = 1.0 - WGS84_E2 * np.sin(lat) ** 2
    normal_m = WGS84_A_M / np.sqrt(w2)
    meridian_m = normal_m * (1.0 - WGS84_E2) / w2
    degree = np.pi / 180.0
    return normal_m * np.cos(lat) * degree, meridian_m * degree


def size_m(polygon: Geometries) -> tuple[Floats, Floats]:
    """Return width east and length north of each polygon's box, metres."""
    west, south, east, north = shapely.bounds(polygon).T
    per_lon, per_lat = metres_per_degree((south + north) / 2)
    return (east - west) * per_lon, (north - south) * per_lat


def area_m2(polygon: Geometries) -> Floats:
    """Return the area of each polygon, m2, to about a thousandth for a building."""
    bounds = shapely.bounds(polygon)
    per_lon, per_lat = metres_per_degree((bounds[:, 1] + bounds[:, 3]) / 2)
    return np.asarray(shapely.area(polygon) * per_lon * per_lat, np.float64)


def repair(geometry: Geometries) -> Repaired:
    """Make every feature a valid polygon, or say why it can't be one.

    Parameters
    ----------
    geometry : (n,) shapely geometries in degrees, None where there is none
    """
    polygon = _flattened(np.array(geometry, object))
    reason = np.full(len(polygon), "", object)
    kind = shapely.get_type_id(polygon)
    _mark(reason, (kind < 0) | shapely.is_empty(polygon), "no geometry")
    polygonal = np.isin(kind, (_POLYGON, _MULTIPOLYGON, _COLLECTION))
    _mark(reason, ~polygonal, "not a polygon")
    _mark(reason, _not_finite(polygon), "coordinates that are no finite numbers")
    _mark(reason, outside_world(polygon), "outside longitude +-360, latitude +-90")
    polygon, joined = unwrapped(_only(polygon, reason == ""))
    _mark(reason, _span_deg(polygon) > MAX_SPAN_DEG, "around a pole, or half the earth")
    polygon = _only(polygon, reason == "")

    broken = (reason == "") & (~shapely.is_valid(polygon) | (kind == _COLLECTION))
    polygon[broken] = _mended(polygon[broken])
    heavy = shapely.get_num_coordinates(polygon) > MAX_VERTICES
    polygon[heavy] = _simplified(polygon[heavy])
    gone = shapely.is_missing(polygon) | shapely.is_empty(polygon)
    _mark(reason, gone, "no area left after repair")
    polygon = _only(polygon, reason == "")
    _mark(reason, area_m2(polygon) < MIN_AREA_M2, f"smaller than {MIN_AREA_M2} m2")
    width = np.fmax(*size_m(polygon))
    _mark(reason, width > MAX_WIDTH_M, f"wider than {MAX_WIDTH_M / 1000:.0f} km")
    polygon = _only(polygon, reason == "")
    return Repaired(_tidied(polygon), (reason == "") & (broken | heavy | joined), reason)


def _flattened(geometry: Geometries) -> Geometries:
    deep = shapely.has_z(geometry) | shapely.has_m(geometry)
    geometry[deep] = shapely.force_2d(geometry[deep])
    return geometry


def _mark(reason: NDArray[np.object_], where: NDArray[np.bool_], text: str) -> None:
    reason[where & (reason == "")] = text


def _only(polygon: Geometries, where: NDArray[np.bool_]) -> Geometries:
    kept = np.full(len(polygon), None, object)
    kept[where] = polygon[where]
    return kept


def _span_deg(polygon: Geometries) -> Floats:
    bounds = shapely.bounds(polygon)
    return np.asarray(bounds[:, 2] - bounds[:, 0])


def _not_finite(geometry: Geometries) -> NDArray[np.bool_]:
    coordinates, owner = shapely.get_coordinates(geometry, return_index=True)
    bad = np.zeros(len(geometry), bool)
    bad[owner[~np.isfinite(coordinates).all(axis=1)]] = True
    return bad


def _mended(geometry: Geometries) -> Geometries:
    """Repair, and keep only what has an area."""
    mended = _area_parts(_valid(geometry))
    for place, shape in enumerate(geometry):
        if any(len(part.interiors) for part in _polygons(shape)):
            mended[place] = _with_holes(shape)
    return mended


def _valid(geometry: Geometries) -> Geometries:
    made = shapely.make_valid(geometry, method="structure", keep_collapsed=False)
    return np.asarray(made, object)


def _polygons(shape: shapely.Geometry) -> Geometries:
    parts = _flat(shape)
    return np.asarray(parts[shapely.get_type_id(parts) == _POLYGON], object)


def _with_holes(shape: shapely.Geometry) -> shapely.Geometry | None:
    """Take the holes out of the shells: one outside its shell is no building."""
    made = []
    for part in _polygons(shape):
        rings = _valid(shapely.polygons(shapely.get_rings(part)))
        made.append(shapely.difference(rings[0], shapely.union_all(rings[1:])))
    body = _area_parts(np.array([shapely.union_all(made)], object))[0]
    return None if body is None or body.is_empty else body


def _area_parts(geometry: Geometries) -> Geometries:
    mixed = shapely.get_type_id(geometry) == _COLLECTION
    kept = geometry.copy()
    for place in np.flatnonzero(mixed):
        parts = _flat(geometry[place])
        areal = parts[np.isin(shapely.get_type_id(parts), (_POLYGON, _MULTIPOLYGON))]
        kept[place] = shapely.union_all(areal) if len(areal) else None
    flat = np.isin(shapely.get_type_id(kept), (_POLYGON, _MULTIPOLYGON))
    return _only(kept, flat)


def _flat(geometry: shapely.Geometry) -> Geometries:
    """Return the parts of a collection, collections inside it opened too."""
    parts = shapely.get_parts(geometry)
    while (shapely.get_type_id(parts) == _COLLECTION).any():
        parts = shapely.get_parts(parts)
    return np.asarray(parts)


def _simplified(geometry: Geometries) -> Geometries:
    """Leave out corners until few enough are left; where that fails, take the hull."""
    geometry = geometry.copy()
    for tolerance in _TOLERANCES_DEG:
        many = shapely.get_num_coordinates(geometry) > MAX_VERTICES
        if not many.any():
            return geometry
        geometry[many] = _area_parts(shapely.simplify(geometry[many], tolerance))
    many = shapely.get_num_coordinates(geometry) > MAX_VERTICES
    geometry[many] = shapely.convex_hull(geometry[many])
    return geometry


def _tidied(polygon: Geometries) -> Geometries:
    """Drop repeated corners; shells counter-clockwise, holes clockwise."""
    xy, owner = shapely.get_coordinates(polygon, return_index=True)
    again = np.unique(owner[1:][(xy[1:] == xy[:-1]).all(axis=1)])
    polygon = polygon.copy()
    polygon[again] = shapely.remove_repeated_points(polygon[again])
    return np.asarray(shapely.orient_polygons(polygon, exterior_cw=False))
