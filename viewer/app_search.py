# SPDX-License-Identifier: Apache-2.0
"""Places by coordinates, and buildings by name or condition, a few at a time."""

import math
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from geopage.find import find_in_parts, view_of
from tiles.errors import InputError
from tiles.store import Store
from viewer.camera import Pose
from viewer.navigation_arc import GroundBelow
from viewer.places import Place, named_like, places_of

if TYPE_CHECKING:
    from collections.abc import Iterator

MOST = 50
SLICE_S = 4e-3
"""Of a frame, for searching."""
NEAR_M = 2000.0
"""Height above a place of which only longitude and latitude are known."""
LOOK_RAD = math.radians(-30.0)
NUMBER = r"[-+]?\d+(?:\.\d+)?"
NEXT = r"[°\s]*[,;\s]\s*"
PLACE = re.compile(rf"\s*({NUMBER}){NEXT}({NUMBER})(?:{NEXT}({NUMBER}))?\s*[m°]?\s*")
NAMES = (
    "name",
    "addr:housename",
    "address",
    "addr:street",
    "title",
    "label",
    "type",
    "building",
)


@dataclass(frozen=True, slots=True)
class Hit:
    """Something found."""

    name: str
    label: str
    lon_deg: float
    lat_deg: float
    above_m: float
    """height above ground from which to look"""
    straight: bool = False
    """look straight down"""
    number: int | None = None
    """id of the object that it is"""

    def away(self, pose: Pose) -> float:
        """Return how far it is from below a pose, as a cosine: -1 is there."""
        lon, lat = math.radians(self.lon_deg), math.radians(self.lat_deg)
        across = math.cos(lat) * math.cos(pose.lat_rad) * math.cos(lon - pose.lon_rad)
        return -(across + math.sin(lat) * math.sin(pose.lat_rad))

    def pose(self, ground: GroundBelow) -> Pose:
        """Return where to look at it from."""
        lon, lat = math.radians(self.lon_deg), math.radians(self.lat_deg)
        pitch = -math.pi / 2 if self.straight else LOOK_RAD
        at = Pose(lon, lat, 0.0, 0.0, pitch)
        return Pose(lon, lat, ground(at) + self.above_m, 0.0, pitch)


class Search:
    """One question at a time; `step` looks on for a few milliseconds.

    Raises nothing: what is wrong with a question is its `message`.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._parts: Iterator[list[int]] | None = None
        self._near: Pose | None = None
        self.sources = [hit_of_source(one) for one in places_of(store)]
        """where the store's data are"""
        self.hits: list[Hit] = []
        self._words = ""
        self._first: list[Hit] = []
        """sources of the name that is looked for; they stand before all others"""
        self.message = ""

    @property
    def on(self) -> bool:
        """Whether it is still looking."""
        return self._parts is not None

    @property
    def best(self) -> Hit | None:
        """What to fly to without a question: the only hit, or a source of that name."""
        sure = len(self.hits) == 1 or (
            self._first and named_like(self._words, self._first[0].name)
        )
        return self.hits[0] if self.hits and sure else None

    def ask(self, words: str, near: Pose | None = None) -> None:
        """Begin to look for something; what is nearest to a pose comes first."""
        self.hits, self.message, self._parts = [], "", None
        self._near, self._first = near, []
        if not words.strip():
            return
        if (place := place_of(words)) is not None:
            self.hits = [place]
            return
        if PLACE.fullmatch(words):
            self.message = "latitude is -90 to 90, longitude -180 to 360"
            return
        self._words = words
        like = [hit for hit in self.sources if named_like(hit.name, words)]
        self._first = sorted(like, key=lambda hit: len(hit.name))
        try:
            self._parts = find_in_parts(self._store, words)
        except InputError as error:
            self.message = str(error)

    def step(self) -> bool:
        """Look on; says whether there is anything new."""
        if self._parts is None:
            return False
        ends_s = time.perf_counter() + SLICE_S
        while time.perf_counter() < ends_s and self._parts is not None:
            ids = next(self._parts, None)
            room = MOST - len(self.hits)
            self.hits += [hit_of(one) for one in self._store.objects((ids or [])[:room])]
            if ids is None or len(ids) > room:
                self._end(more=ids is not None)
        return True

    def _end(self, *, more: bool) -> None:
        self._parts = None
        if (near := self._near) is not None:
            self.hits.sort(key=lambda hit: hit.away(near))
        self.hits = self._first + self.hits
        if self.hits:
            count = f"{len(self.hits)} found"
            found = f"the first {len(self.hits)}" if more else count
            self.message = f"{found}: click one to fly there"
        else:
            names = ", ".join(one.name for one in self.sources)
            self.message = f"nothing found; there is {names}"


def place_of(words: str) -> Hit | None:
    """Read LAT, LON and perhaps a height above ground; None where it is no place."""
    form = PLACE.fullmatch(words)
    if form is None:
        return None
    lat, lon = float(form[1]), float(form[2])
    if not (-90 <= lat <= 90 and -180 <= lon <= 360):
        return None
    above_m = float(form[3]) if form[3] else NEAR_M
    name = f"{lat:g}, {lon:g}"
    return Hit(name, name, lon, lat, max(above_m, 2.0), straight=True)


def hit_of(found: dict[str, Any]) -> Hit:
    """Return an object of the store as a hit."""
    lat, lon, above_m = (float(part) for part in view_of(found).split(","))
    title = title_of(found)
    return Hit(title, title, lon, lat, above_m, number=int(found["id"]))


def hit_of_source(place: Place) -> Hit:
    """Return a source of the store as a hit."""
    label, where = f"{place.name} ({place.about})", (place.lon_deg, place.lat_deg)
    return Hit(place.name, label, *where, place.above_m, straight=True)


def title_of(found: dict[str, Any]) -> str:
    """Return what a person would call an object."""
    attributes = found["attributes"]
    named = next((str(attributes[n]) for n in NAMES if attributes.get(n)), "")
    height = f"{found['height_m']:.0f} m high"
    return f"{named} ({height})" if named else f"object {found['id']}, {height}"
