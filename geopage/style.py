# SPDX-License-Identifier: Apache-2.0
"""What a person asks for with `--style`: a field, and its colours.

height                       numbers: a ramp; few values or texts: categories
height:magma                 a ramp, from the 2 % to the 98 % quantile
building:levels:blues:1,12   a ramp between two values
building=house:#e0b0a0,*:#ccc   categories; * is all others
style.json                   the same in a file:
                             {"field": "height", "ramp": "magma", "min": 0, "max": 90}
                             {"field": "building", "colours": {"house": "#e0b0a0"}}
"""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geopage.palettes import RAMPS, Colour, colour_of
from tiles.errors import InputError

ADVICE = "write FIELD, FIELD:viridis, FIELD:viridis:MIN,MAX, FIELD=VALUE:#rrggbb,..."
DEFAULT_RAMP = "viridis"
MOST_COLOURS = 250
OTHERS = "*"
_RAMP = re.compile(rf"(.+?):({'|'.join(RAMPS)})(?::([^,:]+),([^,:]+))?")

_AFTER_COLOUR = re.compile(r"(?<=#[0-9a-fA-F]{3}),|(?<=#[0-9a-fA-F]{6}),")


@dataclass(frozen=True, slots=True)
class Style:
    """Colours of objects by a field of theirs."""

    field: str
    ramp: str | None = None
    """name of a ramp"""
    limits: tuple[float, float] | None = None
    """the ramp's first and last value"""
    colours: tuple[tuple[str, Colour], ...] = ()
    """values with their colours; neither these nor a ramp: as the values suggest"""


def parse_style(words: str) -> Style:
    """Read a style, or the JSON file that holds one.

    Raises
    ------
    InputError
    """
    try:
        if words.lower().endswith(".json"):
            return _from_file(Path(words))
        if form := _RAMP.fullmatch(words.strip()):
            field, name, *ends = form.groups()
            return Style(field.strip(), name, _limits(ends) if ends[0] else None)
        return _from_words(*(part.strip() for part in words.partition("=")))
    except ValueError as error:
        raise InputError(repr(words), f"is no style ({error})", ADVICE) from error


def _from_words(field: str, equals: str, rest: str) -> Style:
    if not field or (equals and not rest):
        raise ValueError("lacks a field or its colours")
    return Style(field, colours=_colours(_pairs(field, rest)) if equals else ())


def _from_file(path: Path) -> Style:
    try:
        found = json.loads(path.read_text("utf-8"))
    except OSError as error:
        reason = str(error.strerror or error)
        raise InputError(path, reason, "name a style's file") from error
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"is no JSON ({error})", "correct it") from error
    if not isinstance(found, dict) or not isinstance(found.get("field"), str):
        raise ValueError("lacks a field")  # noqa: TRY004 (of a file, not of an argument)
    unknown = found.keys() - {"field", "ramp", "min", "max", "colours"}
    if unknown:
        raise ValueError(f"has {', '.join(sorted(unknown))}, which is unknown")
    name, colours = found.get("ramp"), found.get("colours", {})
    if name is not None and name not in RAMPS:
        raise ValueError(f"has no ramp {name!r}; there are {', '.join(RAMPS)}")
    if not isinstance(colours, dict) or (name and colours):
        raise ValueError("needs a ramp, or an object of colours")
    ends = [found.get("min"), found.get("max")]
    limits = _limits(ends) if any(one is not None for one in ends) else None
    if limits and colours:
        raise ValueError("has limits, which are a ramp's, and colours")
    name = name or (DEFAULT_RAMP if limits else None)
    return Style(found["field"], name, limits, _colours(colours))


def _limits(ends: list[Any]) -> tuple[float, float]:
    try:
        low, high = (float(one) for one in ends)
    except TypeError as error:
        raise ValueError("needs both limits, as numbers") from error
    if not (np.isfinite([low, high]).all() and low < high):
        raise ValueError("needs a first limit below the second")
    return low, high


def _pairs(field: str, text: str) -> dict[str, str]:
    """Split VALUE:#rrggbb,VALUE:#rrggbb; values may hold colons and commas.

    The field may be said again before each value.
    """
    cut = [part.rpartition(":") for part in _AFTER_COLOUR.split(text)]
    return {value.strip().removeprefix(f"{field}="): colour for value, _, colour in cut}


def _colours(given: dict[str, Any]) -> tuple[tuple[str, Colour], ...]:
    if len(given) > MOST_COLOURS:
        raise ValueError(f"has more than {MOST_COLOURS} colours")
    return tuple((str(value), colour_of(str(one))) for value, one in given.items())
