# SPDX-License-Identifier: Apache-2.0
"""Vector tiles as shapely geometry: one layer of all tiles, each cut to its own square.

Coordinates here are *pixels of the web Mercator world at the tiles' zoom and extent*
(x east, y south), so that every tile's corner is a whole number and nothing is lost.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mapbox_vector_tile
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

EXTENT = 4096


@dataclass(frozen=True)
class Feature:
    """A geometry in world pixels with its properties and the tile it came from."""

    geometry: BaseGeometry
    properties: dict[str, Any]
    tile: tuple[int, int]


@dataclass(frozen=True)
class TileSet:
    """The decoded tiles of one place: zoom and layers by tile (x, y)."""

    zoom: int
    layers: dict[tuple[int, int], dict[str, Any]]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom of all tiles in world pixels."""
        xs = [x for x, _ in self.layers]
        ys = [y for _, y in self.layers]
        corners = (min(xs), min(ys), max(xs) + 1, max(ys) + 1)
        left, top, right, bottom = (float(c * EXTENT) for c in corners)
        return left, top, right, bottom

    def square(self, tile: tuple[int, int], margin: float = 0.0) -> BaseGeometry:
        """Return a tile's own square, without its buffer."""
        x, y = tile[0] * EXTENT, tile[1] * EXTENT
        return shapely.box(x - margin, y - margin, x + EXTENT + margin, y + EXTENT + margin)

    def features(self, layer: str, *, cut: bool = True) -> list[Feature]:
        """All features of ``layer``; ``cut`` drops what lies in the tiles' buffers."""
        out: list[Feature] = []
        for tile, layers in self.layers.items():
            square = self.square(tile)
            for raw in layers.get(layer, {"features": []})["features"]:
                geometry = to_world(shape(raw["geometry"]), tile)
                if not geometry.is_valid:
                    geometry = shapely.make_valid(geometry)
                if cut:
                    geometry = geometry.intersection(square)
                if not geometry.is_empty:
                    out.append(Feature(geometry, raw["properties"], tile))
        return out

    def to_lon_lat(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """World pixels (n, 2) to longitude and latitude in degrees."""
        size = float(EXTENT * 2**self.zoom)
        lon = xy[:, 0] / size * 360.0 - 180.0
        lat = np.degrees(np.arctan(np.sinh(np.pi * (1.0 - 2.0 * xy[:, 1] / size))))
        return np.column_stack([lon, lat])

    def from_lon_lat(self, lon_lat: NDArray[np.float64]) -> NDArray[np.float64]:
        """Longitude and latitude in degrees (n, 2) to world pixels."""
        size = float(EXTENT * 2**self.zoom)
        x = (lon_lat[:, 0] + 180.0) / 360.0 * size
        y = (1.0 - np.arcsinh(np.tan(np.radians(lon_lat[:, 1]))) / np.pi) * size / 2.0
        return np.column_stack([x, y])


def to_world(geometry: BaseGeometry, tile: tuple[int, int]) -> BaseGeometry:
    """Shift a tile's geometry into the world's pixels."""
    corner = np.array([tile[0] * EXTENT, tile[1] * EXTENT], dtype=np.float64)
    moved: BaseGeometry = shapely.transform(geometry, lambda xy: xy + corner)
    return moved


def read_tiles(packages: Path, place: str) -> TileSet:
    """Decode every tile of a place of @mapbox/mvt-fixtures."""
    layers: dict[tuple[int, int], dict[str, Any]] = {}
    zoom = 0
    for path in sorted((packages / "mvt-fixtures/real-world" / place).glob("*.mvt")):
        zoom, x, y = (int(part) for part in path.stem.split("-"))
        layers[x, y] = mapbox_vector_tile.decode(
            path.read_bytes(), default_options={"y_coord_down": True}
        )
    if not layers:
        raise SystemExit(f"no tiles of {place}: is @mapbox/mvt-fixtures 4.0.0 there?")
    return TileSet(zoom, layers)
