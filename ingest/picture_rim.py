# SPDX-License-Identifier: Apache-2.0
"""Pictures fade out towards their rims, so that none stands out as a frame."""

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import DEGREE_M, edges_rad
from ingest.layer import Layer
from ingest.polar import lon_at
from tiles.frames import WGS84_A_M, Floats
from tiles.terrain import TEXTURE_SIDE

RIM_SHARE, MOST_RIM_M = 0.06, 4000.0
"""A rim's width, as a share of a picture's shorter side, and no more than this"""
ALIKE = 4.0
"""Pictures up to so many times as coarse go on where one ends: there it has no rim."""
LEAST_TEXELS = 2.0
SPANS = 32, 64, 128
AROUND = 8
"""Directions in which a place looks for the rim, over the rim's width and half of it"""


def rim_m(layer: Layer) -> float:
    """Return how far from its edges a picture is faded."""
    west, south, east, north = layer.bounds_deg
    across = (east - west) * float(np.cos(np.radians((south + north) / 2)))
    return min(RIM_SHARE * min(across, north - south) * DEGREE_M, MOST_RIM_M)


def faded(cell: int, layer: Layer, pictures: list[Layer]) -> Floats:
    """Return how much of a picture shows over a cell's texture.

    Parameters
    ----------
    pictures : all that meet the cell

    Returns
    -------
    (n + 1, n + 1) at nodes, row 0 south: 1 except near its rims
    """
    _, south, _, north = edges_rad(cell)
    width_m, texel_m = rim_m(layer), (north - south) * WGS84_A_M / TEXTURE_SIDE
    if layer.wraps or width_m < LEAST_TEXELS * texel_m:
        return np.ones((2, 2))
    fits = [n for n in SPANS if 2.0 * TEXTURE_SIDE * texel_m / n <= width_m]
    along = np.linspace(0.0, 1.0, [*fits, SPANS[-1]][0] + 1)
    u, lat = np.meshgrid(along, south + along * (north - south))
    lon, alike = lon_at(cell, u, lat), [one for one in pictures if _is_alike(one, layer)]
    shown = np.zeros(lon.shape)
    for part in (0.5, 1.0):
        for turn in 2.0 * np.pi * np.arange(AROUND) / AROUND:
            shown += _shown(alike, lon, lat, part * width_m, turn, width_m / 8.0)
    t = np.clip(shown / AROUND - 1.0, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _is_alike(one: Layer, layer: Layer) -> bool:
    return one.spacing_m < ALIKE * layer.spacing_m


def _shown(
    pictures: list[Layer],
    lon: Floats,
    lat: Floats,
    away_m: float,
    turn: float,
    step_m: float,
) -> NDArray[np.bool_]:
    """Say where one of the pictures shows so far away in a direction."""
    up = away_m / WGS84_A_M
    there = np.clip(lat + up * np.sin(turn), -np.pi / 2, np.pi / 2).ravel()
    beside = lon.ravel() + up * np.cos(turn) / np.maximum(np.cos(there), 1e-3)
    shown = np.zeros(there.shape, bool)
    for one in pictures:
        shown |= one.shows(beside, there, step_m)
    return shown.reshape(lon.shape)
