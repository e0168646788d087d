# SPDX-License-Identifier: Apache-2.0
"""Painting vector layers softly: coverage masks at four times the size, then colour."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
import shapely
from common import north_up
from mvt import Feature, TileSet
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from rasterio.transform import Affine
from scipy import ndimage

Array = NDArray[np.float64]
FINE = 4


@dataclass
class Painter:
    """A picture in EPSG:4326 over a tile set's exact square, painted layer by layer."""

    tiles: TileSet
    rows: int
    columns: int
    metres: float
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(2))

    def __post_init__(self) -> None:
        left, top, right, bottom = self.tiles.bounds
        corners = self.tiles.to_lon_lat(np.array([[left, top], [right, bottom]]))
        (self.west, self.north), (self.east, self.south) = corners.tolist()
        self.colour: Array = np.zeros((self.rows, self.columns, 3))

    @property
    def transform(self) -> Affine:
        """From pixels to longitude and latitude."""
        dx = (self.east - self.west) / self.columns
        return north_up(self.west, self.north, dx, (self.north - self.south) / self.rows)

    def pixels(self, geometry: shapely.Geometry) -> shapely.Geometry:
        """World pixels of the tiles to pixels of the fine mask."""

        def move(xy: Array) -> Array:
            lon_lat = self.tiles.to_lon_lat(xy)
            x = (lon_lat[:, 0] - self.west) / (self.east - self.west) * self.columns
            y = (self.north - lon_lat[:, 1]) / (self.north - self.south) * self.rows
            return np.column_stack([x, y]) * FINE

        moved: shapely.Geometry = shapely.transform(geometry, move)
        return moved

    def mask(self, shapes: Iterable[shapely.Geometry]) -> Array:
        """Coverage (rows, columns), 0 to 1, of areas given in fine pixels."""
        canvas = Image.new("L", (self.columns * FINE, self.rows * FINE), 0)
        draw = ImageDraw.Draw(canvas)
        for shape in shapes:
            for polygon in getattr(shape, "geoms", [shape]):
                if polygon.geom_type != "Polygon" or polygon.is_empty:
                    continue
                draw.polygon(list(polygon.exterior.coords), fill=255)
                for hole in polygon.interiors:
                    draw.polygon(list(hole.coords), fill=0)
        small = canvas.resize((self.columns, self.rows), Image.Resampling.BOX)
        return np.asarray(small, dtype=np.float64) / 255.0

    def areas(
        self,
        layer: str,
        wanted: Callable[[Feature], bool],
    ) -> Array:
        """Coverage of the areas of a layer that are wanted."""
        found = [f.geometry for f in self.tiles.features(layer) if wanted(f)]
        return self.mask(self.pixels(shape) for shape in found)

    def lines(
        self, layer: str, width_m: Callable[[Feature], float], extra_m: float = 0
    ) -> Array:
        """Coverage of lines drawn with their widths; 0 leaves one out."""
        strokes = []
        for feature in self.tiles.features(layer):
            width = width_m(feature)
            if width > 0.0:
                half = 0.5 * (width + extra_m) / self.metres * FINE
                strokes.append(self.pixels(feature.geometry).buffer(half, quad_segs=4))
        return self.mask([shapely.union_all(strokes)])

    def noise(self, cells: float) -> Array:
        """Smooth noise, mean 0 and deviation 1, with features of about ``cells`` pixels."""
        raw = self.rng.standard_normal((self.rows, self.columns))
        soft = ndimage.gaussian_filter(raw, cells, mode="reflect") if cells > 0 else raw
        return np.asarray((soft - soft.mean()) / soft.std())

    def lay(
        self, alpha: Array, rgb: tuple[float, float, float], grain: Array | float = 0
    ) -> None:
        """Blend a colour over the picture; ``grain`` is added to its brightness."""
        paint = np.asarray(rgb, dtype=np.float64) + np.asarray(grain)[..., None]
        self.colour += np.clip(alpha, 0.0, 1.0)[..., None] * (paint - self.colour)

    def crowns(self, density: Array, radius_m: tuple[float, float]) -> tuple[Array, Array]:
        """Tree crowns where ``density`` (chance per pixel): coverage and brightness."""
        rows, columns = np.nonzero(self.rng.random(density.shape) < density)
        canvas = Image.new("L", (self.columns * 2, self.rows * 2), 0)
        light = Image.new("L", canvas.size, 128)
        draw, shade = ImageDraw.Draw(canvas), ImageDraw.Draw(light)
        for row, column in zip(rows * 2.0, columns * 2.0, strict=True):
            r = self.rng.uniform(*radius_m) / self.metres * 2.0
            draw.ellipse((column - r, row - r, column + r, row + r), fill=255)
            tone = int(self.rng.normal(120, 14))
            shade.ellipse((column - r, row - r, column + r, row + r), fill=tone)
            q = 0.55 * r
            x, y = column - 0.3 * r, row - 0.3 * r
            shade.ellipse((x - q, y - q, x + q, y + q), fill=tone + 16)
        size = (self.columns, self.rows)
        small = [np.asarray(i.resize(size, Image.Resampling.BOX)) for i in (canvas, light)]
        return small[0] / 255.0, small[1] - 128.0

    def finished(self) -> NDArray[np.uint8]:
        """Return the picture (rows, columns, 3)."""
        return np.asarray(np.rint(np.clip(self.colour, 0.0, 255.0)), dtype=np.uint8)


def has(*classes: str) -> Callable[[Feature], bool]:
    """Whether a feature's class or type is one of these."""
    names = set(classes)

    def wanted(feature: Feature) -> bool:
        found = (feature.properties.get("class"), feature.properties.get("type"))
        return not names.isdisjoint(found)

    return wanted


def anything(_: Feature) -> bool:
    """Every feature is wanted."""
    return True
