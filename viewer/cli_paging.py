# SPDX-License-Identifier: Apache-2.0
"""`geopage paging`: the numbers of paging, each beside its limit."""

from pathlib import Path

from geopage.arguments import Parser, positive, print_json, size, whole
from geopage.settings import MIB, REPLAYED, PagerSettings
from viewer.cli_replay import policies, shares
from viewer.paging_numbers.limits import MISSED, Line, in_words, read_lines
from viewer.paging_numbers.routes import RATE_HZ, SAMPLE, TIMES, read_routes

STORE = "demo/world.geopage"


def paging(words: list[str]) -> int:
    """Measure paging; exit 1 where a limit is missed."""
    given = parser_of_paging().read(words)
    routes = read_routes(given.routes)
    from viewer.paging_numbers.run import Asked, measure  # noqa: PLC0415  (opens GL)

    asked = Asked(
        routes,
        given.policy,
        given.times,
        PagerSettings(given.threshold, budget_bytes=int(given.budget * MIB)),
        given.size,
        1 / given.rate,
        given.out,
        given.pairs,
        given.profile,
        [one for path in given.also for one in read_lines(path)],
    )
    found = measure(asked)
    numbers = found["numbers"]
    if given.json:
        print_json(found)
    else:
        print("\n".join(in_words(Line(**one)) for one in numbers))
        print(f"open {given.out / 'PAGING.md'}")
    return int(any(one["verdict"] == MISSED for one in numbers))


def parser_of_paging() -> Parser:
    """Return what reads the words of `paging`."""
    parser = Parser(
        "paging",
        "Replay camera paths under every policy over lines of several speeds; print each"
        " number of paging beside its limit. Writes PAGING.md, paging.json and"
        " pictures/policies.svg.",
        "Replays run by a virtual clock: the same figures on any machine. Only --pairs and"
        " --profile measure times; they fly the first path. Exit code 1: a limit is"
        " missed.",
    )
    parser.add_argument(
        "routes",
        nargs="*",
        default=[STORE],
        metavar="STORE[=PATH[,PATH..]]",
        help="stores and camera paths over them: files, or names of those among the"
        f" samples; without paths: {', '.join(SAMPLE)} (default: {STORE})",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--policy",
        type=policies,
        default=REPLAYED,
        metavar="NAME[,NAME..]",
        help=f"of {', '.join(REPLAYED)} (default: all)",
    )
    parser.add_argument(
        "--times",
        type=shares,
        default=TIMES,
        metavar="X[,X..]",
        help="lines, in bytes a second that the flight needs (default 0.25,0.5,1,2);"
        " besides these one that takes no time",
    )
    parser.add_argument(
        "--rate",
        type=positive,
        default=RATE_HZ,
        metavar="HZ",
        help="frames a second of replays (default 20)",
    )
    parser.add_argument(
        "--pairs", type=whole, default=0, metavar="N", help="paced flights and floors"
    )
    parser.add_argument(
        "--profile", type=float, metavar="T_S", help="where the frame at T_S goes"
    )
    parser.add_argument(
        "--also",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE.json",
        help="numbers that the benchmarks of a huge city and of a million objects wrote",
    )
    parser.add_argument("--size", type=size, default=(1280, 720), metavar="WxH")
    parser.add_argument("--threshold", type=positive, default=2.0, metavar="PX")
    parser.add_argument("--budget", type=positive, default=512.0, metavar="MIB")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    return parser
