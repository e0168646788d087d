# SPDX-License-Identifier: Apache-2.0
"""`geopage accuracy`: how far pictures are from their sources."""

from pathlib import Path

from geopage.arguments import Parser, positive, print_json, size, whole
from geopage.settings import MIB
from viewer.cli_bench import thresholds


def accuracy(words: list[str]) -> int:
    """Measure how far random views are from the sources."""
    parser = parser_of_accuracy()
    given = parser.read(words)
    if given.seed < 0:
        parser.error("--seed is below 0")
    from viewer.accuracy import Asked  # noqa: PLC0415  (opens GL)
    from viewer.accuracy import accuracy as measure  # noqa: PLC0415
    from viewer.accuracy_words import summary  # noqa: PLC0415

    asked = Asked(
        tuple(sorted(set(given.threshold))),
        given.views,
        given.seed,
        given.size,
        int(given.budget * MIB),
        given.all,
    )
    found = measure(given.store, asked, given.out)
    if given.json:
        print_json(found)
    else:
        print(summary(found))
        if given.out:
            print(f"open {given.out / 'ACCURACY.md'}")
    return 0


def parser_of_accuracy() -> Parser:
    """Return what reads the words of `accuracy`."""
    parser = Parser(
        "accuracy",
        "Measure the geometric pixel error of random settled views: the shortest distances"
        " between what is drawn and the sources' own posts, both ways, in pixels.",
        "Views are 10 m to 10,000 km above ground, straight down to the horizon, over the"
        " globe and over every source. Buildings are left out.",
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("--views", type=whole, default=20, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="S")
    parser.add_argument(
        "--threshold",
        type=thresholds,
        default=(2.0,),
        metavar="PX,PX,...",
        help="largest screen errors, the same views at each",
    )
    parser.add_argument("--size", type=size, default=(320, 240), metavar="WxH")
    parser.add_argument("--budget", type=positive, default=512.0, metavar="MIB")
    parser.add_argument(
        "--all",
        action="store_true",
        help="also heights at 10,000 places of every source, the triangles of flights over"
        " the poles and along the antimeridian, and the time that a selection takes",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="write ACCURACY.md, its chart, accuracy.json and views.csv there",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    return parser
