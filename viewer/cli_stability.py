# SPDX-License-Identifier: Apache-2.0
"""`geopage stability`: where methods fail, and how far we are from it."""

from pathlib import Path
from typing import Any

from geopage.arguments import Parser, print_json

STORE = Path("demo/world.geopage")


def stability(words: list[str]) -> int:
    """Measure every known way to fail; exit 1 where one of them does."""
    parser = Parser(
        "stability",
        "Run every known failure mode; print what fails, where it starts to fail, and how"
        " far geopage is from it. Writes stability.csv, STABILITY.md and index.html.",
        "Times play no part: paging runs by a virtual clock. Exit code 1: a row fails.",
    )
    parser.add_argument(
        "store", type=Path, nargs="?", default=STORE, help="default %(default)s"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--only", default="", metavar="WORD,WORD,...", help="rows whose names hold a word"
    )
    parser.add_argument("--quick", action="store_true", help="fewer cases of each row")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.read(words)
    from viewer.stability import run  # noqa: PLC0415  (opens GL)
    from viewer.stability.row import FAILS  # noqa: PLC0415

    rows = run.chosen([word for word in given.only.split(",") if word])
    found = run.stability(given.store, given.out, rows, quick=given.quick)
    if given.json:
        print_json(found)
    else:
        for row in found["rows"]:
            print(summary(row))
        print(f"open {given.out / 'index.html'}")
    return int(any(row["verdict"] == FAILS for row in found["rows"]))


def summary(row: dict[str, Any]) -> str:
    """Say in one line what was found for a row."""
    far = f"from {row['breaks_at']:.4g} on" if row["breaks_at"] else "never as far as tried"
    times = f" ({row['margin']:.3g} x)" if row["margin"] else ""
    theirs = "" if row["others"] is None else f", theirs {row['others']:.3g}"
    return (
        f"{row['verdict']:5}  {row['name']}: {row['measure']}: {row['ours']:.3g}"
        f" (allowed {row['allowed']:g}{theirs}); {row['stress']}: worst practical"
        f" {row['practical']:.4g}, fails {far}{times}"
    )
