# SPDX-License-Identifier: Apache-2.0
"""The ground plan of a city model's building, and whether it is only that, raised."""

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.city_objects import FLOOR_SURFACE
from ingest.footprints import Geometries
from ingest.model_mesh import Bodies, unit_up
from ingest.model_rings import Rings
from tiles.frames import Floats, Ints

_STEEP = 0.05
_DOWN = -0.5
_GRID_M = 1e-3
_LEVEL_M = 0.02
_AREA_M2, _AREA_SHARE = 0.5, 0.01


def outlines(rings: Rings, normal: Floats, bodies: Bodies, count: int) -> Geometries:
    """Return what each object covers, (count,) in m east and north; None for nothing.

    Of each body it is the ground surfaces; else the faces that look down, where the body
    is closed; else all its faces.
    """
    faces = np.flatnonzero(_covering(rings, unit_up(normal), bodies))
    polygon = _polygons(rings, faces)
    owner = rings.owner[faces]
    found = np.full(count, None, object)
    start = np.searchsorted(owner, np.arange(count + 1)).tolist()
    invalid = ~shapely.is_valid(polygon)
    polygon[invalid] = shapely.make_valid(
        polygon[invalid], method="structure", keep_collapsed=False
    )
    for k, (first, last) in enumerate(pairwise(start)):
        if last > first:
            found[k] = _union(polygon[first:last])
    return found


def _covering(rings: Rings, up: Floats, bodies: Bodies) -> NDArray[np.bool_]:
    """Tell which faces make the outline."""
    count = len(bodies.closed)
    floor = (rings.surface == FLOOR_SURFACE) & (np.abs(up) > _STEEP)
    has_floor = np.bincount(rings.body[floor], minlength=count) > 0
    down = (up < _DOWN) & bodies.closed[rings.body]
    has_down = np.bincount(rings.body[down], minlength=count) > 0
    by_sense = np.where(has_floor[rings.body], floor, down | ~has_down[rings.body])
    return np.asarray(by_sense & (np.abs(up) > _STEEP))


def _polygons(rings: Rings, faces: Ints) -> Geometries:
    """Return faces seen from above as shapely polygons."""
    if not len(faces):
        return np.zeros(0, object)
    chosen = np.zeros(len(rings.owner), bool)
    chosen[faces] = True
    some = rings.take(chosen[rings.corner_face], chosen)
    start = some.ring_start
    size = np.diff(start)
    # On a grid, so that neighbours share their corners exactly and unite without gaps.
    xy = np.rint(some.place[:, :2] / _GRID_M) * _GRID_M
    # Each ring is closed by its first corner.
    index = np.insert(np.arange(len(some.place)), start[1:], start[:-1])
    ends = np.concatenate(([0], np.cumsum(size + 1)))
    return np.asarray(
        shapely.from_ragged_array(
            shapely.GeometryType.POLYGON, xy[index], (ends, some.face_start)
        ),
        object,
    )


def _union(polygons: Geometries) -> shapely.Geometry | None:
    if len(polygons) == 1:
        return polygons[0]
    try:
        return shapely.union_all(polygons)
    except shapely.GEOSException:
        return shapely.union_all(shapely.buffer(polygons, _GRID_M))


def are_prisms(
    rings: Rings, normal: Floats, level_m2: Floats, outline: Geometries, height_m: Floats
) -> NDArray[np.bool_]:
    """Tell which objects, (n,), are no more than their outline raised.

    These need no mesh of their own: all roofs at one level, upright walls, one floor.

    Parameters
    ----------
    level_m2 : (f,) area of each face as seen from above
    """
    count = len(outline)
    if not len(normal):
        return np.ones(count, bool)
    start = rings.ring_start[rings.face_start[:-1]]
    low = np.minimum.reduceat(rings.place[:, 2], start)
    high = np.maximum.reduceat(rings.place[:, 2], start)
    up = unit_up(normal)
    roof = (low > height_m[rings.owner] - _LEVEL_M) & (up > 0)
    fitting = roof | (high < _LEVEL_M) | (np.abs(up) < _LEVEL_M)
    odd = np.bincount(rings.owner[~fitting], minlength=count)
    area = np.bincount(rings.owner[roof], level_m2[roof], count)
    below = np.nan_to_num(shapely.area(outline))
    same = np.abs(area - below) < _AREA_M2 + _AREA_SHARE * below
    return np.asarray((odd == 0) & same)
