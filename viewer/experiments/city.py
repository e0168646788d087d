# SPDX-License-Identifier: Apache-2.0
"""A made-up city of boxes, and an index of it that a dry pager can page.

As in REVIEW (Shou et al., VLDB 2001, section 5): boxes 10 to 30 m apart, all with one
level of detail. Columns and rows of boxes are so far apart from centre to centre. All
bounding dimensions are alike, so that a threshold in pixels is a depth of view.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tiles import bounds, cells, geodesy, zones
from tiles.frames import Floats, Ints
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.writer import Writer

SEED = 7
APART_M = (10.0, 30.0)
WIDE_M = (4.0, 9.5)
HIGH_M = 20.0
"""Of every box; also its bounding dimension"""
LON_DEG, LAT_DEG = 10.0, 10.0
"""South-west corner, in the middle of a zone"""
COUNT = 900_000
LEAF_LEVEL = 15
"""Cells of 153 m hold some 58 boxes"""
STORED_BYTES, MEMORY_BYTES = 222, 1193
"""Of a box: the paper's 900,000 took 200 MB of disk, and 1 GB of memory"""
ROOT_BYTES = 1000


@dataclass(frozen=True, slots=True)
class City:
    """n boxes in a plane: metres east, north and up of the south-west corner."""

    low: Floats
    """(n, 3)"""
    high: Floats

    @property
    def side_m(self) -> float:
        """How wide the city is."""
        return float(self.high[:, :2].max())


def make_city(count: int) -> City:
    """Return a square of `count` boxes, the same each time."""
    random = np.random.default_rng(SEED)
    side = math.isqrt(count - 1) + 1
    x, y = (np.cumsum(random.uniform(*APART_M, side)) for _ in "xy")
    at = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)[:count]
    half = random.uniform(*WIDE_M, (count, 2)) / 2
    ground, top = np.zeros((count, 1)), np.full((count, 1), HIGH_M)
    return City(np.hstack((at - half, ground)), np.hstack((at + half, top)))


def lon_lat(east_m: Floats, north_m: Floats) -> tuple[Floats, Floats]:
    """Return longitude and latitude (rad) of places in the plane."""
    lon, lat = math.radians(LON_DEG), math.radians(LAT_DEG)
    origin = geodesy.to_ecef(lon, lat, 0.0)
    step = 1e-6
    per_lon = float(np.linalg.norm(geodesy.to_ecef(lon + step, lat, 0.0) - origin)) / step
    per_lat = float(np.linalg.norm(geodesy.to_ecef(lon, lat + step, 0.0) - origin)) / step
    return lon + np.asarray(east_m) / per_lon, lat + np.asarray(north_m) / per_lat


def index_of(city: City, stored_bytes: int = STORED_BYTES) -> NDArray[np.void]:
    """Return INDEX records of the city's tiles and of the cells above them.

    Parameters
    ----------
    stored_bytes : of a box
    """
    leaf, place = tile_of(city)
    held = np.bincount(place)
    above = [np.unique(cells.ancestor(leaf, level)) for level in range(LEAF_LEVEL)]
    cell = np.concatenate([*above, leaf])
    records = np.zeros(len(cell), INDEX)
    records["cell"] = cell
    centre, radius_m = bounds.sphere_of(cell, 0.0, HIGH_M)
    records["centre"], records["radius_m"] = centre, radius_m + WIDE_M[1]
    records["max_height_m"] = records["subtree_dimension_m"] = HIGH_M
    own = records[-len(leaf) :]
    own["own_dimension_m"], own["row"] = HIGH_M, 1 + np.arange(len(leaf))
    own["memory_bytes"], own["tile_bytes"] = held * MEMORY_BYTES, held * stored_bytes
    return records


def roots() -> NDArray[np.void]:
    """Return records of 32 flat zones, the least terrain that a pager flies over."""
    cell = cells.make(np.arange(zones.COUNT), 0, 0, 0)
    records = np.zeros(zones.COUNT, INDEX)
    records["cell"], records["row"] = cell, 1 + np.arange(zones.COUNT)
    centre, radius_m = bounds.sphere_of(cell, 0.0, 0.0)
    records["centre"], records["radius_m"] = centre, radius_m
    records["tile_bytes"] = records["memory_bytes"] = ROOT_BYTES
    return records


def write_city(path: Path, city: City, stored_bytes: int = STORED_BYTES) -> Path:
    """Write a store that holds the city's index and no bodies: for dry paging only."""
    path.unlink(missing_ok=True)
    writer = Writer(path)
    with writer.transaction():
        writer.replace_index(Lane.TERRAIN, roots())
        writer.replace_index(Lane.OBJECTS, index_of(city, stored_bytes))
    writer.close()
    return path


def tile_of(city: City) -> tuple[Ints, Ints]:
    """Return the leaf cells, ascending, and each box's place among them, (n,)."""
    middle = (city.low + city.high) / 2
    home = cells.cell_at(*lon_lat(middle[:, 0], middle[:, 1]), LEAF_LEVEL)
    leaf, place = np.unique(home, return_inverse=True)
    return leaf, place
