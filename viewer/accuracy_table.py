# SPDX-License-Identifier: Apache-2.0
"""What `geopage accuracy` found, as ACCURACY.md."""

from collections.abc import Sequence

from viewer.accuracy_words import parts_of, worst_pixel
from viewer.stability.table import short
from viewer.tally import Json

CHART = "pictures/accuracy.svg"
LEAD = (
    "The geometric error of a pixel is the shortest distance from the drawn point to the"
    " finest source surface, or from the point of that surface that a ray through the"
    " pixel meets to the drawn triangles, whichever is longer, in pixels at its depth. The"
    " source surface is made of the sources' own posts, joined by triangles, with code"
    " that shares nothing with what made the terrain. It may be as large as the threshold,"
    " or as the error that a leaf, the finest tile of a place, states (the *limit*)."
    " Silhouettes, where two surfaces far apart meet in the picture, are compared apart."
    " Not judged: places without a source, and those around a finer source, where the"
    " coarser one is bent to meet it and nobody knows the ground."
)
VIEWS = (
    "Random places over the globe and over every source, 10 m to 10,000 km above ground,"
    " straight down to above the horizon; each view drawn when all that it wants is loaded."
)
HEIGHTS = (
    "Random places of each source, those left out where a finer source lies or bends the"
    " ground: height of the finest terrain less that of the source's own triangles."
)
FLIGHTS = (
    "The same flight, down to 20 km and up again, over each pole, along the antimeridian"
    " and along a parallel of 45 degrees: triangles a frame, and beside those at 45 degrees"
    " (wanted: at most 1.5). Where pixels show leaves, the data decide what is"
    " drawn, not the threshold: posts a fixed angle apart lie denser near a pole."
    " A made-up earth that is equally rough everywhere is held to 1.5 by"
    " tests/viewer/test_poles.py."
)
SELECTION = (
    "Choosing what a view draws, everything loaded, 1 px, random views from 10 m to"
    " 10,000 km; processor time (wanted: 99 % of them under 1 ms)."
)


def as_markdown(report: Json, drawn: bool) -> str:  # noqa: FBT001
    """Return ACCURACY.md.

    Parameters
    ----------
    drawn : the chart lies beside it
    """
    where = report["machine"]
    size = "x".join(map(str, report["size_px"]))
    sharp = ",".join(f"{found['threshold_px']:g}" for found in parts_of(report))
    command = f"geopage accuracy {report['store']} --threshold {sharp}"
    command += f" --views {report['views']} --seed {report['seed']} --size {size}"
    about = {
        "command": command + " --all" * ("flights" in report) + " --out DIR",
        "machine": f"{where['cpu']}, {where['cores']} cores",
        "gl renderer": where["gl_renderer"],
        "python": where["python"],
        "commit": where["commit"] or "unknown",
        "store": report["store"],
        "views": f"{report['views']} of {size} px, 60 degrees high, seed {report['seed']}",
    }
    judged = [found for found in parts_of(report) if found["pixels_judged"]]
    parts = [
        "# How far pictures are from their sources",
        "A command wrote this file: don't edit it.",
        LEAD,
        "\n".join(f"- {key}: {value}" for key, value in about.items()),
        "## Settled views",
        VIEWS,
        _table(VIEW_HEAD, [_view_row(found) for found in judged]),
        _table(ERROR_HEAD, [_error_row(found) for found in judged]),
        "The pixel of each threshold that comes nearest to its limit, or is beyond it:",
        "\n".join(
            f"- {found['threshold_px']:g} px: {worst_pixel(found)}" for found in judged
        ),
        f"![Share of pixels that err by more than so much]({CHART})" if drawn else "",
        *_more(report),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


VIEW_HEAD = (
    *("threshold, px", "pixels judged", "within the limit", "beyond it"),
    *("worst error / limit", "limited by a leaf", "not judged"),
    *("silhouettes beyond the limit and 1 px", "triangles a view"),
)
ERROR_HEAD = (
    *("threshold, px", "all pixels: error p50, px", "p95", "p99", "largest"),
    *("where no leaf limits: p50", "p95", "p99", "largest"),
)
ERRORS = ("p50", "p95", "p99", "max")


def _view_row(found: Json) -> list[str]:
    within, count = found["share_within_threshold"], found["pixels_judged"]
    worst, moved = found["worst_view"], found.get("silhouette")
    return [
        *(f"{found['threshold_px']:g}", f"{count:,}"),
        *(percent(within), f"{round((1 - within) * count):,} pixels"),
        short(worst["error_px"] / worst["limit_px"]),
        percent(found["share_limited_by_leaf"]),
        percent(found["share_not_judged"]),
        percent(moved["share_beyond_limit"]) if moved else "",
        f"{found['triangles_mean']:,.0f}",
    ]


def _error_row(found: Json) -> list[str]:
    free = found.get("where_no_leaf_limits", {})
    elsewhere = (short(free[name]) if free else "" for name in ERRORS)
    every = (short(found[name]) for name in ERRORS)
    return [f"{found['threshold_px']:g}", *every, *elsewhere]


def _more(report: Json) -> list[str]:
    """Return the sections on what was measured besides views."""
    parts: list[str] = []
    if "heights" in report:
        rows = [_height_row(one) for one in report["heights"] if one["places"]]
        parts += ["## Heights at random places", HEIGHTS, _table(HEIGHT_HEAD, rows)]
    if "flights" in report:
        rows = [_flight_row(one) for one in report["flights"]]
        parts += ["## Poles and antimeridian", FLIGHTS, _table(FLIGHT_HEAD, rows)]
    if "selection" in report:
        rows = [_selection_row(one) for one in report["selection"]]
        parts += ["## Selection", SELECTION, _table(SELECTION_HEAD, rows)]
    return parts


HEIGHT_HEAD = (
    *("source", "posts apart, m", "places", "difference p50, m", "p99", "largest"),
    *("error stated there, m", "worst difference / stated", "within"),
)
FLIGHT_HEAD = (
    *("flight", "threshold, px", "triangles", "/ at 45 degrees"),
    *("tiles", "/ at 45 degrees", "pixels that show a leaf"),
)
SELECTION_HEAD = ("index", "cells", "views", "p50, ms", "p99", "largest")


def _height_row(one: Json) -> list[str]:
    return [
        *(one["name"], short(one["spacing_m"]), f"{one['places']:,}"),
        *(short(one[name]) for name in ("p50_m", "p99_m", "max_m", "bound_m")),
        *(short(one["share_of_bound"]), percent(one["share_within"])),
    ]


def _flight_row(one: Json) -> list[str]:
    return [
        *(one["flight"].replace("_", " "), f"{one['threshold_px']:g}"),
        *(f"{one['triangles']:,.0f}", f"{one['triangles_ratio']:.2f}"),
        *(f"{one['tiles']:.0f}", f"{one['tiles_ratio']:.2f}", percent(one["leaf_share"])),
    ]


def _selection_row(one: Json) -> list[str]:
    times = (f"{one[name]:.3f}" for name in ("p50_ms", "p99_ms", "max_ms"))
    return [one["index"], f"{one['cells']:,}", str(one["views"]), *times]


def percent(share: float) -> str:
    """Return a share in percent; only what is all is called 100 %, what is none 0 %."""
    texts = (f"{100 * share:.{digits}f}" for digits in range(2, 14))
    said = (text for text in texts if float(text) < 100 and (float(text) or not share))
    return "100 %" if share >= 1.0 else f"{next(said)} %"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
