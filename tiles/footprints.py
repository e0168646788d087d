# SPDX-License-Identifier: Apache-2.0
"""Stored footprints as edges, and which of them cover a place.

A footprint is a valid polygon in degrees whose longitudes may run past 180, so a place
is turned to the footprint's side of the globe first. A place is inside when a line from
it to the east crosses an odd number of edges: concave footprints, courtyards and
footprints of several parts need no care.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats, Ints
from tiles.kernels import kernel

POLYGON, MULTI_POLYGON = 3, 6
_LITTLE = 1
PLACES_AT_ONCE = 4096


@dataclass(frozen=True, slots=True)
class Footprints:
    """Footprints of n objects."""

    id: Ints
    bounds_deg: Floats
    """(n, 4) west, south, east, north"""
    edges_deg: Floats
    """(e, 4) longitude and latitude of both ends"""
    edge_start: Ints
    """(n + 1,) where each object's edges begin"""


def read_footprints(rows: Sequence[tuple[int, bytes]]) -> Footprints:
    """Read object numbers with their footprints, WKB in degrees.

    Raises
    ------
    ValueError
        When a footprint is no polygon of two coordinates.
    """
    rings = [rings_of(wkb) for _, wkb in rows]
    flat = [ring for of_object in rings for ring in of_object]
    edges = [np.concatenate((ring[:-1], ring[1:]), axis=1) for ring in flat]
    count = [sum(len(ring) - 1 for ring in of_object) for of_object in rings]
    start = np.concatenate(([0], np.cumsum(np.array(count, np.int64))))
    edge = np.concatenate(edges) if edges else np.zeros((0, 4))
    bounds = np.zeros((len(rows), 4))
    if len(edge):
        bounds[:, :2] = np.minimum.reduceat(edge[:, :2], start[:-1])
        bounds[:, 2:] = np.maximum.reduceat(edge[:, :2], start[:-1])
    number = np.array([one for one, _ in rows], np.int64)
    return Footprints(number, bounds, edge, start)


def rings_of(wkb: bytes) -> list[Floats]:
    """Return all rings of a polygon or multipolygon, each (k, 2) degrees, closed.

    Raises
    ------
    ValueError
    """
    try:
        order, kind, count = struct.unpack_from("<BII", wkb)
        if order != _LITTLE or kind not in {POLYGON, MULTI_POLYGON}:
            raise ValueError(f"a footprint of type {kind}, byte order {order}")
        at, rings = 5 if kind == POLYGON else 9, []
        for _ in range(1 if kind == POLYGON else count):
            at += 0 if kind == POLYGON else 5
            (parts,) = struct.unpack_from("<I", wkb, at)
            at += 4
            for _ in range(parts):
                (corners,) = struct.unpack_from("<I", wkb, at)
                ring = np.frombuffer(wkb, "<f8", 2 * corners, at + 4)
                rings.append(ring.reshape(-1, 2))
                at += 4 + ring.nbytes
    except struct.error as error:
        raise ValueError(f"a footprint that ends early ({error})") from error
    if not rings:
        raise ValueError("a footprint without corners")
    return rings


def covering(footprints: Footprints, lon_deg: Floats, lat_deg: Floats) -> tuple[Ints, Ints]:
    """Return every pair of a place and a footprint that covers it, as numbers of both.

    Parameters
    ----------
    lon_deg, lat_deg : (p,) float64; longitudes may be whole rounds off
    """
    pairs = []
    for first in range(0, len(lon_deg), PLACES_AT_ONCE):
        part = slice(first, first + PLACES_AT_ONCE)
        inside = _covers(
            lon_deg[part],
            lat_deg[part],
            footprints.bounds_deg,
            footprints.edges_deg,
            footprints.edge_start,
        )
        pairs.append(np.argwhere(inside) + np.array([first, 0]))
    place, which = np.concatenate(pairs).T if pairs else np.zeros((2, 0), np.int64)
    return place, which


@kernel
def _covers(
    lon_deg: Floats, lat_deg: Floats, bounds_deg: Floats, edges_deg: Floats, start: Ints
) -> NDArray[np.bool_]:
    """Say which places, (p,), lie in which footprints, (n,): (p, n)."""
    inside = np.zeros((len(lon_deg), len(bounds_deg)), np.bool_)
    for j in range(len(bounds_deg)):
        west, south, east, north = bounds_deg[j]
        middle = (west + east) / 2.0
        for i in range(len(lon_deg)):
            y = lat_deg[i]
            if y < south or y > north:
                continue
            # Only when needed: a turn costs the last bits of the longitude.
            x = lon_deg[i]
            if abs(x - middle) > 180.0:
                x -= 360.0 * np.floor((x - middle) / 360.0 + 0.5)
            if x < west or x > east:
                continue
            odd = False
            for k in range(start[j], start[j + 1]):
                x0, y0, x1, y1 = edges_deg[k]
                if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
                    odd = not odd
            inside[i, j] = odd
    return inside


def place_inside(footprints: Footprints) -> tuple[Floats, Floats]:
    """Return a place well inside each footprint, (n,) degrees: longitude and latitude.

    It lies in the middle of the widest stretch along one parallel, near the box's middle.
    """
    return _place_inside(footprints.bounds_deg, footprints.edges_deg, footprints.edge_start)


@kernel
def _place_inside(
    bounds_deg: Floats, edges_deg: Floats, start: Ints
) -> tuple[Floats, Floats]:
    lon, lat = np.zeros(len(bounds_deg)), np.zeros(len(bounds_deg))
    for j in range(len(bounds_deg)):
        widest = -1.0
        # Several parallels: one may meet nothing but the gap between two parts.
        for share in (0.5, 0.4, 0.6, 0.25, 0.75, 0.1, 0.9):
            y = bounds_deg[j, 1] + share * (bounds_deg[j, 3] - bounds_deg[j, 1])
            cuts = np.zeros(start[j + 1] - start[j])
            n = 0
            for k in range(start[j], start[j + 1]):
                x0, y0, x1, y1 = edges_deg[k]
                if (y0 > y) != (y1 > y):
                    cuts[n] = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
                    n += 1
            cuts = np.sort(cuts[:n])
            for k in range(0, n - 1, 2):
                if cuts[k + 1] - cuts[k] > widest:
                    widest = cuts[k + 1] - cuts[k]
                    lon[j], lat[j] = (cuts[k] + cuts[k + 1]) / 2.0, y
    return lon, lat
