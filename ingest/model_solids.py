# SPDX-License-Identifier: Apache-2.0
"""City objects to footprints and solids: all objects of a part of a file at once."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.city_objects import Faces, joined
from ingest.footprints import Geometries
from ingest.model_crs import Placement
from ingest.model_mesh import Shells, judge, level_areas, shells, triangulate, turned
from ingest.model_outline import are_prisms, outlines
from ingest.model_rings import Rings, clean, welded
from ingest.repair import MAX_WIDTH_M, metres_per_degree, repair
from ingest.solids import MAX_SOLID_VERTICES, Solid, encode_solid
from tiles.frames import Floats, Ints

MAX_HEIGHT_M = 1000.0
_FLAT_M = 0.01
_POLEWARD_DEG = 89.99


@dataclass(frozen=True, slots=True)
class Built:
    """n city objects, ready to be stored."""

    geometry: Geometries
    """(n,) footprints in degrees"""
    solid: NDArray[np.object_]
    """(n,) bodies of `encode_solid`, None where the footprint raised says it all"""
    height_m: Floats
    """(n,) highest above lowest point, NaN where all is at one height"""
    reason: NDArray[np.object_]
    """(n,) why one can't be used; empty where it can"""
    dropped: int
    """faces without area, or there twice"""
    heavy: int
    """objects of too many vertices for a mesh"""


@dataclass(frozen=True, slots=True)
class _Frame:
    """East and north in metres around the middle of each of n objects."""

    lon_deg: Floats
    lat_deg: Floats
    per_lon: Floats
    per_lat: Floats

    @classmethod
    def around(cls, lon_deg: Floats, lat_deg: Floats) -> "_Frame":
        lat = np.clip(lat_deg, -_POLEWARD_DEG, _POLEWARD_DEG)
        return cls(lon_deg, lat_deg, *metres_per_degree(lat))

    def metres(self, lon_deg: Floats, lat_deg: Floats, owner: Ints) -> Floats:
        # The short way round: a repaired footprint may be on the antimeridian's other side.
        across = np.remainder(lon_deg - self.lon_deg[owner] + 180, 360) - 180
        east = across * self.per_lon[owner]
        north = (lat_deg - self.lat_deg[owner]) * self.per_lat[owner]
        return np.column_stack((east, north))

    def degrees(self, polygon: Geometries) -> Geometries:
        xy, owner = shapely.get_coordinates(polygon, return_index=True)
        lon = self.lon_deg[owner] + xy[:, 0] / self.per_lon[owner]
        lat = self.lat_deg[owner] + xy[:, 1] / self.per_lat[owner]
        placed = shapely.set_coordinates(polygon.copy(), np.column_stack((lon, lat)))
        return np.asarray(placed, object)


@dataclass(frozen=True, slots=True)
class _Placed:
    """Corners of n objects, and where these can't be."""

    lon_deg: Floats
    lat_deg: Floats
    place: Floats
    """(p, 3) m east and north in `frame`, and up"""
    frame: _Frame
    reason: NDArray[np.object_]
    """(n,) why an object can't be placed; empty where it can"""


def build(objects: list[Faces], placement: Placement) -> Built:
    """Make footprints and solids of n objects."""
    count = len(objects)
    every = joined(objects)
    owner = np.repeat(np.arange(count), [len(one.surface) for one in objects])
    rings = _rings(every, owner)
    placed = _placed(every, owner[rings.corner_face], placement, count)
    reason, frame, place = placed.reason, placed.frame, placed.place
    rings = replace(rings, place=place, weld=welded(place, every.body[rings.corner_face]))
    usable = (reason == "")[owner]
    rings = rings.take(usable[rings.corner_face], usable)
    faces = len(rings.owner)
    rings, normal = clean(rings)
    rings, height_m = _from_lowest(rings, count)
    triangles, face = triangulate(rings, normal)
    bodies = judge(rings, triangles, face)
    over = turned(rings, normal, bodies)
    normal = np.where(over[:, None], -normal, normal)
    triangles[over[face]] = triangles[over[face]][:, ::-1]

    outline = outlines(rings, normal, bodies, count)
    _mark(reason, np.bincount(rings.owner, minlength=count) == 0, "no face with an area")
    _mark(reason, shapely.is_missing(outline), "only upright faces")
    level_m2 = level_areas(rings, triangles, face)
    plain = are_prisms(rings, normal, level_m2, outline, height_m) | (reason != "")
    drawn = shells(rings, normal, triangles, face, bodies)
    geometry = _repaired(frame.degrees(outline))
    solid, heavy = _solids(rings, drawn, geometry, placed, plain)
    height_m = np.where(height_m > _FLAT_M, height_m, np.nan)
    return Built(geometry, solid, height_m, reason, faces - len(rings.owner), heavy)


