# SPDX-License-Identifier: Apache-2.0
"""Where the data of a store are: one place for each of its sources."""

import math
from dataclasses import dataclass
from typing import Any

from tiles.frames import WGS84_A_M
from tiles.store import Store

DEGREE_M = WGS84_A_M * math.pi / 180
SLOPE = math.tan(math.radians(30))
"""Of the upper edge of a picture, from its middle."""
MARGIN = 1.15
LEAST_M, MOST_M = 300.0, 1.2e7
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Place:
    """A source, and from where all of it is seen."""

    name: str
    about: str
    lon_deg: float
    lat_deg: float
    above_m: float
    """above ground, looking straight down"""


def places_of(store: Store) -> list[Place]:
    """Return the sources of terrain and buildings in order of first ingest."""
    found = [(source, _box(store, source)) for source in store.sources()]
    return [
        _place(source, box) for source, box in found if box and source["kind"] != "imagery"
    ]


def named_like(name: str, words: str) -> bool:
    """Say whether a name has words in it; case, blanks and the like make no difference."""
    wanted = _letters(words)
    return bool(wanted) and wanted in _letters(name)


def _letters(text: str) -> str:
    return "".join(one for one in text.casefold() if one.isalnum())


def _box(store: Store, source: dict[str, Any]) -> Box | None:
    """Return west, south, east, north in degrees, None where there is nothing."""
    if "bounds_deg" in source:
        west, south, east, north = source["bounds_deg"]
        return west, south, east, north
    query = (
        "SELECT MIN(lon_deg), MIN(lat_deg), MAX(lon_deg), MAX(lat_deg) FROM"
        " (SELECT lon_deg, lat_deg FROM object WHERE source = ? LIMIT 100000)"
    )
    west, south, east, north = store.connection.execute(query, (source["name"],)).fetchone()
    return None if west is None else (west, south, east, north)


def _place(source: dict[str, Any], box: Box) -> Place:
    west, south, east, north = box
    lat = (south + north) / 2
    across = (east - west) * math.cos(math.radians(lat))
    size_m = max(across, north - south) * DEGREE_M
    above_m = min(max(MARGIN * size_m / 2 / SLOPE, LEAST_M), MOST_M)
    spacing = f", {source['spacing_m']:,.0f} m" if "spacing_m" in source else ""
    about = f"{source['kind']}{spacing}"
    return Place(source["name"], about, (west + east) / 2, lat, above_m)
