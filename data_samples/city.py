# SPDX-License-Identifier: Apache-2.0
"""San Francisco's Twin Peaks area: terrain from contours, footprints with heights."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from common import UTM_10N, VOID, north_up, write_dem
from contours import contour_dem
from mvt import Feature, TileSet
from pyproj import Transformer
from shapely.geometry.base import BaseGeometry

CELL_M = 10.0


def build_terrain(tiles: TileSet, out: Path) -> None:
    """Write ``sanfrancisco.tif``: 10 m, UTM zone 10 N, tenths of metres."""
    left, top, right, bottom = tiles.bounds
    ring = shapely.get_coordinates(
        shapely.segmentize(shapely.box(left, top, right, bottom), 256)
    )
    lon_lat = tiles.to_lon_lat(ring)
    to_utm = Transformer.from_crs("EPSG:4326", "EPSG:32610", always_xy=True)
    x, y = (np.asarray(v) for v in to_utm.transform(lon_lat[:, 0], lon_lat[:, 1]))
    west, north = np.floor(x.min() / CELL_M) * CELL_M, np.ceil(y.max() / CELL_M) * CELL_M
    size = (
        int(np.ceil((north - y.min()) / CELL_M)),
        int(np.ceil((x.max() - west) / CELL_M)),
    )
    transform = north_up(west, north, CELL_M, CELL_M)
    heights, covered = contour_dem(tiles, "EPSG:32610", transform, size, 10.0)
    rounded = np.where(covered, np.round(heights, 1), VOID).astype(np.float32)
    write_dem(out / "sanfrancisco.tif", rounded, UTM_10N, transform, VOID)


def whole_buildings(tiles: TileSet) -> list[Feature]:
    """Every footprint once and whole.

    A tile repeats what lies in a 64 pixel border around it. A footprint inside a tile
    is taken as it is; pieces of one that crosses tile edges are joined; one that only
    lies in a border is another tile's, or outside the data.
    """
    inner: list[Feature] = []
    crossing: list[Feature] = []
    for feature in tiles.features("building", cut=False):
        square = tiles.square(feature.tile)
        if square.contains(feature.geometry):
            inner.append(feature)
        else:
            crossing.append(feature)
    world = shapely.box(*tiles.bounds)
    joined = [f for f in join_pieces(crossing) if world.contains(f.geometry.centroid)]
    taken = shapely.STRtree([f.geometry for f in inner])
    fresh = [f for f in joined if not repeats(f.geometry, inner, taken)]
    return inner + fresh


def repeats(geometry: BaseGeometry, inner: list[Feature], tree: shapely.STRtree) -> bool:
    """Whether a footprint is, but for a border, one of those inside a tile."""
    for index in tree.query(geometry, predicate="intersects"):
        other = inner[index].geometry
        if geometry.intersection(other).area > 0.5 * min(geometry.area, other.area):
            return True
    return False


def join_pieces(pieces: list[Feature]) -> list[Feature]:
    """Union of the pieces from different tiles that overlap by more than half."""
    tree = shapely.STRtree([p.geometry for p in pieces])
    group = list(range(len(pieces)))

    def root(k: int) -> int:
        while group[k] != k:
            k = group[k]
        return k

    for i, piece in enumerate(pieces):
        for j in tree.query(piece.geometry, predicate="intersects"):
            other = pieces[j]
            if j <= i or other.tile == piece.tile:
                continue
            shared = piece.geometry.intersection(other.geometry).area
            if shared > 0.5 * min(piece.geometry.area, other.geometry.area):
                group[root(int(j))] = root(i)
    members: dict[int, list[Feature]] = {}
    for k, piece in enumerate(pieces):
        members.setdefault(root(k), []).append(piece)
    return [united(parts) for parts in members.values()]


def united(parts: list[Feature]) -> Feature:
    """One feature of several pieces."""
    if len(parts) == 1:
        return parts[0]
    shape = shapely.union_all([p.geometry for p in parts])
    return Feature(shape, parts[0].properties, parts[0].tile)


def polygons_of(geometry: BaseGeometry) -> Iterable[BaseGeometry]:
    """Return the polygons in a geometry (repair can leave lines and points behind)."""
    parts = getattr(geometry, "geoms", [geometry])
    return [p for p in parts if p.geom_type == "Polygon" and p.area > 4.0]


def build_buildings(tiles: TileSet, out: Path) -> int:
    """Write ``sanfrancisco_buildings.gpkg`` and return how many footprints it holds."""
    geometries, heights, bases, kinds = [], [], [], []
    for feature in whole_buildings(tiles):
        parts = polygons_of(feature.geometry)
        if not parts or feature.properties.get("underground") == "true":
            continue
        shape = shapely.transform(
            shapely.multipolygons(list(parts)), lambda xy: np.round(tiles.to_lon_lat(xy), 7)
        )
        shape = shape if shape.is_valid else shapely.make_valid(shape)
        geometries.append(
            shape.geoms[0] if len(getattr(shape, "geoms", [])) == 1 else shape
        )
        heights.append(float(feature.properties["height"]))
        bases.append(float(feature.properties.get("min_height", 0)))
        kinds.append(str(feature.properties.get("type", "building")))
    path = out / "sanfrancisco_buildings.gpkg"
    path.unlink(missing_ok=True)
    # a fixed date, so that building again gives the same bytes
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": "2026-01-01T00:00:00Z"})
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.asarray(geometries, dtype=object)),
        [np.asarray(heights), np.asarray(bases), np.asarray(kinds, dtype=object)],
        ["height", "min_height", "type"],
        layer="buildings",
        driver="GPKG",
        geometry_type="Unknown",
        crs="EPSG:4326",
        spatial_index=False,
        dataset_options={"VERSION": "1.3"},
    )
    return len(geometries)
