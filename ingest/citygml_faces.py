# SPDX-License-Identifier: Apache-2.0
"""Polygons of a CityGML building: found by level of detail, links to them followed."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ingest.city_objects import (
    ANY_SURFACE,
    SURFACES,
    Faces,
    UnusableError,
    chosen_lod,
    joined,
)
from tiles.frames import Floats

_LOD = re.compile(r"lod(\d)(?!.*(?:Curve|Intersection|Implicit|Point))")
_FACES = {"Polygon", "PolygonPatch", "Triangle", "Rectangle"}
_PARTS = {"BuildingPart", "BridgePart"}
_UNSEEN = {
    "interiorRoom", "interiorBuildingInstallation", "interiorBridgeInstallation",
    "interiorBridgeRoom", "buildingRoom", "buildingSubdivision", "appearance",
    "appearanceMember",
}  # fmt: skip
_LINK = "{http://www.w3.org/1999/xlink}href"


@dataclass(frozen=True, slots=True)
class _Face:
    element: ET.Element
    lod: float
    surface: int
    flipped: bool


@dataclass(slots=True)
class _Member:
    """A building, or a part of it, with the faces that are its own."""

    is_part: bool
    faces: list[_Face] = field(default_factory=list)

    @property
    def lod(self) -> float:
        """The level of detail to take, -1 for none."""
        return chosen_lod([face.lod for face in self.faces]) if self.faces else -1.0

    def chosen(self) -> list[_Face]:
        """Return the faces of that level, each once."""
        lod = self.lod
        once: dict[int, _Face] = {}
        for face in self.faces:
            if face.lod == lod:
                once.setdefault(id(face.element), face)
        return list(once.values())


@dataclass(frozen=True, slots=True)
class _Place:
    """Where in a building the search is."""

    member: _Member
    lod: float = -1.0
    surface: int = ANY_SURFACE
    flipped: bool = False


def local(element: ET.Element) -> str:
    """Return an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]


def faces_of(building: ET.Element) -> tuple[Faces | None, int]:
    """Return all faces of a building at the level of detail to take; None for none.

    Also returns how many links to surfaces lead out of the building, so that they are
    lost.

    Raises
    ------
    UnusableError
        Where a ring is no list of points.
    """
    main = _Member(is_part=False)
    members, links = _search(building, main)
    lost = _follow(building, links)
    fine = max((int(member.lod) for member in members if member.is_part), default=-1)
    kept = [
        member.chosen() for member in members if member is not main or member.lod >= fine
    ]
    pieces = [_body(faces) for faces in kept if faces]
    return joined(pieces) if pieces else None, lost


def _search(
    building: ET.Element, main: _Member
) -> tuple[list[_Member], list[tuple[str, _Place]]]:
    """Find the polygons of each member, and links to polygons elsewhere."""
    members, links = [main], []
    ahead = [(building, _Place(main))]
    while ahead:
        element, place = ahead.pop()
        name = local(element)
        if name in _UNSEEN:
            continue
        if name in _FACES:
            place.member.faces.append(
                _Face(element, place.lod, place.surface, place.flipped)
            )
            continue
        if name in _PARTS and element is not building:
            members.append(_Member(is_part=True))
            place = _Place(members[-1])
        place = _inside(element, name, place)
        link = element.get(_LINK, "")
        if link and place.lod >= 0:
            links.append((link.removeprefix("#"), place))
        ahead += [(child, place) for child in reversed(element)]
    return members, links


def _inside(element: ET.Element, name: str, place: _Place) -> _Place:
    """Return what holds below an element."""
    lod = _LOD.match(name)
    if lod:
        return _Place(place.member, float(lod[1]), place.surface, place.flipped)
    if name in SURFACES or (name.endswith("Surface") and place.lod < 0):
        surface = SURFACES.get(name, ANY_SURFACE)
        return _Place(place.member, place.lod, surface, place.flipped)
    if name == "OrientableSurface" and element.get("orientation") == "-":
        return _Place(place.member, place.lod, place.surface, not place.flipped)
    return place


def _follow(building: ET.Element, links: list[tuple[str, _Place]]) -> int:
    """Add what is linked; what it is (roof, wall) is said where it stands itself.

    Returns how many links lead elsewhere.
    """
    if not links:
        return 0
    named = {
        value: element
        for element in building.iter()
        for key, value in element.attrib.items()
        if key.endswith("}id")
    }
    surface = {
        id(face.element): face.surface for _, place in links for face in place.member.faces
    }
    for name, place in links:
        for element in _polygons(named[name]) if name in named else ():
            kind = surface.get(id(element), ANY_SURFACE)
            place.member.faces.append(_Face(element, place.lod, kind, place.flipped))
    return sum(name not in named for name, _ in links)


def _polygons(element: ET.Element) -> Iterator[ET.Element]:
    return (one for one in element.iter() if local(one) in _FACES)


def _body(faces: list[_Face]) -> Faces:
    corners: list[Floats] = []
    rings_of_face: list[int] = []
    for face in faces:
        rings = [_ring(ring) for ring in _rings(face.element)]
        corners += [ring[::-1] if face.flipped else ring for ring in rings]
        rings_of_face.append(len(rings))
    kept = np.array(rings_of_face) > 0
    if not kept.any():
        raise UnusableError("polygons without rings")
    surface = np.array([face.surface for face in faces], np.uint8)[kept]
    return Faces(
        np.concatenate(corners),
        np.cumsum([0] + [len(ring) for ring in corners]),
        np.cumsum([0] + [count for count in rings_of_face if count]),
        surface,
        np.zeros(len(surface), np.int64),
    )


def _rings(polygon: ET.Element) -> list[ET.Element]:
    """Return a polygon's rings, the exterior first."""
    outer, inner = [], []
    for bound in polygon:
        name = local(bound)
        if name in {"exterior", "outerBoundaryIs"}:
            outer += list(bound)
        elif name in {"interior", "innerBoundaryIs"}:
            inner += list(bound)
    return outer[:1] + inner if outer else []


def _ring(ring: ET.Element) -> Floats:
    """Return the corners of a ring, (n, 3)."""
    texts, separator = [], None
    for element in ring.iter():
        name = local(element)
        if name in {"posList", "pos", "coordinates"}:
            if element.get("srsDimension", "3") != "3":
                raise UnusableError("rings without heights")
            texts.append(element.text or "")
            separator = "," if name == "coordinates" else separator
    text = " ".join(texts)
    values = (text.replace(",", " ") if separator else text).split()
    try:
        corner = np.array(values, np.float64).reshape(-1, 3)
    except ValueError as error:
        raise UnusableError("a ring that is no list of points") from error
    if not len(corner) or not np.isfinite(corner).all():
        raise UnusableError("a ring that is no list of points")
    return corner
