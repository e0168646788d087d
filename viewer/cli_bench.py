# SPDX-License-Identifier: Apache-2.0
"""`geopage bench`: what a picture is worth per millisecond."""

import argparse
from pathlib import Path
from typing import Any

from geopage.arguments import Parser, positive, print_json, size, whole
from geopage.settings import MIB


def bench(words: list[str]) -> int:
    """Measure speed against accuracy over methods and thresholds."""
    given = parser_of_bench().read(words)
    from viewer.bench import Bench  # noqa: PLC0415  (opens GL)
    from viewer.bench import bench as measure  # noqa: PLC0415

    budget_bytes = int(given.budget * MIB)
    chosen = given.thresholds, given.quick, given.size, budget_bytes, given.frames
    found = measure(given.store, Bench(given.path, given.out, *chosen))
    if given.json:
        print_json(found)
    else:
        print(summary(found["rows"]))
        print(f"open {given.out / 'index.html'}")
    return 0


def parser_of_bench() -> Parser:
    """Return what reads the words of `bench`."""
    parser = Parser(
        "bench",
        "Fly a camera path with several methods over a sweep of thresholds; write"
        " results.csv, chart.svg, chart.png and index.html.",
        "Settled rows are the same in every run, times aside; paced ones run in real time.",
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("--path", type=Path, required=True, metavar="PATH.json")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--thresholds",
        type=thresholds,
        default=(),
        metavar="PX,PX,...",
        help="default 0.5,1,2,4,8,16,32; with --quick 1,4,16",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="fewer thresholds and key frames, and flights of 4 s: minutes",
    )
    parser.add_argument(
        "--frames", type=whole, metavar="N", help="key frames, default 12; quick 6"
    )
    parser.add_argument(
        "--size", type=size, metavar="WxH", help="default 1280x720; with --quick 640x360"
    )
    parser.add_argument("--budget", type=positive, default=512.0, metavar="MIB")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    return parser


def thresholds(text: str) -> tuple[float, ...]:
    """Read thresholds, px."""
    try:
        return tuple(positive(part) for part in text.split(","))
    except argparse.ArgumentTypeError as error:
        reason = f"expected numbers above 0, got {text!r}"
        raise argparse.ArgumentTypeError(reason) from error


def summary(rows: list[dict[str, Any]]) -> str:
    """Say what each method came to, a line a row."""
    lines = []
    for row in rows:
        error = f"error p95 {row['error_p95_px']:.2f} px, " if "error_p95_px" in row else ""
        lines.append(
            f"{row['method']}, {row['mode']}, {row['threshold_px']:g} px:"
            f" frame p50 {row['frame_p50_ms']:.1f} ms, p99 {row['frame_p99_ms']:.1f};"
            f" {error}FLIP {row['flip_mean']:.4f}, PSNR {row['psnr_db']:.1f} dB,"
            f" popping {row['popping_mean']:.5f}"
        )
    return "\n".join(lines)
