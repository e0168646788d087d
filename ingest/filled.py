# SPDX-License-Identifier: Apache-2.0
"""A source's posts, and other sources' heights where it has none."""

import numpy as np
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.mosaic import Mosaic
from tiles.frames import Floats

QUARTERS = 4
CORNER_STEPS = (0, 0), (0, 1), (1, 0), (1, 1)
Grid = tuple[Floats, Floats, Floats, NDArray[np.bool_]]


def filled(
    mosaic: Mosaic, layer: Layer, box: tuple[int, int, int, int], parts: int
) -> Grid:
    """Return a source's posts in a box: lon, lat, heights, and where others fill in.

    Where others do, their own posts lie between these: with `parts` above 1, so many
    steps from post to post are places of the lattice, too.
    """
    left, top, right, bottom = box
    cols = left + np.arange((right - left - 1) * parts + 1) / parts
    rows = top + np.arange((bottom - top - 1) * parts + 1) / parts
    col, row = np.meshgrid(cols, rows)
    lon, lat = (one.reshape(col.shape) for one in layer.places(col.ravel(), row.ravel()))
    heights = np.full(col.shape, np.nan)
    heights[::parts, ::parts] = layer.posts(left, top, right, bottom)
    if parts > 1:
        at = np.isnan(heights)
        heights[at] = layer.heights(lon[at], lat[at], 0.0)
    void = np.isnan(heights)
    if void.any():
        heights[void] = mosaic.heights(lon[void], lat[void], 0.0)
    return lon, lat, heights, void


def missed_of(
    mosaic: Mosaic,
    layer: Layer,
    lon: Floats,
    lat: Floats,
    heights: Floats,
    void: NDArray[np.bool_],
) -> float:
    """Return how far other sources are from the posts that stand in for theirs.

    Looked for at quarters of each square where the source has no data: of a bend between
    two such places three quarters are seen.
    """
    empty = void[:-1, :-1] | void[:-1, 1:] | void[1:, :-1] | void[1:, 1:]
    r, c = np.nonzero(empty)
    largest_m = 0.0
    for fx, fy in np.argwhere(np.ones((QUARTERS, QUARTERS)))[1:] / QUARTERS:
        weights = 1 - max(fx, fy), max(fx - fy, 0.0), max(fy - fx, 0.0), min(fx, fy)
        there = [
            sum(
                weight * posts[r + down, c + across]
                for weight, (down, across) in zip(weights, CORNER_STEPS, strict=True)
            )
            for posts in (lon, lat, heights)
        ]
        gap_m = np.abs(mosaic.beside(layer, there[0], there[1]) - there[2])
        largest_m = max(largest_m, float(np.nanmax(gap_m, initial=0.0)))
    return largest_m * QUARTERS / (QUARTERS - 1)
