# SPDX-License-Identifier: Apache-2.0
"""What the commands of the viewer have in common: options, and what becomes of them."""

import argparse
import sys
from collections.abc import Callable
from typing import Any

from geopage.arguments import Parser, numbers, positive, print_json, size
from geopage.palettes import RAMPS
from geopage.scale import legend_lines
from geopage.settings import (
    DETAILS,
    FADE_S,
    LONGEST_FADE_S,
    MIB,
    POLICIES,
    PagerSettings,
    Throttle,
)
from geopage.style import parse_style
from viewer.session import Picture

THROTTLE = numbers(2, "MIB_PER_S,LATENCY_MS", ((1e-6, 1e6), (0, 1e6)))


def seeing(parser: Parser) -> None:
    """Add how large a picture is, how fine, and from how much memory."""
    parser.add_argument(
        "--size", type=size, default=(1280, 720), metavar="WxH", help="of the picture, px"
    )
    parser.add_argument(
        "--threshold", type=positive, default=2.0, metavar="PX", help="largest screen error"
    )
    parser.add_argument(
        "--object-threshold",
        type=positive,
        metavar="PX",
        help="least projected size of an object",
    )
    parser.add_argument(
        "--budget",
        type=positive,
        default=512.0,
        metavar="MIB",
        help="for tiles and indexes",
    )


def drawing(parser: Parser) -> None:
    """Add what all commands have that draw and report."""
    seeing(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")


def height_reference(parser: Parser) -> None:
    """Add what the height of --at is above."""
    parser.add_argument(
        "--height-reference",
        choices=("ground", "ellipsoid"),
        default="ground",
        help="of --at",
    )


def paging(parser: Parser, policy_help: str = "what is read next") -> None:
    """Add how a moving picture is paged."""
    parser.add_argument("--policy", choices=POLICIES, default="benefit", help=policy_help)
    parser.add_argument(
        "--fade",
        type=fade,
        default=FADE_S,
        metavar="SECONDS",
        help="time in which objects turn into others (0: swap; default %(default)s)",
    )


def styling(parser: Parser) -> None:
    """Add what the commands have that draw buildings in colours."""
    parser.add_argument(
        "--style",
        type=parse_style,
        metavar="FIELD[:RAMP]",
        help=f"colours of buildings: FIELD, FIELD:RAMP (of {', '.join(RAMPS)}),"
        " FIELD:RAMP:MIN,MAX, FIELD=VALUE:#rrggbb,*:#rrggbb, or a .json file",
    )


def print_legend(report: dict[str, Any]) -> None:
    """Say which colour is which, on stderr."""
    if "style" in report:
        print("\n".join(legend_lines(report["style"])), file=sys.stderr)


def print_report(
    report: dict[str, Any],
    given: argparse.Namespace,
    summary: Callable[[dict[str, Any]], str],
) -> None:
    """Print a report: as JSON where that was asked for, or else in words."""
    if given.json:
        print_json(report)
    else:
        print_legend(report)
        print(summary(report))


def settings_of(given: argparse.Namespace) -> PagerSettings:
    """Return the pager's settings."""
    throttle = Throttle(*given.throttle) if getattr(given, "throttle", None) else None
    policy = getattr(given, "policy", "benefit")
    fade_s = getattr(given, "fade", 0.0)  # what is settled has no fades
    budget = int(given.budget * MIB)
    detail = getattr(given, "detail", DETAILS[0])
    limits = given.threshold, given.object_threshold
    return PagerSettings(*limits, budget, throttle, policy, fade_s, detail)


def fade(text: str) -> float:
    """Read the duration of a fade, s."""
    return numbers(1, "SECONDS", ((0, LONGEST_FADE_S),))(text)[0]


def picture_of(given: argparse.Namespace) -> Picture:
    """Return the picture's size."""
    return Picture(given.size)
