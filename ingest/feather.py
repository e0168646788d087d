# SPDX-License-Identifier: Apache-2.0
"""How closely the bend of a surface around a finer source must be followed.

Beside the source as closely as the source itself, further away as closely as an inner
cell that is as large as the distance. Else a large cell that only the bend reaches would
end in a cliff.
"""

from collections.abc import Sequence
from functools import partial
from heapq import heappop, heappush

import numpy as np

from ingest.boxes import grown, touches
from ingest.lattice_gap import missed_between
from ingest.layer import Layer
from ingest.mosaic import Mosaic, Rim
from ingest.truth import OWN_LATTICE, grid_places
from tiles import bounds, cells
from tiles.frames import Ecef
from tiles.terrain import TEXTURE_SIDE

BENT_LATTICE = 2 * OWN_LATTICE
"""Squares along an edge of a cell's own lattice where fewer don't show how it is bent"""
FAR_M = 3e7
"""Nothing on earth is further away than this."""


def source_bound_m(layer: Layer) -> float:
    """Return a hundredth of a source's post spacing, or half its own step."""
    return max(layer.spacing_m / 100, layer.vertical_step_m / 2)


def followed_m(
    mosaic: Mosaic, cell: int, held: Sequence[Layer] = ()
) -> tuple[float, float]:
    """Return how far off a cell may be where sources bend it, and their least spacing.

    A bend that is lower than that everywhere in the cell counts as none.

    Parameters
    ----------
    held : sources with posts in the cell, which is as close to them anyway

    Returns
    -------
    bound_m, spacing_m : infinite where none does
    """
    bound_m = spacing_m = float("inf")
    for group in mosaic.groups:
        pairs = zip(group.inner, ([layer] for layer in group.layers), strict=True)
        for rim, layers in ((group.outer, group.layers), *pairs):
            if rim is None or not _near(cell, layers, rim.feather_m):
                continue
            closest_m = min(source_bound_m(layer) for layer in layers)
            holds = any(layer in held for layer in layers)
            away_m = 0.0 if holds else distance_m(rim, cell, closest_m * TEXTURE_SIDE)
            most_m = max(closest_m, away_m / TEXTURE_SIDE)
            if rim.most_m(away_m) > most_m:
                bound_m = min(bound_m, most_m)
                spacing_m = min(spacing_m, layers[-1].spacing_m)
    return bound_m, spacing_m


def distance_m(rim: Rim, cell: int, enough_m: float) -> float:
    """Return how far a rim is from a cell, or up to a fifth less.

    Parameters
    ----------
    enough_m : less than that need not be known
    """
    open_: list[tuple[float, float, int]] = []
    parts = np.array([cell])
    while True:
        for part, centre, radius in zip(
            parts, *bounds.sphere_of(parts, 0.0, 0.0), strict=True
        ):
            near_m = rim.distance_m(Ecef(centre), FAR_M) - radius
            heappush(open_, (max(near_m, 0.0), float(radius), int(part)))
        least_m, radius_m, part = heappop(open_)
        if radius_m <= max(least_m, enough_m) / 8:
            return least_m
        parts = cells.children(part)


def _near(cell: int, layers: list[Layer], margin_m: float) -> bool:
    return touches(cell, [grown(layer.bounds_deg, margin_m) for layer in layers])


def bent_lattice(mosaic: Mosaic, cell: int, bound_m: float) -> int:
    """Return the squares along an edge of a lattice that shows how sources bend a cell.

    0 where the finest of two misses more than the bound. What a coarse source's own
    triangles miss is no matter of the bend.
    """
    for side in (OWN_LATTICE, BENT_LATTICE):
        lon, lat = grid_places(cell, side)
        for surface in (partial(mosaic.heights, step_m=0.0), mosaic.bend_m):
            heights = surface(lon.ravel(), lat.ravel()).reshape(lon.shape)
            missed_m = missed_between(surface, lon, lat, heights)
            if missed_m <= bound_m:
                return side
        # Twice as fine, it misses no less than a quarter of a smooth bend.
        if missed_m > 4 * bound_m:
            break
    return 0
