# SPDX-License-Identifier: Apache-2.0
"""CityGML 1.0, 2.0 and 3.0: one object a building, read element by element.

Names are matched without their namespace, which is all in which the versions differ for
what is read here. A document type is refused: it could define entities without bound.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final
from xml.parsers import expat

from ingest.city_objects import (
    NO_GEOMETRY,
    NOT_A_BUILDING,
    CityObject,
    UnusableError,
    flat_attributes,
    open_model,
)
from ingest.citygml_attributes import attributes_of
from ingest.citygml_faces import faces_of, local
from tiles.errors import InputError

_MEMBERS = {"cityObjectMember", "featureMember", "featureMembers", "member"}
_ROOTS = {"Building", "BuildingPart", "Bridge", "BridgePart"}
_PARTS: Final = {"BuildingPart", "BridgePart"}
_MAX_DEPTH = 200
_CHUNK = 1 << 16


class _PrologDone(Exception):  # noqa: N818 - nothing went wrong
    """The first element was reached."""


def read_citygml(path: Path, notes: list[str]) -> Iterator[CityObject]:
    """Read the objects of a CityGML file, also gzip, in bounded memory.

    Parameters
    ----------
    notes : filled with warnings about the file

    Raises
    ------
    InputError
        Where it is no XML, or has a document type.
    """
    lost = [0]
    try:
        with open_model(path) as stream:
            _refuse_doctype(path, stream)
        with open_model(path) as stream:
            yield from _objects(path, stream, lost)
    except (ET.ParseError, expat.ExpatError, LookupError, ValueError) as error:
        words = str(error)[:200]
        raise InputError(path, f"not XML ({words})", "check the file") from error
    if lost[0]:
        notes.append(f"{path.name}: {lost[0]} links to surfaces of other objects lost")


def _refuse_doctype(path: Path, stream: IO[bytes]) -> None:
    """Read up to the first element; a document type can only be before it."""

    def doctype(*_: object) -> None:
        raise InputError(path, "an XML document type", "take out the DOCTYPE")

    def element(*_: object) -> None:
        raise _PrologDone

    isfinal = True
    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = doctype
    parser.StartElementHandler = element
    try:
        while chunk := stream.read(_CHUNK):
            parser.Parse(chunk)
        parser.Parse(b"", isfinal)
    except _PrologDone:
        return


def _objects(path: Path, stream: IO[bytes], lost: list[int]) -> Iterator[CityObject]:
    """Yield an object for each child of a member; what was read is let go."""
    ancestors: list[ET.Element] = []
    srs: str | None = None
    count = 0
    for event, element in ET.iterparse(stream, ("start", "end")):
        if event == "start":
            if len(ancestors) > _MAX_DEPTH:
                raise InputError(
                    path, f"XML nested deeper than {_MAX_DEPTH}", "check the file"
                )
            ancestors.append(element)
            continue
        ancestors.pop()
        depth = len(ancestors)
        if depth == 2 and local(ancestors[-1]) in _MEMBERS:
            yield _city_object(element, count, srs, lost)
            count += 1
        elif depth == 2 and srs is None:
            srs = _srs(element)
        if depth in {1, 2}:
            ancestors[-1].remove(element)


def _srs(element: ET.Element) -> str | None:
    """Return the first CRS named in an element."""
    found = (one.get("srsName") for one in element.iter())
    return next((name for name in found if name), None)


def _city_object(
    element: ET.Element, number: int, srs: str | None, lost: list[int]
) -> CityObject:
    kind = local(element)
    if kind not in _ROOTS:
        return CityObject(number, reason=f"{kind[:60]}: {NOT_A_BUILDING}")
    try:
        faces, lost_here = faces_of(element)
    except UnusableError as error:
        return CityObject(number, reason=str(error))
    lost[0] += lost_here
    if faces is None:
        return CityObject(number, reason=NO_GEOMETRY)
    parts = sum(local(one) in _PARTS for one in element.iter()) - (kind in _PARTS)
    ident = next((v for k, v in element.attrib.items() if k.endswith("}id")), "")
    attributes = flat_attributes(attributes_of(element), ident or str(number), parts)
    return CityObject(number, _srs(element) or srs, attributes, faces)
