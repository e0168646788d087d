# SPDX-License-Identifier: Apache-2.0
"""`geopage replay`: the paging of a flight, without drawing, by a virtual clock."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from geopage.arguments import Parser, numbers, positive, print_json, size
from geopage.settings import MIB, REPLAYED, PagerSettings, Throttle
from tiles.errors import InputError
from tiles.store import Store
from tiles.surface import Surface
from viewer.paging import page_flight
from viewer.poses import Flight
from viewer.progress import bar
from viewer.recorded import read_flight

THROTTLE = numbers(2, "MIB_PER_S,LATENCY_MS", ((1e-6, 1e6), (0, 1e6)))
Row = dict[str, Any]
COLUMNS = (
    ("policy", "policy", "{}"),
    ("MiB/s", "mib_per_s", "{:.2f}"),
    ("within", "share_frames_within", "{:.1%}"),
    ("complete", "share_frames_complete", "{:.1%}"),
    ("p95 px", "error_p95_px", "{:.2f}"),
    ("MB", "megabytes", "{:.1f}"),
    ("tiles", "tiles_loaded", "{}"),
    ("late", "tiles_late", "{}"),
    ("unused", "tiles_unused", "{}"),
    ("cancelled", "tiles_cancelled", "{}"),
)


def replay(words: list[str]) -> int:
    """Page a flight under one or more policies."""
    parser = Parser(
        "replay",
        "Page a camera path without drawing it, by a virtual clock: two runs give the same"
        " figures on any machine.",
        "within: share of frames whose 95th percentile of the terrain's screen error, by"
        " area, is at most the threshold; rays meet the ellipsoid at the ground's height"
        " under the eye, a tile with nothing finer counts as 0. complete: and no object"
        " tile is missing. late: uploaded after something stood in for it. The first view"
        " is there before the clock starts, and is not counted.",
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("path", type=Path, metavar="PATH.json|FRAMES.csv")
    parser.add_argument(
        "--policy",
        type=policies,
        default=("benefit",),
        metavar="NAME[,NAME..]",
        help=f"of {', '.join(REPLAYED)}; or all",
    )
    slow = parser.add_mutually_exclusive_group()
    slow.add_argument("--throttle", type=THROTTLE, metavar="MIB_PER_S,LATENCY_MS")
    slow.add_argument(
        "--times",
        type=shares,
        metavar="X[,X..]",
        help="throttled to so many times the bytes a second that benefit reads unthrottled",
    )
    parser.add_argument("--size", type=size, default=(1280, 720), metavar="WxH")
    parser.add_argument("--threshold", type=positive, default=2.0, metavar="PX")
    parser.add_argument("--object-threshold", type=positive, metavar="PX")
    parser.add_argument("--budget", type=positive, default=512.0, metavar="MIB")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.read(words)
    rows = run(given)
    if given.json:
        print_json({"path": given.path.stem, "runs": rows})
    else:
        print("\n".join(table(rows)))
    return 0


def policies(text: str) -> tuple[str, ...]:
    """Read names of policies."""
    names = REPLAYED if text == "all" else tuple(text.split(","))
    for name in names:
        if name not in REPLAYED:
            expected = ", ".join(REPLAYED)
            raise argparse.ArgumentTypeError(f"{name!r} is not one of {expected}")
    return names


def shares(text: str) -> tuple[float, ...]:
    """Read factors above 0."""
    return tuple(positive(part) for part in text.split(","))


def run(given: argparse.Namespace) -> list[Row]:
    """Page the flight for each policy and each throttle."""
    path = read_flight(given.path)
    with Store(given.store) as store:
        surface = Surface(store)
        if not len(surface.forest.records):
            advice = "run `geopage ingest terrain` first"
            raise InputError(given.store, "holds no terrain", advice)
        flight = Flight(path, surface, given.size)
    limits = given.threshold, given.object_threshold
    plain = PagerSettings(*limits, int(given.budget * MIB), fade_s=0.0)
    lines: list[Throttle | None] = [Throttle(*given.throttle) if given.throttle else None]
    if given.times:
        needed = one(given.store, flight, plain)["bytes_read"] / path.duration_s / MIB
        lines = [Throttle(needed * times) for times in given.times]
    return [
        one(given.store, flight, replace(plain, policy=policy, throttle=line))
        for line in lines
        for policy in given.policy
    ]


def one(store: Path, flight: Flight, settings: PagerSettings) -> Row:
    """Page the flight once."""
    with bar(f"paging by {settings.policy}", flight.path.duration_s, "s") as show:
        return page_flight(store, flight, settings, show)


def table(rows: list[Row]) -> list[str]:
    """Return the runs as lines of text."""
    lines = [[title for title, _, _ in COLUMNS]]
    for row in rows:
        line = row["throttle"]
        shown = {**row, "megabytes": row["bytes_carried"] / 1e6}
        shown["mib_per_s"] = line[0] if line else float("inf")
        lines.append([form.format(shown[key]) for _, key, form in COLUMNS])
    widths = [max(len(line[i]) for line in lines) for i in range(len(COLUMNS))]
    return [
        "  ".join(w.rjust(n) for w, n in zip(line, widths, strict=True)) for line in lines
    ]
