# SPDX-License-Identifier: Apache-2.0
"""Blocks, districts and skylines: boxes that stand for all buildings below a cell.

A box is a rectangle along the walls of its buildings, made smaller to their area, as
high as they are on average by area, with a roof that leans as the ground below it.

The error of boxes is at least a silhouette distance in metres: the Hausdorff distance
between two sets, each of them solid: the real buildings with the ground, and the boxes
with the ground. From wherever they are looked at, their outlines are no farther apart.
The ground is drawn in both cases, so a box where no building is counts its height at
most, not how far the next building is. A building that is left out would count its
height too, but it is missed from above as well: it counts its largest side, which is
what the object threshold goes by. So proxies never leave out what the threshold draws.
(By heights alone, houses 6 m high on steep ground were gone at 4 km and 2 px.)
Below a building the ground is taken as its lowest there; below a box, as the plane of
its lean under the lowest of its buildings. What is below ground does not count.

Where buildings have roofs of their own, prisms come before boxes: `flat_roofs`.

The error is never understated (how it is found: `proxy_error`), and it adds up: boxes
that stand for boxes are off by their own error against these plus the largest of these.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely

from ingest.box_fit import (
    ANGLE,
    FOOT,
    GROUND,
    HIGH_U,
    HIGH_V,
    LEAN_U,
    LEAN_V,
    LOW_U,
    LOW_V,
    TOP,
)
from ingest.box_splits import split_groups
from ingest.extrude import Prisms
from ingest.footprints import Geometries
from ingest.proxy_error import box_errors_m
from ingest.proxy_solids import Solids, frames_of
from ingest.repair import metres_per_degree
from tiles.frames import WGS84_A_M, Floats, Ints

MAX_BOXES = 64
OBJECTS_PER_BOX = 3


@dataclass(frozen=True, slots=True)
class Boxes:
    """The boxes of all groups, sorted by group."""

    group: Ints
    """(b,)"""
    corner_deg: Floats
    """(b, 4, 2) longitude and latitude, counter-clockwise"""
    shape: Floats
    """(b, 10) columns as in `box_fit`"""
    item: Ints
    """(m,) building numbers, box by box"""
    start: Ints
    """(b + 1,) where each box's buildings begin in `item`"""

    @property
    def polygon(self) -> Geometries:
        """Footprints, (b,) shapely polygons."""
        return np.asarray(shapely.polygons(self.corner_deg), object)

    @property
    def foot_m(self) -> Floats:
        """Lower edge in the middle, (b,) above the ellipsoid."""
        return self.shape[:, FOOT]

    @property
    def ground_m(self) -> Floats:
        """Ground in the middle, (b,) above the ellipsoid."""
        return self.shape[:, GROUND]

    @property
    def top_m(self) -> Floats:
        """Roof in the middle, (b,) above the ellipsoid."""
        return self.shape[:, TOP]

    @property
    def lean(self) -> Floats:
        """Rise to the east and to the north, (b, 2) m/m."""
        u, v = self.shape[:, LEAN_U], self.shape[:, LEAN_V]
        cos, sin = np.cos(self.shape[:, ANGLE]), np.sin(self.shape[:, ANGLE])
        return np.column_stack((u * cos - v * sin, u * sin + v * cos))


def make_boxes(solids: Solids, first: Ints, last: Ints) -> Boxes:
    """Make the boxes of groups of buildings, none of them empty.

    Parameters
    ----------
    solids : the buildings
    first, last : (g,) group k holds the buildings from first[k] to last[k] - 1
    """
    if not len(first):
        none = np.zeros(0, np.int64)
        return Boxes(none, np.zeros((0, 4, 2)), np.zeros((0, 10)), none, np.zeros(1, int))
    frames = frames_of(solids, first, last)
    count = np.asarray(last - first, np.int64)
    most = np.clip(-(-count // OBJECTS_PER_BOX), 1, MAX_BOXES)
    item, start, group, shape = split_groups(solids, first, last, frames, most)
    return Boxes(group, _corners(shape, frames[group]), shape, item, start)


def _corners(shape: Floats, frames: Floats) -> Floats:
    """Return longitude and latitude of rectangles' corners, (b, 4, 2) degrees."""
    cos, sin = np.cos(shape[:, ANGLE, None]), np.sin(shape[:, ANGLE, None])
    u = shape[:, (LOW_U, HIGH_U, HIGH_U, LOW_U)]
    v = shape[:, (LOW_V, LOW_V, HIGH_V, HIGH_V)]
    place = np.stack((u * cos - v * sin, u * sin + v * cos), axis=2)
    return np.asarray(frames[:, None, :2] + place / frames[:, None, 2:])


def measure(boxes: Boxes, solids: Solids, first: Ints, last: Ints) -> Floats:
    """Return the error of each group's boxes against its buildings, (g,) m.

    Parameters
    ----------
    solids, first, last : as the boxes were made from
    """
    if not len(first):
        return np.zeros(0)
    begin = np.searchsorted(boxes.group, np.arange(len(first) + 1))
    frames = frames_of(solids, first, last)
    error = box_errors_m(solids, boxes.item, boxes.start, begin, frames, boxes.shape)
    across = boxes.shape[:, (HIGH_U, HIGH_V)] - boxes.shape[:, (LOW_U, LOW_V)]
    # Roofs are flat, and the earth below is not.
    bulge = (across**2).sum(axis=1) / (8 * WGS84_A_M)
    return np.asarray(error + np.maximum.reduceat(bulge, begin[:-1]))


def leaning(prisms: Prisms, centre_deg: Floats, lean: Floats) -> Prisms:
    """Let prisms of level boxes lean: every vertex rises with its place.

    Parameters
    ----------
    prisms : n prisms
    centre_deg, lean : (n, 2) as in `Solids`
    """
    owner = np.repeat(np.arange(len(lean)), np.diff(prisms.vertex_start))
    per_lon, per_lat = metres_per_degree(centre_deg[:, 1])
    east = np.degrees(prisms.lon_rad) - centre_deg[owner, 0]
    north = np.degrees(prisms.lat_rad) - centre_deg[owner, 1]
    rise_m = (lean[:, 0] * per_lon)[owner] * east + (lean[:, 1] * per_lat)[owner] * north
    return replace(prisms, height_m=prisms.height_m + rise_m)