def _rings(every: Faces, owner: Ints) -> Rings:
    rings = len(every.ring_start) - 1
    ring = np.repeat(np.arange(rings), np.diff(every.ring_start))
    face = np.repeat(np.arange(len(owner)), np.diff(every.face_start))
    corners = np.arange(len(ring))
    return Rings(
        every.corner, corners, corners, ring, face, owner, every.body, every.surface
    )


def _placed(every: Faces, owner: Ints, placement: Placement, count: int) -> _Placed:
    """Turn corners to degrees and metres; owners ascend and none is left out.

    Longitudes of what is astride the antimeridian go on beyond 180.
    """
    lon, lat = placement.degrees(every.corner[:, :2])
    up = every.corner[:, 2] * placement.unit_m
    inside = (np.abs(lon) <= 180) & (np.abs(lat) <= 90) & np.isfinite(up)
    lon, lat, up = (np.where(inside, value, 0.0) for value in (lon, lat, up))
    reason = np.full(count, "", object)
    reason[owner[~inside]] = "coordinates outside the CRS"
    start = np.flatnonzero(np.diff(owner, prepend=-1))
    astride = _ranges(lon, start)[1] > 180
    lon = np.where(astride[owner] & (lon < 0), lon + 360, lon)
    frame = _Frame.around(_ranges(lon, start)[0], _ranges(lat, start)[0])
    place = np.column_stack((frame.metres(lon, lat, owner), up))
    size = np.column_stack([_ranges(value, start)[1] for value in place.T])
    wide = size[:, :2].max(axis=1) > MAX_WIDTH_M
    _mark(reason, wide, f"wider than {MAX_WIDTH_M / 1000:.0f} km")
    _mark(reason, size[:, 2] > MAX_HEIGHT_M, f"higher than {MAX_HEIGHT_M:.0f} m")
    return _Placed(lon, lat, place, frame, reason)


def _ranges(value: Floats, start: Ints) -> tuple[Floats, Floats]:
    """Return the middle and the size of each object's range."""
    low, high = np.minimum.reduceat(value, start), np.maximum.reduceat(value, start)
    return np.asarray((low + high) / 2), np.asarray(high - low)


def _mark(reason: NDArray[np.object_], where: NDArray[np.bool_], text: str) -> None:
    reason[where & (reason == "")] = text


def _from_lowest(rings: Rings, count: int) -> tuple[Rings, Floats]:
    """Count heights from each object's lowest point; also return its own height."""
    owner, up = rings.owner[rings.corner_face], rings.place[:, 2]
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, owner, up)
    np.maximum.at(high, owner, up)
    place = rings.place.copy()
    place[:, 2] -= low[owner]
    return replace(rings, place=place), np.where(high >= low, high - low, 0.0)


def _repaired(polygon: Geometries) -> Geometries:
    """Repair now what is repaired later, so that the middle of its box stays.

    What can't be repaired stays as it is: its reason is found later.
    """
    fine = repair(polygon).polygon
    return np.where(shapely.is_missing(fine), polygon, fine)


def _solids(
    rings: Rings,
    drawn: Shells,
    geometry: Geometries,
    placed: _Placed,
    plain: NDArray[np.bool_],
) -> tuple[NDArray[np.object_], int]:
    """Encode the mesh of each object that is not plain, around its footprint."""
    count = len(geometry)
    west, south, east, north = shapely.bounds(geometry).T
    frame = _Frame.around((west + east) / 2, (south + north) / 2)
    source = rings.source[drawn.corner]
    flat = frame.metres(placed.lon_deg[source], placed.lat_deg[source], drawn.vertex_owner)
    place = np.column_stack((flat, rings.place[drawn.corner, 2]))
    numbers = np.arange(count + 1)
    vertex = np.searchsorted(drawn.vertex_owner, numbers)
    triangle = np.searchsorted(drawn.owner, numbers)
    roof_m = _roof_heights(place, drawn, count)
    heavy = (np.diff(vertex) > MAX_SOLID_VERTICES) & ~plain
    found = np.full(count, None, object)
    for k in np.flatnonzero(~plain & ~heavy & (np.diff(triangle) > 0)).tolist():
        v, t = slice(*vertex[k : k + 2]), slice(*triangle[k : k + 2])
        corners = drawn.triangles[t] - vertex[k]
        found[k] = encode_solid(
            Solid(
                place[v].astype(np.float32),
                drawn.kind[v],
                corners.astype(np.uint16),
                float(roof_m[k]),
            )
        )
    return found, int(heavy.sum())


def _roof_heights(place: Floats, drawn: Shells, count: int) -> Floats:
    """Return the mean height of what looks up, (n,) m, weighted by the area below it."""
    corner = place[drawn.triangles]
    ab, ac = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = np.maximum(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0], 0.0)
    total = np.bincount(drawn.owner, area, count)
    height = np.bincount(drawn.owner, area * corner[:, :, 2].mean(axis=1), count)
    return np.asarray(height / np.maximum(total, 1e-9))
