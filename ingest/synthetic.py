# SPDX-License-Identifier: Apache-2.0
"""A city of any size: real footprints over and over, on land around where they are.

For measuring with, not for looking at: every building says in its attributes that it is
a copy. Copies keep their size in metres, whatever their latitude.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from ingest.datum import undulation_m
from ingest.footprints import Footprints, read_parts
from ingest.repair import metres_per_degree
from tiles.errors import InputError
from tiles.frames import Floats
from tiles.store import Store
from tiles.surface import Surface

GAP_M = 200.0
LABEL = "synthetic"
MAX_RINGS = 400
MOST_DEG = 80.0
"""Copies are not put closer to the poles."""
_SHARES = np.linspace(0.0, 1.0, 5)


def replicated(
    path: Path, store: Path, count: int, layer: str | None, crs: str | None
) -> Iterator[Footprints]:
    """Copy a file's footprints in squares around them until there are `count`.

    Parameters
    ----------
    path : footprints, which must fit in memory
    store : whose terrain says where land is; without terrain all is land

    Raises
    ------
    InputError
        When there is not enough land around.
    """
    parts = list(read_parts(path, layer, crs))
    bounds = np.array([shapely.total_bounds(part.geometry) for part in parts])
    box = np.concatenate((np.nanmin(bounds[:, :2], 0), np.nanmax(bounds[:, 2:], 0)))
    copies = _copies(box, Path(store))
    made = 0
    for number, place in enumerate(copies):
        for part in parts:
            some = first_of(part, count - made)
            copied = _moved(some, (box[:2] + box[2:]) / 2, place)
            label = f"copy {number} of {path.name}"
            yield _labelled(copied, label, made)
            made += len(some.feature)
            if made >= count:
                return
    reason = f"only {made} copies of its buildings find land around it"
    raise InputError(path, reason, "ask for fewer with --count")


def _copies(box: Floats, store: Path) -> Iterator[Floats]:
    """Return the middles of copies on land, ring after ring, the place itself first."""
    middle = (box[:2] + box[2:]) / 2
    scale = np.array([float(m[0]) for m in metres_per_degree(middle[1:])])
    size_m = (box[2:] - box[:2]) * scale + GAP_M
    with Store(store) as opened:
        surface = Surface(opened)
        for ring in range(MAX_RINGS):
            for x, y in _ring(ring):
                lat = middle[1] + y * size_m[1] / scale[1]
                per_lon = float(metres_per_degree(np.array([lat]))[0][0])
                place = np.array((middle[0] + x * size_m[0] / per_lon, lat))
                if abs(lat) < MOST_DEG and (not ring or _is_land(surface, place, size_m)):
                    yield place


def _ring(number: int) -> list[tuple[int, int]]:
    """Return the squares around the middle one, anticlockwise from the south-west."""
    side = range(-number, number + 1)
    found = [(x, y) for y in side for x in side if max(abs(x), abs(y)) == number]
    return sorted(found, key=lambda xy: np.arctan2(xy[1], xy[0]))


def _is_land(surface: Surface, place: Floats, size_m: Floats) -> bool:
    """Tell whether 25 points of a square are on land that is not flat as the sea."""
    if not _has_terrain(surface):
        return True
    per_lon, per_lat = (float(m[0]) for m in metres_per_degree(place[1:]))
    x, y = np.meshgrid(_SHARES - 0.5, _SHARES - 0.5)
    lon = np.radians(place[0] + x.ravel() * size_m[0] / per_lon)
    lat = np.radians(place[1] + y.ravel() * size_m[1] / per_lat)
    height_m = surface.heights(lon, lat)[0] - _sea_m(lon, lat)
    return bool((height_m > 1.0).all())


def _has_terrain(surface: Surface) -> bool:
    return len(surface.forest.records) > 0


def _sea_m(lon_rad: Floats, lat_rad: Floats) -> Floats:
    return undulation_m("egm96", lon_rad, lat_rad)


def first_of(part: Footprints, count: int) -> Footprints:
    """Return a part's first features."""
    if count >= len(part.feature):
        return part
    return replace(
        part,
        feature=part.feature[:count],
        geometry=part.geometry[:count],
        columns={name: column[:count] for name, column in part.columns.items()},
        solid=None if part.solid is None else part.solid[:count],
        height_m=None if part.height_m is None else part.height_m[:count],
    )


def _moved(part: Footprints, middle: Floats, place: Floats) -> Footprints:
    """Move footprints; they keep their size in metres."""
    here, there = (
        np.array([float(m[0]) for m in metres_per_degree(one[1:])])
        for one in (middle, place)
    )
    by = place - middle * here / there

    def moved(xy: Floats) -> Floats:
        return np.asarray(xy * (here / there) + by)

    return replace(part, geometry=shapely.transform(part.geometry, moved))


def _labelled(part: Footprints, label: str, before: int) -> Footprints:
    """Say in the attributes that these are copies, and number them on."""
    size = len(part.feature)
    return replace(
        part,
        feature=before + np.arange(size),
        columns={**part.columns, LABEL: np.full(size, label, object)},
        unreadable=(),
    )
