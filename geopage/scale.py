# SPDX-License-Identifier: Apache-2.0
"""From the values of a field to entries of a palette, and what these mean."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geopage.fields import Value, number_of
from geopage.palettes import MISSING, OTHER, Colour, category_colours, ramp, text_of
from geopage.style import DEFAULT_RAMP, OTHERS, Style
from tiles.errors import InputError
from tiles.frames import Floats, Ints

MISSING_ENTRY, OTHER_ENTRY, FIRST = 1, 2, 3
"""Entries of a palette; 0 is for objects without a style."""
STEPS = 256 - FIRST
MOST_VALUES = 1 << 16
"""Texts beyond so many different ones count as others."""
QUANTILES = (0.02, 0.98)
STOPS = 5
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Scale:
    """What n objects look like, and what that says."""

    palette: Bytes
    """(256, 3) sRGB"""
    entry: Bytes
    """(n,) of the palette"""
    legend: dict[str, Any]
    is_ramp: bool


class Values:
    """A field's values, object by object, as numbers and as categories."""

    def __init__(self) -> None:
        self.spelled: list[str] = []
        """each different value, as first met"""
        self._code: dict[float | str, int] = {}
        self._numbers: list[Floats] = []
        self._codes: list[Ints] = []

    def add(self, column: Iterable[Value]) -> None:
        """Append values; 3, 3.0 and "3" are one, and so are yes and Yes."""
        numbers, codes = [], []
        for value in column:
            number = number_of(value)
            numbers.append(np.nan if number is None else number)
            codes.append(-1 if value is None else self._code_of(value, number))
        self._numbers.append(np.array(numbers))
        self._codes.append(np.array(codes, np.int64))

    def _code_of(self, value: Value, number: float | None) -> int:
        key = str(value).casefold() if number is None else number
        if key not in self._code and len(self._code) < MOST_VALUES:
            self._code[key] = len(self._code)
            self.spelled.append(str(value) if number is None else f"{number:g}")
        return self._code.get(key, MOST_VALUES)

    def known(self, value: str) -> int | None:
        """Return the code of a value, None when no object has it."""
        number = number_of(value)
        return self._code.get(value.casefold() if number is None else number)

    @property
    def numbers(self) -> Floats:
        """(n,) NaN where a value is none, or no number."""
        return np.concatenate(self._numbers)

    @property
    def codes(self) -> Ints:
        """(n,) places in `spelled`; -1 where there is no value."""
        return np.concatenate(self._codes)


def scale_of(style: Style, field: str, values: Values) -> Scale:
    """Return the scale of a style for a field's values.

    Without a ramp or colours it is a ramp where all values are numbers, and more than
    there are colours.

    Raises
    ------
    InputError
        When a ramp is asked for and there is no number.
    """
    if style.colours:
        return _stated(style, field, values)
    number, code = values.numbers, values.codes
    is_numeric = bool((np.isfinite(number) == (code >= 0)).all())
    many = len(values.spelled) > len(category_colours())
    if style.ramp or (is_numeric and many):
        return _ramp(style, field, number)
    return _commonest(field, values)


def _ramp(style: Style, field: str, number: Floats) -> Scale:
    there = np.isfinite(number)
    if not there.any():
        advice = "name a field of numbers, or no ramp"
        raise InputError(repr(field), "holds no numbers for a ramp", advice)
    stated = style.limits
    low, high = stated or (float(q) for q in np.quantile(number[there], QUANTILES))
    span = high - low or 1.0
    step = np.clip(np.nan_to_num((number - low) / span), 0, 1) * (STEPS - 1)
    entry = np.where(there, FIRST + np.rint(step), MISSING_ENTRY).astype(np.uint8)
    name = style.ramp or DEFAULT_RAMP
    palette = _palette(ramp(name, STEPS))
    at = np.linspace(0, STEPS - 1, STOPS).round().astype(int)
    stops = [_row(low + span * k / (STEPS - 1), palette[FIRST + k]) for k in at.tolist()]
    legend = {
        "field": field,
        "ramp": name,
        "min": low,
        "max": high,
        "quantiles": None if stated else list(QUANTILES),
        "stops": stops,
        "missing": _row(None, palette[MISSING_ENTRY], int((~there).sum())),
    }
    return Scale(palette, entry, legend, is_ramp=True)


def _commonest(field: str, values: Values) -> Scale:
    """Give colours to the commonest values."""
    count = np.bincount(values.codes + 1, minlength=len(values.spelled) + 1)[1:]
    colours = category_colours()
    order = np.argsort(-count[: len(values.spelled)], kind="stable")[: len(colours)]
    chosen = [
        (values.spelled[k], colour) for k, colour in zip(order, colours, strict=False)
    ]
    return _categories(field, values, chosen, OTHER)


def _stated(style: Style, field: str, values: Values) -> Scale:
    other = dict(style.colours).get(OTHERS, OTHER)
    chosen = [(value, colour) for value, colour in style.colours if value != OTHERS]
    return _categories(field, values, chosen, other)


def _categories(
    field: str, values: Values, chosen: list[tuple[str, Colour]], other: Colour
) -> Scale:
    entry_of = np.full(MOST_VALUES + 2, OTHER_ENTRY, np.uint8)
    entry_of[0] = MISSING_ENTRY
    for k, (value, _) in enumerate(chosen):
        if (code := values.known(value)) is not None:
            entry_of[code + 1] = FIRST + k
    entry = entry_of[values.codes + 1]
    colours = np.array([colour for _, colour in chosen], np.uint8).reshape(-1, 3)
    palette = _palette(colours, other)
    count = np.bincount(entry, minlength=256).tolist()
    legend = {
        "field": field,
        "categories": [
            _row(value, palette[FIRST + k], count[FIRST + k])
            for k, (value, _) in enumerate(chosen)
        ],
        "other": _row(None, palette[OTHER_ENTRY], count[OTHER_ENTRY]),
        "missing": _row(None, palette[MISSING_ENTRY], count[MISSING_ENTRY]),
    }
    return Scale(palette, entry, legend, is_ramp=False)


def _palette(colours: Bytes, other: Colour = OTHER) -> Bytes:
    palette = np.zeros((256, 3), np.uint8)
    palette[MISSING_ENTRY], palette[OTHER_ENTRY] = MISSING, other
    palette[FIRST : FIRST + len(colours)] = colours
    return palette


def _row(
    value: float | str | None, colour: Bytes, count: int | None = None
) -> dict[str, Any]:
    """Return a line of a legend."""
    red, green, blue = (int(one) for one in colour)
    row: dict[str, Any] = {} if value is None else {"value": value}
    row["colour"] = text_of((red, green, blue))
    return row if count is None else row | {"count": count}


def legend_lines(legend: dict[str, Any]) -> list[str]:
    """Return a legend in words."""
    rows = legend.get("categories") or legend["stops"]
    lines = [f"{legend['field']}:"]
    for row in rows:
        value = row["value"]
        text = f"{value:.4g}" if isinstance(value, float) else value
        many = f"  ({row['count']})" if "count" in row else ""
        lines.append(f"  {row['colour']}  {text}{many}")
    if legend.get("quantiles"):
        low, high = (f"{100 * one:g} %" for one in legend["quantiles"])
        lines.append(f"  the ramp's ends are the {low} and the {high} quantile")
    rest = {key: legend[key] for key in ("other", "missing") if key in legend}
    return lines + [
        f"  {row['colour']}  {key}  ({row['count']})"
        for key, row in rest.items()
        if row["count"]
    ]
