# SPDX-License-Identifier: Apache-2.0
"""`geopage render`, `fly`, `chart` and `demo`."""

import argparse
from dataclasses import replace
from pathlib import Path

from geopage.arguments import (
    HEADING_PITCH,
    LAT_LON_HEIGHT,
    Parser,
    pixel,
    positive,
    print_json,
    whole,
)
from geopage.policies.described import described
from geopage.settings import DETAILS, POLICIES
from viewer.cli_options import (
    THROTTLE,
    drawing,
    height_reference,
    paging,
    picture_of,
    print_legend,
    print_report,
    settings_of,
    styling,
)


def render(words: list[str]) -> int:
    """Make one settled picture."""
    parser = Parser(
        "render", "Make one picture, with everything that its view wants loaded."
    )
    parser.add_argument("store", type=Path)
    parser.add_argument(
        "--at", type=LAT_LON_HEIGHT, required=True, metavar="LAT,LON,HEIGHT"
    )
    parser.add_argument(
        "--look", type=HEADING_PITCH, default=(0.0, -30.0), metavar="HEADING,PITCH"
    )
    parser.add_argument(
        "--fov", type=positive, default=60.0, metavar="DEG", help="vertical"
    )
    height_reference(parser)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT.png")
    parser.add_argument(
        "--positions", type=Path, metavar="OUT.npy", help="drawn points, ECEF m"
    )
    parser.add_argument(
        "--pick", type=pixel, metavar="X,Y", help="say what is drawn at a pixel"
    )
    drawing(parser)
    styling(parser)
    given = parser.read(words)
    if given.fov >= 170:
        parser.error("--fov is not below 170")
    from viewer.still import render_still  # noqa: PLC0415  (opens GL)

    report = render_still(given.store, settings_of(given), given)
    if given.json:
        print_json(report)
    else:
        print_legend(report)
        if given.pick:
            from viewer.pick import pick_lines  # noqa: PLC0415  (opens GL)

            print("\n".join(pick_lines(report["pick"])))
    return 0


def fly(words: list[str]) -> int:
    """Fly a camera path and write a report."""
    parser = parser_of_fly()
    given = parser.read(words)
    if given.poses < 2:
        parser.error("--poses is below 2")
    if given.settled and given.fps:
        parser.error("--fps is for flights in real time")
    if given.pairs or given.profile is not None:
        if given.film or given.fps or given.style:
            parser.error("--pairs and --profile take no --film, --fps or --style")
        return look_closer(given)
    from viewer.run import Run, summary  # noqa: PLC0415  (opens GL)
    from viewer.run import fly as fly_path  # noqa: PLC0415

    run = Run(given.path, given.out, not given.settled, given.poses, given.film)
    run = replace(run, style=given.style, fps=given.fps)
    report = fly_path(given.store, settings_of(given), picture_of(given), run)
    print_report(report, given, summary)
    return 0


def parser_of_fly() -> Parser:
    """Return what reads the words of `fly`."""
    parser = Parser(
        "fly",
        "Fly a camera path and write report.json, frames.csv, flight.svg and index.html.",
        "A paced flight runs in real time; a settled one waits at every pose.\n\n"
        f"policies (`geopage replay` has more):\n{described(POLICIES)}",
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("path", type=Path, metavar="PATH.json")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--paced", action="store_true", help="in real time (default)")
    how.add_argument("--settled", action="store_true", help="wait at every pose")
    how.add_argument(
        "--pairs",
        type=whole,
        metavar="N",
        help="N paced flights, each beside its floors; writes pairs.json alone",
    )
    how.add_argument(
        "--profile",
        type=float,
        metavar="T_S",
        help="where the time of the frame at T_S goes; writes profile.json alone",
    )
    parser.add_argument("--poses", type=int, default=60, help="of a settled flight")
    paging(parser, "what is read next: see below")
    parser.add_argument(
        "--throttle",
        type=THROTTLE,
        metavar="MIB_PER_S,LATENCY_MS",
        help="read as over a slow disk or line",
    )
    parser.add_argument(
        "--detail",
        choices=DETAILS,
        default=DETAILS[0],
        help="by size alone, or less of it where things move fast across the screen",
    )
    parser.add_argument(
        "--fps",
        type=positive,
        default=0.0,
        metavar="N",
        help="hold N frames per second by coarser detail, chosen by predicted cost",
    )
    parser.add_argument("--film", type=Path, metavar="OUT.mp4")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    drawing(parser)
    styling(parser)
    return parser


def look_closer(given: argparse.Namespace) -> int:
    """Fly a camera path several times beside its floors, or look at one frame of it."""
    from viewer import frame_profile, pairs  # noqa: PLC0415  (opens GL)

    what = given.store, settings_of(given), picture_of(given), given.path
    if given.pairs:
        found = pairs.fly_pairs(*what, given.pairs)
        pairs.write(found, given.out)
        said = pairs.lines(found)
    else:
        found = frame_profile.profile_frame(*what, given.profile)
        frame_profile.write(found, given.out)
        said = frame_profile.lines(found)
    if given.json:
        print_json(found)
    else:
        print("\n".join(said))
    return 0


def chart(words: list[str]) -> int:
    """Draw speed against accuracy from flights."""
    parser = Parser("chart", "Draw frame time against screen error, a curve a method.")
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="folder of a flight"
    )
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT.svg")
    given = parser.read(words)
    from viewer.charts import read_report, speed_against_accuracy  # noqa: PLC0415  (slow)

    speed_against_accuracy([read_report(run) for run in given.runs], given.out)
    return 0


def demo(words: list[str]) -> int:
    """Make the sample world and fly it."""
    parser = Parser(
        "demo",
        "Make the sample world, fly from 10,000 km to a street in San Francisco, and write"
        " pictures, a film, a report and the chart.",
        "What is there already is used again.",
    )
    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR")
    given = parser.read(words)
    from viewer.demo import make_demo  # noqa: PLC0415  (opens GL)

    make_demo(given.out)
    print(f"open {given.out / 'index.html'}")
    return 0
