# SPDX-License-Identifier: Apache-2.0
"""`geopage film`: a camera path as a film."""

import argparse
from pathlib import Path
from typing import Any

from geopage.arguments import Parser, positive
from viewer.cli_options import drawing, print_report, settings_of, styling

MOST_HZ = 240.0


def film(words: list[str]) -> int:
    """Make a film of a camera path."""
    parser = Parser(
        "film",
        "Make a film of a camera path; every frame waits until all that it wants is there.",
        "Stopped by Ctrl-C or worse, the same command goes on where it was;"
        "\nwhat is finished lies in OUT.mp4.parts until the film is done.",
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("path", type=Path, metavar="PATH.json")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT.mp4")
    parser.add_argument(
        "--fps", type=rate, default=30.0, metavar="N", help="frames per second of the film"
    )
    drawing(parser)
    styling(parser)
    parser.set_defaults(threshold=1.0)
    given = parser.read(words)
    from viewer.film_path import FilmPlan, film_path  # noqa: PLC0415  (opens GL)
    from viewer.still import finer  # noqa: PLC0415

    plan = FilmPlan(given.path, given.out, given.fps, given.style)
    report = film_path(given.store, settings_of(given), finer(given.size), plan)
    print_report(report, given, summary)
    return 0


def rate(text: str) -> float:
    """Read frames per second."""
    value = positive(text)
    if value > MOST_HZ:
        raise argparse.ArgumentTypeError(f"{text!r} is not in 0..{MOST_HZ:g}")
    return value


def summary(report: dict[str, Any]) -> str:
    """Say in a line or two what was made."""
    lines = [
        f"{report['out']}: {report['frames']} frames at {report['fps']:g} per second,"
        f" {report['frames_from_before']} of them made before"
    ]
    if short := report["frames_short_of_memory"]:
        lines.append(f"{short} frames are coarser than asked for: give more --budget")
    lines += [f"fault: {fault}" for fault in report["faults"]]
    return "\n".join(lines)
