# SPDX-License-Identifier: Apache-2.0
"""What the commands' arguments have in common."""

import argparse
import json
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from tiles import errors

MOST_INDENTED = 1_000_000


class Parser(errors.Parser):
    """A parser whose errors are one line, and which reads `--at -33.9,18.4,100`."""

    def __init__(self, prog: str, description: str, epilog: str = "") -> None:
        super().__init__(
            prog=f"geopage {prog}",
            description=description,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    def read(self, words: list[str]) -> argparse.Namespace:
        """Parse words; a value that begins with a minus sign is joined to its option."""
        joined: list[str] = []
        for word in words:
            number = word.startswith("-") and word[1:2].isdigit()
            if number and joined and joined[-1].startswith("--") and "=" not in joined[-1]:
                joined[-1] += f"={word}"
            else:
                joined.append(word)
        return self.parse_args(joined)


def numbers(
    count: int, names: str, limits: tuple[tuple[float, float], ...] = ()
) -> Callable[[str], tuple[float, ...]]:
    """Return a reader of `count` comma-separated finite numbers within limits."""

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count or not np.isfinite(values).all():
            raise argparse.ArgumentTypeError(f"expected {names}, got {text!r}")
        for value, (low, high) in zip(values, limits, strict=False):
            if not low <= value <= high:
                raise argparse.ArgumentTypeError(
                    f"{value:g} in {text!r} is not in {low}..{high}"
                )
        return values

    return read


LAT_LON = numbers(2, "LAT,LON", ((-90, 90), (-180, 360)))
LAT_LON_HEIGHT = numbers(3, "LAT,LON,HEIGHT", ((-90, 90), (-180, 360), (-1e4, 1e9)))
HEADING_PITCH = numbers(2, "HEADING,PITCH", ((-360, 360), (-90, 90)))


def size(text: str) -> tuple[int, int]:
    """Read WxH in pixels."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() for part in parts):
        raise argparse.ArgumentTypeError(f"expected WxH, got {text!r}")
    width, height = int(parts[0]), int(parts[1])
    if not (16 <= width <= 16384 and 16 <= height <= 16384):
        raise argparse.ArgumentTypeError(f"{text!r} is not in 16x16..16384x16384")
    return width, height


def pixel(text: str) -> tuple[int, int]:
    """Read X,Y, counted from the top left corner of a picture."""
    parts = text.split(",")
    if len(parts) != 2 or not all(part.strip().isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"expected X,Y, got {text!r}")
    return int(parts[0]), int(parts[1])


def positive(text: str) -> float:
    """Read a number above zero."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not (0 < value < float("inf")):
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text!r}")
    return value


def whole(text: str) -> int:
    """Read a whole number above zero."""
    if not text.isdigit() or not 0 < int(text) <= 1_000_000:
        raise argparse.ArgumentTypeError(f"expected a whole number above 0, got {text!r}")
    return int(text)


def print_json(value: Any) -> None:
    """Print one JSON object on stdout; numbers that JSON lacks become null."""
    plain = _plain(value)
    text = json.dumps(plain, allow_nan=False)
    # Indenting takes twenty times as long; nobody reads so much.
    if len(text) < MOST_INDENTED:
        text = json.dumps(plain, indent=2, allow_nan=False)
    sys.stdout.write(text + "\n")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value
