# SPDX-License-Identifier: Apache-2.0
"""Ways along named streets in metres (UTM zone 10 N), with rounded corners."""

from dataclasses import dataclass

import numpy as np
import shapely
from mvt import TileSet
from numpy.typing import NDArray
from pyproj import Transformer

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Streets:
    """Centre lines by street name, and the footprints to keep clear of."""

    lines: dict[str, shapely.Geometry]
    buildings: list[shapely.Geometry]

    def corner(self, first: str, second: str) -> Array:
        """Where two streets meet, (x, y)."""
        shared = self.lines[first].intersection(self.lines[second].buffer(0.3))
        if shared.is_empty:
            a, b = shapely.get_coordinates(
                shapely.shortest_line(self.lines[first], self.lines[second])
            )
            return np.asarray((a + b) / 2.0)
        return np.asarray(shared.centroid.coords[0])

    def between(self, street: str, start: Array, end: Array) -> Array:
        """Vertices (n, 2) of a street from one corner to another."""
        length = float(np.hypot(*(end - start)))
        axis = (end - start) / length
        points = shapely.get_coordinates(self.lines[street])
        along = (points - start) @ axis
        across = np.abs((points - start) @ np.array([-axis[1], axis[0]]))
        keep = (along > 6.0) & (along < length - 6.0) & (across < 25.0)
        order = np.argsort(along[keep])
        chosen, at = points[keep][order], along[keep][order]
        spaced = np.flatnonzero(np.diff(at, prepend=-1e9) > 4.0)
        return np.vstack([start, chosen[spaced], end])

    def way(self, stops: list[tuple[str, str]], streets: list[str]) -> Array:
        """Vertices through corners ``stops``, along ``streets`` between them."""
        corners = [self.corner(*stop) for stop in stops]
        legs = [
            self.between(street, a, b)
            for street, a, b in zip(streets, corners, corners[1:], strict=False)
        ]
        return np.vstack([legs[0], *[leg[1:] for leg in legs[1:]]])

    def clearance_m(self, points: Array) -> float:
        """Least distance from points to a footprint; 0 inside one."""
        tree = shapely.STRtree(self.buildings)
        _, distance = tree.query_nearest(
            shapely.points(points), all_matches=False, return_distance=True
        )
        return float(distance.min())


def projector() -> Transformer:
    """Longitude and latitude to the metres used here."""
    return Transformer.from_crs("EPSG:4326", "EPSG:32610", always_xy=True)


def read_streets(tiles: TileSet, footprints: list[shapely.Geometry]) -> Streets:
    """Street names' lines (from the labels' layer) and footprints, in metres."""
    to_utm = projector()

    def project(xy: Array) -> Array:
        lon_lat = tiles.to_lon_lat(xy)
        return np.column_stack(to_utm.transform(lon_lat[:, 0], lon_lat[:, 1]))

    parts: dict[str, list[shapely.Geometry]] = {}
    for feature in tiles.features("road_label"):
        if feature.geometry.length > 0:
            moved = shapely.transform(feature.geometry, project)
            parts.setdefault(feature.properties["name"], []).append(moved)
    lines = {name: shapely.union_all(found) for name, found in parts.items()}
    return Streets(lines, [shapely.transform(f, project) for f in footprints])


def rounded(points: Array, radius_m: float) -> Array:
    """Replace a way's corners by arcs, so that it has a direction everywhere."""
    out = [points[:1]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        a, b = before - corner, after - corner
        a, b = a / np.hypot(*a), b / np.hypot(*b)
        turn = np.pi - np.arccos(np.clip(a @ b, -1.0, 1.0))
        if turn < np.radians(1.0):
            out.append(corner[None])
            continue
        room = 0.45 * min(np.hypot(*(before - corner)), np.hypot(*(after - corner)))
        reach = min(radius_m * np.tan(turn / 2.0), room)
        radius = reach / np.tan(turn / 2.0)
        middle = (a + b) / np.hypot(*(a + b))
        centre = corner + middle * np.hypot(reach, radius)
        sweep = np.linspace(-turn / 2.0, turn / 2.0, max(int(np.degrees(turn) / 3.0), 3))
        side = np.sign(a[0] * b[1] - a[1] * b[0])
        across = np.array([-middle[1], middle[0]]) * side
        curve = centre - radius * (
            np.outer(np.cos(sweep), middle) - np.outer(np.sin(sweep), across)
        )
        out.append(curve)
    out.append(points[-1:])
    return np.vstack(out)


def along(points: Array, distance: Array) -> tuple[Array, Array]:
    """Positions (n, 2) and headings (n,) in degrees at distances along a way."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    keep = np.r_[True, steps > 1e-6]
    points = points[keep]
    at = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]

    def position(d: Array) -> Array:
        d = np.clip(d, 0.0, at[-1])
        return np.column_stack([np.interp(d, at, points[:, k]) for k in (0, 1)])

    where = position(distance)
    ahead, behind = position(distance + 1.0), position(distance - 1.0)
    east, north = (ahead - behind).T
    return where, np.degrees(np.arctan2(east, north)) % 360.0
