# SPDX-License-Identifier: Apache-2.0
"""Attributes of a CityGML object: its own, generic ones, and those of extensions."""

import re
import xml.etree.ElementTree as ET
from typing import Any

from ingest.citygml_faces import local

_GENERIC = re.compile(r"(string|int|double|date|uri|measure|code)Attribute", re.IGNORECASE)
_GEOMETRY = re.compile(
    r"lod\d|bounded|boundary|consistsOf|outer|interior|opening|appearance|"
    r"building(Part|Installation|Room|Constructive)|bridge(Part|Installation)",
)
_METRES = re.compile(r"(.*[:#/])?(m|metre|meter)?", re.IGNORECASE)
_DEEPEST = 20


def attributes_of(element: ET.Element) -> dict[str, Any]:
    """Return the attributes of a building; what has parts of its own as a dictionary."""
    found: dict[str, Any] = {}
    for child in element:
        name = local(child)
        if _GEOMETRY.match(name):
            continue
        generic = _generic(child)
        for key, value in generic or ((name, _value(child, 0)),):
            _add(found, key, value)
    return found


def _generic(element: ET.Element, prefix: str = "") -> list[tuple[str, Any]]:
    """Return names and values of a generic attribute, or of a set of them."""
    kind, name = local(element), prefix + element.get("name", "")
    if kind == "genericAttributeSet":
        members = [_generic(one, f"{name}.") for one in element]
        return [pair for member in members for pair in member]
    inner = list(element)
    if kind == "genericAttribute" and inner:  # CityGML 3.0: wrapped, the name inside
        texts = {local(one): one for one in inner[0]}
        if "name" in texts and "value" in texts:
            label = prefix + (texts["name"].text or "")
            return [(label, _leaf(texts["value"], local(inner[0])))]
        return []
    if name and _GENERIC.fullmatch(kind) and inner:
        return [(name, _leaf(inner[0], kind))]
    return []


def _value(element: ET.Element, depth: int) -> Any:
    """Return the text of a leaf, or what is below by name."""
    if not len(element):
        return _leaf(element, local(element))
    if depth == _DEEPEST:
        return None
    found: dict[str, Any] = {}
    for child in element:
        _add(found, local(child), _value(child, depth + 1))
    # A property that only wraps one object: the object's own name adds nothing.
    if len(element) == 1 and isinstance(found.get(local(element[0])), dict):
        return found[local(element[0])]
    return found or None


def _leaf(element: ET.Element, kind: str) -> Any:
    text = (element.text or "").strip() or None
    if text is None:
        return None
    unit = element.get("uom", "")
    if kind.lower().startswith(("int", "double", "measure", "storeys")):
        number = _number(text)
        is_metric = _METRES.fullmatch(unit) is not None or "height" not in kind.lower()
        return number if is_metric else f"{text} {unit}"
    return text


def _number(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _add(found: dict[str, Any], name: str, value: Any) -> None:
    """Add a value; a name that is there already becomes a list."""
    if value is None:
        return
    if name not in found:
        found[name] = value
    elif isinstance(found[name], list):
        found[name].append(value)
    else:
        found[name] = [found[name], value]
