# SPDX-License-Identifier: Apache-2.0
"""Fields of objects: what the store itself knows of them, and their sources' attributes."""

from collections.abc import Iterator
from math import isfinite
from typing import NamedTuple

from tiles.errors import InputError
from tiles.store import Store

COLUMNS = ("id", "source", "lon_deg", "lat_deg", "base_m", "height_m", "dimension_m")
VALUE = "CASE type WHEN 'true' THEN 'true' WHEN 'false' THEN 'false' ELSE value END"
"""Of a row of json_each; truth values in words, as JSON has them."""
LISTED = 12
Value = str | int | float | None


class Field(NamedTuple):
    """A field of objects."""

    name: str
    is_own: bool
    """a column of the store's object table, not an attribute"""


def number_of(value: Value) -> float | None:
    """Return a value as a number, also where the source wrote a number as text."""
    try:
        number = None if value is None else float(value)
    except ValueError:
        return None
    return number if number is not None and isfinite(number) else None


def known_field(store: Store, name: str) -> Field:
    """Return the field of a name; letters may differ in case.

    An attribute goes before the store's own field; `height` is `height_m` where no source
    has such an attribute.

    Raises
    ------
    InputError
        When no object has it.
    """
    for alike in ("key=?", "key=? COLLATE NOCASE"):
        ask = f"SELECT key FROM object, json_each(attributes) WHERE {alike} LIMIT 1"
        if found := store.connection.execute(ask, (name,)).fetchone():
            return Field(str(found[0]), is_own=False)
    for own in (name.lower(), f"{name.lower()}_m"):
        if own in COLUMNS:
            return Field(own, is_own=True)
    names = ", ".join(dict.fromkeys((*attribute_names(store), *COLUMNS)))
    raise InputError(store.path, f"no object has a field {name!r}", f"there are {names}")


def attribute_names(store: Store) -> list[str]:
    """Return the commonest names of attributes."""
    ask = (
        "SELECT key FROM (SELECT attributes FROM object WHERE"
        " id % (1 + (SELECT MAX(id) FROM object) / 10000) = 0), json_each(attributes)"
        " GROUP BY key ORDER BY COUNT(*) DESC, key LIMIT ?"
    )
    return [str(key) for (key,) in store.connection.execute(ask, (LISTED,))]


def values_of(store: Store, field: Field) -> Iterator[tuple[int, int, float, Value]]:
    """Yield id, cell, bounding dimension in m and a field's value for all objects."""
    value = f"(SELECT {VALUE} FROM json_each(attributes) WHERE key=?)"
    ask = (
        f"SELECT id, cell, dimension_m, {field.name if field.is_own else value} FROM object"
    )
    yield from store.connection.execute(ask, () if field.is_own else (field.name,))
