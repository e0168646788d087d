# SPDX-License-Identifier: Apache-2.0
"""`geopage experiments`: the experiments of five papers, their figures beside ours."""

import argparse
from pathlib import Path

from geopage.arguments import Parser, print_json

KEYS = ("E1", "E2", "E3", "E4", "E5", "E6")


def experiments(words: list[str]) -> int:
    """Run the experiments of the literature again."""
    given = parser_of_experiments().read(words)
    from viewer.experiments.report import counted  # noqa: PLC0415  (opens GL)
    from viewer.experiments.run import run_all  # noqa: PLC0415
    from viewer.experiments.setting import Setting  # noqa: PLC0415

    parts = run_all(Setting(given.out, given.quick, given.store), given.only)
    if given.json:
        rows = {part.key: [as_json(row) for row in part.found.rows] for part in parts}
        print_json(rows)
        return 0
    for part in parts:
        print(f"{part.key}, {part.title}")
        for text in (*part.found.says, counted(part.found.rows)):
            print(f"  {text}")
    print(f"open {given.out / 'index.html'}")
    return 0


def parser_of_experiments() -> Parser:
    """Return what reads the words of `experiments`."""
    parser = Parser(
        "experiments",
        "Run the experiments of five papers again, on generated data of the same shape and"
        " on the sample world; write experiments.csv, EXPERIMENTS.md, charts and"
        " index.html, with the papers' figures beside ours.",
        "E1 virtual memory or prediction (Funkhouser 1996)\n"
        "E2 culling and detail (Funkhouser and others 1992, MMR 1999)\n"
        "E3 complement search (REVIEW 2001)\n"
        "E4 cache size (MMR 1999)\n"
        "E5 fly-in with and without the hierarchy (VGIS 1999)\n"
        "E6 its stall behind slow servers (VGIS 1999)\n\n"
        "What is counted is the same in every run; times are marked.",
    )
    parser.add_argument(
        "store",
        type=Path,
        nargs="?",
        help="the sample world, as `geopage demo` makes it; by default made in DIR",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--only", type=some_keys, default=KEYS, metavar="E1,E3,...")
    parser.add_argument("--quick", action="store_true", help="shorter paths: minutes")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    return parser


def as_json(row: object) -> dict[str, object]:
    """Return a row with its names."""
    names = [name for name in dir(row) if not name.startswith("_")]
    return {name: getattr(row, name) for name in names}


def some_keys(text: str) -> tuple[str, ...]:
    """Read names of experiments; they run in the order of the papers."""
    asked = {part.strip().upper() for part in text.split(",")}
    if not asked <= {*KEYS}:
        wrong = ", ".join(sorted(asked - {*KEYS}))
        reason = f"expected some of {','.join(KEYS)}, got {wrong}"
        raise argparse.ArgumentTypeError(reason)
    return tuple(key for key in KEYS if key in asked)
