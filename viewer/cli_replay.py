# SPDX-License-Identifier: Apache-2.0
"""`geopage replay`: the paging of a flight, without drawing, by a virtual clock."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from geopage.arguments import Parser, positive, print_json
from geopage.policies.described import described
from geopage.progress import bar
from geopage.settings import MIB, REPLAYED, PagerSettings, Throttle
from tiles.errors import InputError
from tiles.store import Store
from tiles.surface import Surface
from viewer.cli_options import THROTTLE, drawing
from viewer.paging import ideal_bytes, needed_mib_per_s, page_flight
from viewer.paging_chart import OURS, paging_chart
from viewer.poses import Flight
from viewer.recorded import read_flight

Row = dict[str, Any]
COLUMNS = (
    ("policy", "policy", "{}"),
    ("MiB/s", "mib_per_s", "{:.3g}"),
    ("within", "share_frames_within", "{:.1%}"),
    ("complete", "share_frames_complete", "{:.1%}"),
    ("p95 px", "error_p95_px", "{:.2f}"),
    ("MB", "megabytes", "{:.1f}"),
    ("tiles", "tiles_loaded", "{}"),
    ("x ideal", "bytes_over_ideal", "{:.2f}"),
    ("late", "tiles_late", "{}"),
    ("p95 ms", "late_p95_ms", "{:.0f}"),
    ("hit", "prediction_hit_share", "{:.0%}"),
    ("undrawn", "never_drawn_share", "{:.1%}"),
)


def replay(words: list[str]) -> int:
    """Page a flight under one or more policies."""
    given = parser_of_replay().read(words)
    if given.chart and not given.times:
        raise InputError("--chart", "needs several line speeds", "add --times 0.25,0.5,1,2")
    rows = run(given)
    if given.chart:
        paging_chart({f"{given.path.stem} over {given.store.stem}": rows}, given.chart)
    if given.json:
        print_json({"path": given.path.stem, "runs": rows})
    else:
        print("\n".join([*table(rows), *leads(rows)]))
    return 0


def parser_of_replay() -> Parser:
    """Return what reads the words of `replay`."""
    parser = Parser(
        "replay",
        "Page a camera path without drawing it, by a virtual clock: two runs give the same"
        " figures on any machine.",
        "within: share of frames whose 95th percentile of the terrain's screen error, by"
        " area, is at most the threshold; rays meet the ellipsoid at the ground's height"
        " under the eye, a tile with nothing finer counts as 0. complete: and no object"
        " tile is missing. x ideal: bytes read, by those of the distinct tiles that the"
        " views draw when all is there. late: tiles uploaded after something coarser was"
        " drawn in their place, and after how long. hit: share of tiles read before a view"
        " missed them that were drawn; undrawn: share of all tiles read that never were."
        " The first view is there before the clock starts, and is not counted.\n\n"
        f"policies:\n{described(REPLAYED)}",
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
        help="throttled to so many times the bytes a second that the flight's views need:"
        " those of the distinct tiles that they draw, over the time that it takes",
    )
    drawing(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="what became of each tile")
    parser.add_argument(
        "--chart", type=Path, metavar="OUT.svg", help="good frames over line speed"
    )
    return parser


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
    ideal = ideal_bytes(given.store, flight, plain)
    only = Throttle(*given.throttle) if given.throttle else None
    lines: list[tuple[float | None, Throttle | None]] = [(None, only)]
    if given.times:
        needed = needed_mib_per_s(ideal, path.duration_s)
        lines = [(times, Throttle(needed * times)) for times in given.times]
    rows = []
    for times, line in lines:
        for policy in given.policy:
            settings = replace(plain, policy=policy, throttle=line)
            out = folder_of(given, settings) if given.out else None
            row = one(given.store, flight, settings, out)
            row |= {"ideal_bytes": ideal, "times": times}
            if ideal:
                row |= {"bytes_over_ideal": row["bytes_read"] / ideal}
            rows.append(row)
    return rows


def folder_of(given: argparse.Namespace, settings: PagerSettings) -> Path:
    """Return where one run's trace goes."""
    out: Path = given.out
    if len(given.policy) == 1 and len(given.times or (1,)) == 1:
        return out
    line = settings.throttle
    return out / (f"{settings.policy}_{line.mib_per_s:.3g}" if line else settings.policy)


def one(store: Path, flight: Flight, settings: PagerSettings, out: Path | None) -> Row:
    """Page the flight once."""
    with bar(f"paging by {settings.policy}", flight.path.duration_s, "s") as show:
        return page_flight(store, flight, settings, show, out)


def leads(rows: list[Row]) -> list[str]:
    """Say, for each line, how far ahead of the others our own policy is."""
    lines = []
    for line in dict.fromkeys(tuple(row["throttle"] or ()) for row in rows):
        share = {
            row["policy"]: 100 * row["share_frames_within"]
            for row in rows
            if tuple(row["throttle"] or ()) == line
        }
        if OURS not in share or len(share) == 1:
            continue
        parts = [
            f"{share[OURS] - percent:+.1f} points to {name}"
            for name, percent in share.items()
            if name != OURS
        ]
        rate = f"at {line[0]:.3g} MiB/s " if line else ""
        lines.append(f"{rate}{OURS} has {share[OURS]:.1f} % within: {', '.join(parts)}")
    return lines


def table(rows: list[Row]) -> list[str]:
    """Return the runs as lines of text."""
    lines = [[title for title, _, _ in COLUMNS]]
    for row in rows:
        line = row["throttle"]
        shown = {**row, **row["prediction"], "megabytes": row["bytes_carried"] / 1e6}
        if line:
            shown["mib_per_s"] = line[0]
        lines.append(
            [form.format(shown[key]) if key in shown else "-" for _, key, form in COLUMNS]
        )
    widths = [max(len(line[i]) for line in lines) for i in range(len(COLUMNS))]
    return [
        "  ".join(w.rjust(n) for w, n in zip(line, widths, strict=True)) for line in lines
    ]
