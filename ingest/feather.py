# SPDX-License-Identifier: Apache-2.0
"""How closely the bend of a surface around a finer source must be followed.

Beside the source as closely as the source itself, further away as closely as an inner
cell that is as large as the distance. Else a large cell that only the bend reaches would
end in a cliff.
"""

from ingest.boxes import grown, touches
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from tiles import bounds
from tiles.frames import Ecef
from tiles.terrain import TEXTURE_SIDE


def source_bound_m(layer: Layer) -> float:
    """Return a hundredth of a source's post spacing, or half its own step."""
    return max(layer.spacing_m / 100, layer.vertical_step_m / 2)


def followed_m(mosaic: Mosaic, cell: int) -> tuple[float, float]:
    """Return how far off a cell may be where sources bend it, and their least spacing.

    Returns
    -------
    bound_m, spacing_m : infinite where none does
    """
    centre, radius = bounds.sphere_of(cell, 0.0, 0.0)
    bound_m = spacing_m = float("inf")
    for group in mosaic.groups:
        pairs = zip(group.inner, ([layer] for layer in group.layers), strict=True)
        for rim, layers in ((group.outer, group.layers), *pairs):
            if rim is None or not _near(cell, layers, rim.feather_m):
                continue
            far_m = float(radius) + rim.feather_m
            near_m = rim.distance_m(Ecef(centre), far_m)
            if near_m < far_m:
                away_m = max(near_m - float(radius), 0.0)
                closest_m = min(source_bound_m(layer) for layer in layers)
                bound_m = min(bound_m, max(closest_m, away_m / TEXTURE_SIDE))
                spacing_m = min(spacing_m, layers[-1].spacing_m)
    return bound_m, spacing_m


def _near(cell: int, layers: list[Layer], margin_m: float) -> bool:
    return touches(cell, [grown(layer.bounds_deg, margin_m) for layer in layers])
