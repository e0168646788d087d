# SPDX-License-Identifier: Apache-2.0
"""Objects by their attributes.

`FIELD=VALUE`, `!=`, `<`, `<=`, `>`, `>=` compare one field, as numbers where both sides
are; `FIELD~TEXT` asks whether it contains a text, and a plain TEXT whether any attribute
does. Upper and lower case are alike.
"""

import math
import operator
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any

from geopage.fields import VALUE, Value, known_field, number_of
from tiles.errors import InputError
from tiles.store import Store

COMPARE: dict[str, Callable[[Any, Any], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "!=": operator.ne,
    "=": operator.eq,
    ">": operator.gt,
    "<": operator.lt,
}
_FORM = re.compile(r"([^=<>!~]*)(>=|<=|!=|=|>|<|~)(.*)", re.DOTALL)
ADVICE = "write FIELD=VALUE, FIELD>10, FIELD~TEXT or TEXT"
_ANY = "EXISTS(SELECT 1 FROM json_each(attributes) WHERE {})"
_SOURCE = "source"
STEEPNESS = math.tan(math.radians(30))
"""Of the way that `geopage render` looks when it is not told."""


@dataclass(frozen=True, slots=True)
class Condition:
    """What an object must fulfil."""

    field: str | None
    """None: any attribute"""
    compare: str
    """one of `COMPARE`, or ~ for contains"""
    value: str

    def holds(self, value: Value) -> bool:
        """Say whether a field's value fulfils it; nothing is fulfilled by no value."""
        if value is None:
            return False
        text, wanted = str(value).casefold(), self.value.casefold()
        if self.compare == "~":
            return wanted in text
        both = number_of(value), number_of(self.value)
        if both[0] is not None and both[1] is not None:
            return COMPARE[self.compare](*both)
        return self.compare in {"=", "!="} and COMPARE[self.compare](text, wanted)


def parse(words: str) -> Condition:
    """Read a condition.

    Raises
    ------
    InputError
    """
    form = _FORM.fullmatch(words.strip())
    if form is None:
        if not words.strip():
            raise InputError(repr(words), "asks for nothing", ADVICE)
        return Condition(None, "~", words.strip())
    field, compare, value = (part.strip() for part in form.groups())
    if not field or not value:
        raise InputError(repr(words), "lacks a field or a value", ADVICE)
    if compare not in {"=", "!=", "~"} and number_of(value) is None:
        raise InputError(repr(words), f"compares with {value!r}, not a number", ADVICE)
    return Condition(field, compare, value)


def find_ids(store: Store, words: str) -> list[int]:
    """Return the ids of all objects that fulfil a condition, ascending.

    Raises
    ------
    InputError
        When the condition can't be read, or no object has its field.
    """
    return list(chain.from_iterable(find_in_parts(store, words)))


def find_in_parts(store: Store, words: str, at_once: int = 2000) -> Iterator[list[int]]:
    """Return the same a few at a time: ids among the next `at_once`, perhaps none.

    Raises
    ------
    InputError
        When the condition can't be read, or no object has its field.
    """
    condition, given = _sql_of(store, words)
    last = store.connection.execute("SELECT MAX(id) FROM object").fetchone()[0] or 0
    ask = f"SELECT id FROM object WHERE id BETWEEN ? AND ? AND ({condition}) ORDER BY id"
    return (
        [int(one) for (one,) in store.connection.execute(ask, (k, k + at_once - 1, *given))]
        for k in range(0, last + 1, at_once)
    )


def _sql_of(store: Store, words: str) -> tuple[str, tuple[str, ...]]:
    """Return a condition as SQL, and what its question marks stand for."""
    wanted = parse(words)
    store.connection.create_function("holds", 1, wanted.holds, deterministic=True)
    if wanted.field is None:
        return _ANY.format(f"holds({VALUE})"), ()
    field = known_field(store, wanted.field)
    if field.is_own:
        return f"holds({field.name})", ()
    attribute = _ANY.format(f"key=? AND holds({VALUE})")
    if field.name.lower() == _SOURCE:
        # Many maps have an attribute of this name; it must not hide the store's sources.
        other = _ANY.format(f"key=? AND NOT holds({VALUE})")
        is_other = wanted.compare == "!="
        attribute = f"NOT {other}" if is_other else attribute
        attribute = f"holds({_SOURCE}) {'AND' if is_other else 'OR'} {attribute}"
    return attribute, (field.name,)


def view_of(found: dict[str, Any]) -> str:
    """Return LAT,LON,HEIGHT for `geopage render --at`, whose picture shows the object.

    The eye is south of it and looks north and 30 degrees down, as `render` does when it
    is told nothing else; the height is above ground.
    """
    away_m = 2 * found["dimension_m"] + 30
    height_m = found["height_m"] / 2 + away_m * STEEPNESS
    lat = max(found["lat_deg"] - away_m / 111_000, -90.0)
    lon = (found["lon_deg"] + 180) % 360 - 180
    return f"{lat:.6f},{lon:.6f},{height_m:.0f}"
