# SPDX-License-Identifier: Apache-2.0
"""Which posts know where the coast is, and how deep the sea is that they call 0.

An elevation model of land says 0 for all of the sea. Tinted so, its box shows as a pale
patch in the open sea of a coarser model that knows depths: so the tint takes those.

A coarse model's posts near sea level tell little about where the coast is: where a finer
one ends on land, the ground around it is tinted as land, less and less further away.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edges_rad, grown, overlap
from ingest.datum import undulation_m
from ingest.drape import COARSE_M
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from tiles.frames import Floats

SEA_M = -1.0, 0.2
"""Elevations that models of land give to the sea"""
SHALLOW_POSTS, LAND_M = 8, 30.0
"""Where ground is averaged over so many posts, so little land makes the sea shallow."""
UNSURE_M, LAKES_M = 60.0, 300.0
"""Coarse posts no further below the sea may be land; so much above it, what looks like
water may be a lake."""
RIM_STEPS = 16.0
"""A model's rim is averaged over this part of the distance that it counts around it."""
UNKNOWN, KNOWN, SURE = 0.0, 1.0, 2.0


def coast_of(
    cell: int,
    held: Sequence[Layer],
    places: tuple[Floats, Floats, Floats, Floats],
    step_m: float,
    beside: Sequence[tuple[Layer, float]] = (),
) -> tuple[Floats, NDArray[np.float32]]:
    """Return what a cell's tint is made from.

    Parameters
    ----------
    held : elevation models with posts in the cell, coarsest first
    places : longitudes, latitudes, heights of sea level, and elevations above it, of a
        lattice and one more all round, (n + 2, n + 2)
    step_m : of the lattice
    beside : of `fine_beside`

    Returns
    -------
    elevation_m : (n, n) above the sea; below it what a coarser source says, where the
        finest says 0 (less so near land) or bends the coarser one
    knows : (n, n) KNOWN where posts tell where the coast is, SURE where they say that there
        is none near, UNKNOWN where they are too far apart
    """
    lon, lat, zero_m, inner = (one[1:-1, 1:-1] for one in places)
    fine = [layer for layer in held if layer.spacing_m < COARSE_M]
    coarse = [layer for layer in held if layer.spacing_m >= COARSE_M]
    known = _known(cell, fine, (lon, lat), step_m)
    knows = np.where(known, KNOWN, UNKNOWN).astype(np.float32)
    if not coarse:
        return inner, knows
    sea = known & _amid(places[3])
    # Around a finer source the coarser ground is bent, the bed of the sea too.
    is_bent = ~known & (step_m < coarse[-1].spacing_m / 2)
    at = np.nonzero(sea | is_bent)
    there = lon[at], lat[at]
    bed_m = np.nan_to_num(_finest_m(coarse, *there, step_m) - zero_m[at])
    near_m = _finest_m(fine, *there, max(step_m, SHALLOW_POSTS * _least_m(fine)))
    part = np.clip(1.0 - np.nan_to_num(near_m - zero_m[at]) / LAND_M, 0.0, 1.0)
    land = _land_beside(beside, *there) * is_bent[at]
    land *= _fade(np.maximum(-bed_m / UNSURE_M, bed_m / LAKES_M))
    surely = SURE * np.clip(2.0 * land - 0.4, 0.0, 1.0)
    knows[at] = np.where(sea[at], SURE, np.maximum(knows[at], surely))
    inner = inner.copy()
    shown_m = np.where(bed_m < 0, np.fmin(inner[at], part * bed_m), inner[at])
    inner[at] = shown_m + land * (LAND_M - shown_m)
    return inner, knows


def fine_beside(mosaic: Mosaic, cell: int) -> list[tuple[Layer, float]]:
    """Return fine elevation models in or near a cell, and how far around they count."""
    found = []
    for layer in mosaic.layers:
        if layer.spacing_m < COARSE_M:
            reach_m = mosaic.reach_m(layer)
            if reach_m and overlap(cell, grown(layer.bounds_deg, reach_m)):
                found.append((layer, reach_m))
    return found


def _land_beside(beside: Sequence[tuple[Layer, float]], lon: Floats, lat: Floats) -> Floats:
    """Say how surely places lie on the land that finer models end on, (n,) 0 to 1."""
    land = np.zeros(lon.shape)
    for layer, reach_m in beside:
        at = np.flatnonzero(layer.near(lon, lat, reach_m))
        if not len(at):
            continue
        rim_m, away_m = layer.rim_heights(lon[at], lat[at], reach_m / RIM_STEPS)
        rim_m -= undulation_m("egm96", lon[at], lat[at])
        share = np.clip(np.nan_to_num(rim_m) / LAND_M, 0.0, 1.0)
        land[at] = np.maximum(land[at], share * _fade(away_m / reach_m) ** 2)
    return land


def _least_m(layers: Sequence[Layer]) -> float:
    return min((layer.spacing_m for layer in layers), default=0.0)


def _finest_m(layers: Sequence[Layer], lon: Floats, lat: Floats, step_m: float) -> Floats:
    """Return the heights of the finest layer that has any, (n,), NaN where none has."""
    found = np.full(lon.shape, np.nan)
    for layer in layers:
        own_m = layer.heights(lon, lat, step_m)
        found = np.where(np.isnan(own_m), found, own_m)
    return found


def _known(
    cell: int, fine: Sequence[Layer], places: tuple[Floats, Floats], step_m: float
) -> NDArray[np.bool_]:
    """Say which places have posts of one of the fine sources, (n, n)."""
    if any(overlap(cell, layer.bounds_deg) == edges_rad(cell) for layer in fine):
        return np.ones(places[0].shape, bool)
    known = np.zeros(places[0].shape, bool)
    for layer in fine:
        height_m = layer.heights(places[0].ravel(), places[1].ravel(), step_m)
        known |= np.isfinite(height_m).reshape(known.shape)
    return known


def _amid(elevation_m: Floats) -> NDArray[np.bool_]:
    """Say which inner places lie at 0 with all their neighbours, (n, n)."""
    sea = (elevation_m >= SEA_M[0]) & (elevation_m <= SEA_M[1])
    rows = sea[:-2] & sea[1:-1] & sea[2:]
    return np.asarray(rows[:, :-2] & rows[:, 1:-1] & rows[:, 2:])


def _fade(part: Floats) -> Floats:
    """Return 1 at 0, half at a half, and 0 from 1 on."""
    t = np.clip(part, 0.0, 1.0)
    return np.asarray(1.0 - t * t * (3.0 - 2.0 * t))
