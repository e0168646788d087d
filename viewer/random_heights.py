# SPDX-License-Identifier: Apache-2.0
"""Heights at random places of every source, against its own posts' triangles."""

import numpy as np

from geopage.progress import bar
from tiles.frames import Floats, Ints
from tiles.geodesy import to_ecef
from tiles.post_search import owners
from tiles.post_tree import PostTree
from tiles.source_posts import Source, terrain_sources
from tiles.store import Store
from tiles.surface import Surface
from viewer.tally import Json

PLACES, MOST_ROUNDS = 10_000, 20
"""Places a source; a source that is nearly all covered by finer ones has fewer."""
ROUNDING_M = 1e-3
"""Two ways to the same place, and an error that is stored as float32"""


def random_heights(surface: Surface, tree: PostTree, store: Store, seed: int) -> list[Json]:
    """Compare the finest drawn surface with the sources at random places.

    Places where a finer source has data, or bends the ground, are other ground: they are
    drawn again.

    Returns
    -------
    For each source its `name`, `spacing_m`, `places`; the largest difference `max_m` (along
    the vertical), with `p50_m` and `p99_m`; `bound_m`, the largest error that a tile states
    at these places; `share_of_bound`, the largest difference / error of its tile, and
    `share_within`, of places within a millimetre of that error.
    """
    rng, found = np.random.default_rng(seed), []
    sources = terrain_sources(store)
    with bar("comparing heights", len(sources), "sources") as show:
        for number, source in enumerate(sources):
            above_m, error_m = np.zeros(0), np.zeros(0)
            for _ in range(MOST_ROUNDS):
                lon, lat = places_in(source, rng)
                height_m, stated_m = surface.heights(lon, lat)
                owner, gap_m = _above(tree, np.asarray(to_ecef(lon, lat, height_m)))
                mine = owner == number
                above_m = np.append(above_m, np.abs(gap_m[mine]))[:PLACES]
                error_m = np.append(error_m, stated_m[mine])[:PLACES]
                if len(above_m) == PLACES:
                    break
            found.append(_figures(source, above_m, error_m))
            show(number + 1)
    return found


def places_in(source: Source, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return PLACES longitudes and latitudes, rad, uniform over a source's box."""
    west, south, east, north = np.radians(source["bounds_deg"])
    lon = rng.uniform(west, east, PLACES)
    low, high = np.sin(np.clip([south, north], -np.pi / 2, np.pi / 2))
    lon -= 2 * np.pi * np.round(lon / (2 * np.pi))
    return lon, np.asarray(np.arcsin(rng.uniform(low, high, PLACES)))


def _above(tree: PostTree, points: Floats) -> tuple[Ints, Floats]:
    owner, above_m = np.empty(len(points), np.int64), np.empty(len(points))
    owners(tree, np.ascontiguousarray(points), owner, above_m)
    return owner, above_m


def _figures(source: Source, away_m: Floats, error_m: Floats) -> Json:
    found: Json = {
        "name": source["name"],
        "spacing_m": float(source["spacing_m"]),
        "places": len(away_m),
    }
    if len(away_m):
        p50, p99 = np.percentile(away_m, (50, 99)).tolist()
        found |= {
            "p50_m": p50,
            "p99_m": p99,
            "max_m": float(away_m.max()),
            "bound_m": float(error_m.max()),
            "share_of_bound": float((away_m / np.maximum(error_m, ROUNDING_M)).max()),
            "share_within": float((away_m <= error_m + ROUNDING_M).mean()),
        }
    return found
