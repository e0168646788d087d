# SPDX-License-Identifier: Apache-2.0
"""The corners of many polygons as ragged arrays, without a shapely object for each ring."""

from typing import NamedTuple

import numpy as np
import shapely

from ingest.raw_features import Geometries
from tiles.frames import Floats, Ints


class Outlines(NamedTuple):
    """c corners of r rings of p parts of n polygons, all in the polygons' order."""

    xy: Floats
    """(c, 2) each ring ends with its first corner"""
    ring_start: Ints
    """(r + 1,) where each ring's corners begin"""
    part_ring: Ints
    """(p + 1,) where each part's rings begin, its shell first"""
    owner: Ints
    """(p,) the polygon that each part is of"""


def outlines_of(polygon: Geometries) -> Outlines:
    """Return the corners of Polygons and MultiPolygons, (n,)."""
    xy, size = shapely.get_coordinates(polygon), shapely.get_num_coordinates(polygon)
    one_ring = shapely.get_type_id(polygon) == shapely.GeometryType.POLYGON
    one_ring &= shapely.get_num_interior_rings(polygon) == 0
    plain, other = np.flatnonzero(one_ring), np.flatnonzero(~one_ring)
    parts, whose = shapely.get_parts(polygon[other], return_index=True)
    rings, part = shapely.get_rings(parts, return_index=True)
    owner = np.concatenate((plain, other[whose]))
    ring_owner = np.concatenate((plain, other[whose[part]]))
    count = np.concatenate((np.ones_like(plain), np.bincount(part, minlength=len(parts))))
    size = np.concatenate((size[plain], shapely.get_num_coordinates(rings)))
    order = np.argsort(owner, kind="stable")
    size = size[np.argsort(ring_owner, kind="stable")]
    return Outlines(xy, _offsets(size), _offsets(count[order]), owner[order])


def _offsets(count: Ints) -> Ints:
    return np.concatenate(([0], np.cumsum(count, dtype=np.int64)))
