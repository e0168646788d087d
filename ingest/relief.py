# SPDX-License-Identifier: Apache-2.0
"""Slopes for relief shading, the same from tile to tile.

Between its posts a source knows no slope: on a finer lattice the triangles between its
posts would show, and smaller tiles beside a finer source would look other than their
neighbours. So a slope is never taken over less than the spacing of the source that shows
there, and is exaggerated as in a tile that is made of that source's posts.
"""

import numpy as np
from numpy.typing import NDArray

from ingest.mosaic import Mosaic
from tiles.frames import WGS84_A_M, Floats

WIDER = 1.5
"""A lattice finer than the posts by this factor takes slopes over the posts' spacing."""
LEAF_TEXELS = 8.0
"""About how many texels of a leaf made of a source's posts are as long as their spacing"""
HOLE_POSTS = 8
"""A hole in a source that is no wider is shaded like the ground around it."""
STEEPER, STEEP_M, MOST_DECADES = 2.2, 100.0, 2.5
"""Slopes are exaggerated more by so much for each decade of texels above so many metres."""


def slopes_of(
    mosaic: Mosaic, lon: Floats, lat: Floats, heights: Floats, sides_m: tuple[float, float]
) -> Floats:
    """Return exaggerated slopes at a lattice's inner places, and how much they are so.

    Parameters
    ----------
    lon, lat, heights : (n + 2, n + 2) of a lattice and one more all round, rad and m
    sides_m : of the lattice's squares and of the texels

    Returns
    -------
    (n, n, 3) down towards the east, down towards the north, exaggeration
    """
    step_m, texel_m = sides_m
    inner_lon, inner_lat = lon[1:-1, 1:-1], lat[1:-1, 1:-1]
    out = np.empty((*inner_lon.shape, 3))
    out[..., :2] = lattice_slopes(lon, lat, heights)
    out[..., 2] = steeper_of(np.array(texel_m))
    if any(layer.spacing_m > WIDER * step_m for layer in mosaic.layers):
        found = mosaic.spacing_m(inner_lon.ravel(), inner_lat.ravel())
        spacing_m = found.reshape(inner_lon.shape)
        wide = np.isfinite(spacing_m) & (spacing_m > WIDER * step_m)
        wide[wide] = ~_in_hole(mosaic, inner_lon[wide], inner_lat[wide], spacing_m[wide])
        places = inner_lon[wide], inner_lat[wide]
        out[wide, :2] = _wide_slopes(mosaic, *places, spacing_m[wide], step_m)
        out[wide, 2] = steeper_of(np.maximum(texel_m, spacing_m[wide] / LEAF_TEXELS))
    return out


def _in_hole(
    mosaic: Mosaic, lon: Floats, lat: Floats, spacing_m: Floats
) -> NDArray[np.bool_]:
    """Say which places, (k,), a finer source surrounds than the one that shows there."""
    found = np.zeros(lon.shape, bool)
    for layer in mosaic.layers:
        at = np.flatnonzero(layer.spacing_m < spacing_m)
        if len(at):
            around_m = layer.heights(lon[at], lat[at], HOLE_POSTS * layer.spacing_m)
            found[at] |= np.isfinite(around_m)
    return found


def steeper_of(texel_m: Floats) -> Floats:
    """Return how much slopes are exaggerated where a texel is so large."""
    decades = np.log10(np.maximum(texel_m, 1.0) / STEEP_M)
    return np.asarray(1.0 + STEEPER * np.clip(decades, 0.0, MOST_DECADES))


def lattice_slopes(lon: Floats, lat: Floats, heights: Floats) -> Floats:
    """Return slopes from a lattice's neighbours, (n, n, 2)."""
    # Rows lie along parallels; columns lean towards a pole (ingest/polar.py).
    turn = np.maximum(lon[1:-1, 2:] - lon[1:-1, :-2], 1e-12)
    fall = (heights[1:-1, :-2] - heights[1:-1, 2:]) / turn
    east = fall / (WGS84_A_M * np.maximum(np.cos(lat[1:-1, :1]), 1e-3))
    lean = fall * (lon[2:, 1:-1] - lon[:-2, 1:-1])
    rise = np.maximum(lat[2:, 1:-1] - lat[:-2, 1:-1], 1e-12) * WGS84_A_M
    north = (heights[:-2, 1:-1] - heights[2:, 1:-1] - lean) / rise
    return np.stack([east, north], axis=-1)


def _wide_slopes(
    mosaic: Mosaic, lon: Floats, lat: Floats, reach_m: Floats, step_m: float
) -> Floats:
    """Return slopes over a distance each way, (k, 2)."""
    up = reach_m / WGS84_A_M
    side = np.minimum(up / np.maximum(np.cos(lat), 1e-3), 0.1)
    lons = np.concatenate([lon - side, lon + side, lon, lon])
    lats = np.concatenate([lat, lat, lat - up, lat + up])
    lons = (lons + np.pi) % (2 * np.pi) - np.pi
    found = mosaic.heights(lons, np.clip(lats, -np.pi / 2, np.pi / 2), step_m)
    west, east, south, north = found.reshape(4, -1)
    return np.stack([(west - east) / (2 * reach_m), (south - north) / (2 * reach_m)], -1)
