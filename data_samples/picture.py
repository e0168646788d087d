# SPDX-License-Identifier: Apache-2.0
"""The earth's picture: NASA's Blue Marble, brightened, with a sea of its own."""

from pathlib import Path

import numpy as np
from common import GEOGRAPHIC, north_up, write_rgb_jpeg
from earth import Array, blue_marble
from scipy import ndimage

WIDTH, HEIGHT = 5400, 2700
DEPTHS_M = (-6000.0, -4000.0, -2500.0, -800.0, -150.0, -40.0, 0.0)
SEA_RGB = (
    (15, 42, 82),
    (20, 53, 98),
    (26, 65, 114),
    (37, 86, 136),
    (56, 114, 158),
    (74, 134, 170),
    (84, 144, 175),
)
WHITE_RGB = (240, 245, 250)


def resampled(values: Array) -> Array:
    """Return the 10' elevations at the picture's pixels."""
    rows = (np.arange(HEIGHT) + 0.5) * len(values) / HEIGHT - 0.5
    columns = (np.arange(WIDTH) + 0.5) * values.shape[1] / WIDTH - 0.5
    at = np.meshgrid(rows, columns, indexing="ij")
    found = ndimage.map_coordinates(values, at, order=1, mode="grid-wrap")
    return np.asarray(found)


def water_share(picture: Array, height_m: Array) -> Array:
    """0 on land, 1 on the sea and on dark lakes, soft over about a pixel."""
    red, green, blue = np.moveaxis(picture, 2, 0)
    bluish = (blue > 1.22 * green + 4.0) & (blue > 1.3 * red + 6.0)
    black = (picture.max(axis=2) < 14.0) & (height_m < 1200.0)
    deep = (height_m < -350.0) & (picture.min(axis=2) < 120.0)
    water = bluish | black | deep
    labels, count = ndimage.label(water)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    water &= sizes[labels] >= 6
    return np.asarray(ndimage.gaussian_filter(water.astype(np.float64), 0.6))


def sea_colour(height_m: Array) -> Array:
    """Blue that deepens with the water, from a smoothed sea floor."""
    floor = ndimage.gaussian_filter(np.minimum(height_m, 0.0), (4.0, 4.0), mode="wrap")
    table = np.asarray(SEA_RGB, dtype=np.float64)
    return np.stack([np.interp(floor, DEPTHS_M, table[:, i]) for i in range(3)], axis=2)


def brightened(picture: Array) -> Array:
    """Lift the dark forests, keep the snow, take a little of the yellow out."""
    value = (picture / 255.0) ** 0.78
    grey = value.mean(axis=2, keepdims=True)
    value = grey + 0.92 * (value - grey)
    return np.clip(value, 0.0, 1.0) * np.asarray(WHITE_RGB, dtype=np.float64)


def build_picture(packages: Path, out: Path, height_m: Array) -> None:
    """Write ``earth_picture.tif`` (5400 x 2700, JPEG in a GeoTIFF)."""
    picture = blue_marble(packages, (WIDTH, HEIGHT)).astype(np.float64)
    height = resampled(height_m)
    share = water_share(picture, height)[..., None]
    land = brightened(picture)
    mixed = land * (1.0 - share) + sea_colour(height) * share
    transform = north_up(-180.0, 90.0, 360.0 / WIDTH, 180.0 / HEIGHT)
    final = np.rint(mixed).astype(np.uint8)
    write_rgb_jpeg(out / "earth_picture.tif", final, GEOGRAPHIC, transform, 85)
