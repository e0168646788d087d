# SPDX-License-Identifier: Apache-2.0
"""How high a building is: from an attribute, from its levels, or a stated default."""

import math
import re
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles.errors import InputError
from tiles.frames import Floats

Columns = Mapping[str, NDArray[Any]]
LEVEL_M = 3.0
FOOT_M = 0.3048
MAX_HEIGHT_M = 1000.0
MAX_LEVELS = 300.0
HEIGHT_NAMES = (
    "height", "render_height", "building:height", "building_height", "est_height",
    "measuredheight", "measured_height", "height_m", "hoehe", "hauteur", "altura",
    "bldg_height", "building_h", "hgt_median", "hgt_median_m", "gebaeudehoehe",
)  # fmt: skip
LEVEL_NAMES = (
    "building:levels", "building_levels", "levels", "num_floors", "floors", "storeys",
    "stories", "storeysaboveground", "numfloors", "nb_etages",
    "numberoffloorsaboveground", "nombre_d_etages", "building_l", "building:l",
)  # fmt: skip
BASE_NAMES = ("min_height", "render_min_height", "building:min_height", "base_height")
BASE_LEVEL_NAMES = ("building:min_level", "min_level", "min_floor")
USUAL_NAMES = frozenset((*HEIGHT_NAMES, *LEVEL_NAMES, *BASE_NAMES, *BASE_LEVEL_NAMES))
_NUMBER = r"([-+]?\d+(?:[.,]\d+)?)"
_VALUE = re.compile(
    rf"^\s*(?:~|≈|ca?\.?|about)?\s*{_NUMBER}\s*(m|met(?:er|re)s?|mt|ft|feet|foot|')?\.?\s*"
    r"(?:(\d+(?:\.\d+)?)\s*(?:\"|''|in))?\s*$",
    re.IGNORECASE,
)


HOW = (
    "from_attribute",
    "from_levels",
    "default",
    "unreadable_value",
    "raised",
    "base_ignored",
)
"""What the bits of `Heights.how` say, from the lowest; one of the first three is set."""


@dataclass(frozen=True, slots=True)
class HeightRules:
    """Which attributes say the height; None means: look under the usual names."""

    height: str | None = None
    levels: str | None = None
    base: str | None = None
    default_height_m: float = 6.0
    units: str = "m"


@dataclass(frozen=True, slots=True)
class Heights:
    """Height of every feature above the lowest ground under it."""

    top_m: Floats
    """(n,) height of the roof, m"""
    foot_m: Floats
    """(n,) height where the walls begin, m; 0 for nearly all"""
    how: NDArray[np.uint8]
    """(n,) bits of HOW: where the height comes from, what was passed over"""
    used: dict[str, Any] = field(default_factory=dict)
    """the fields that were looked at, the default, the units"""


def heights_of(
    path: str | Path, columns: Columns, count: int, rules: HeightRules
) -> Heights:
    """Find the height of each of `count` features.

    In this order: a height attribute, levels x 3 m, the default. A value that is no
    height (words, zero, negative, above 1,000 m) is passed over and counted.

    Raises
    ------
    InputError
        When a field that the user named is not there.
    """
    unit_m = FOOT_M if rules.units == "ft" else 1.0
    by_height = _fields(path, columns, rules.height, HEIGHT_NAMES, "--height")
    by_levels = _fields(path, columns, rules.levels, LEVEL_NAMES, "--levels")
    bases = _fields(path, columns, rules.base, BASE_NAMES, "--base")
    low_levels = [] if rules.base else _fields(path, columns, None, BASE_LEVEL_NAMES, "")

    tall, odd = _first_good(columns, by_height, count, (unit_m, MAX_HEIGHT_M))
    levels, odd_levels = _first_good(columns, by_levels, count, (1.0, MAX_LEVELS))
    top_m = np.where(np.isnan(tall), levels * LEVEL_M, tall)
    defaulted = np.isnan(top_m)
    top_m[defaulted] = rules.default_height_m
    foot_m, _ = _first_good(columns, bases, count, (unit_m, MAX_HEIGHT_M))
    low, _ = _first_good(columns, low_levels, count, (1.0, MAX_LEVELS))
    foot_m = np.nan_to_num(np.where(np.isnan(foot_m), low * LEVEL_M, foot_m))
    too_high = foot_m >= top_m
    foot_m[too_high] = 0.0
    by_attribute = ~np.isnan(tall)
    facts = (
        by_attribute,
        ~by_attribute & ~defaulted,
        defaulted,
        odd | odd_levels,
        foot_m > 0,
        too_high,
    )
    how = np.packbits(np.array(facts), axis=0, bitorder="little")[0]
    used = {
        "height_fields": by_height,
        "level_fields": by_levels,
        "base_fields": [*bases, *low_levels],
        "default_height_m": rules.default_height_m,
        "units": rules.units,
    }
    return Heights(top_m, foot_m, how, used)


def count_how(how: NDArray[np.uint8]) -> dict[str, int]:
    """Count the bits of `Heights.how`."""
    return {name: int(((how >> bit) & 1).sum()) for bit, name in enumerate(HOW)}


def _fields(
    path: str | Path, columns: Columns, named: str | None, usual: Sequence[str], option: str
) -> list[str]:
    """Return the fields to look at, best first."""
    if named is not None:
        if named not in columns:
            known = ", ".join(list(columns)[:20]) or "none"
            reason = f"no field named {named} (for {option})"
            raise InputError(path, reason, f"the fields are: {known}")
        return [named]
    by_name = {name.lower(): name for name in reversed(list(columns))}
    return [by_name[name] for name in usual if name in by_name]


def _first_good(
    columns: Columns, fields: Sequence[str], count: int, unit_and_most: tuple[float, float]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return each feature's first value in (0, most], and where all were passed over."""
    unit_m, most = unit_and_most
    value = np.full(count, np.nan)
    odd = np.zeros(count, bool)
    for name in fields:
        numbers, given = numbers_of(columns[name], unit_m)
        good = (numbers > 0) & (numbers <= most)
        value = np.where(np.isnan(value) & good, numbers, value)
        odd |= given & ~good
    return value, odd & np.isnan(value)


def numbers_of(values: NDArray[Any], unit_m: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Return values as metres (NaN where there is none) and where anything was given."""
    if values.dtype.kind in "iuf":
        numbers = values.astype(np.float64) * unit_m
        return numbers, ~np.isnan(numbers)
    # A list can't be looked up, and True is not to be found as 1.
    keys = [(type(v), v if isinstance(v, Hashable) else str(v)) for v in values.tolist()]
    known = {key: _parsed(key[1], unit_m) for key in set(keys)}
    numbers = np.array([known[key] for key in keys], np.float64)
    given = np.array([_is_given(value) for _, value in keys], bool)
    return numbers, given


def _is_given(value: object) -> bool:
    empty = isinstance(value, float) and math.isnan(value)
    return not (value is None or value == "" or empty)


def _parsed(value: object, unit_m: float) -> float:
    """Return metres of "12", "12 m", "12,5", "~10", "40 ft" or 5'6"; NaN for the rest."""
    if isinstance(value, bool) or value is None:
        return np.nan
    if isinstance(value, int | float):
        return float(value) * unit_m
    match = _VALUE.match(str(value))
    if match is None:
        return np.nan
    number, unit, inches = match.groups()
    if unit is not None:
        unit_m = FOOT_M if unit.lower() in {"ft", "feet", "foot", "'"} else 1.0
    return float(number.replace(",", ".")) * unit_m + float(inches or 0) * FOOT_M / 12
