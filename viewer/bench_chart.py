# SPDX-License-Identifier: Apache-2.0
"""The chart of `geopage bench`: error up, cost to the right, a curve a method."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tiles.frames import Floats
from viewer.charts import COLOURS, plain_ticks, pyplot, save
from viewer.curve_labels import Label, name_curves

ACROSS = (
    ("paced", "frame_p50_ms", 1.0, "time of a frame, ms (line: to the slowest 1 %)"),
    ("settled", "frame_p50_ms", 1.0, "time of a frame, ms (line: to the slowest 1 %)"),
    ("settled", "ground_triangles", 1e-3, "triangles of ground in a frame, thousands"),
    ("settled", "bytes", 2.0**-20, "tiles drawn on the path, MiB as stored"),
)
"""Mode, column of results.csv, its unit, and words"""
TITLES = {"paced": "flown in real time", "settled": "everything loaded"}
GROUND = ("error_p95_px", 3e-2, "error of the drawn ground, px\n(95 % of pixels err less)")
PICTURE = (
    "flip_mean",
    1e-4,
    "difference from the finest picture\n(FLIP: 0 alike, 1 other)",
)
"""Column, the least that a logarithmic axis shows of it, and words"""
MOST_PX = 100.0
"""What errs more is drawn here."""
HEADS = {
    "error_p95_px": "How wrong is the ground in a frame, and what does the frame cost?",
    "flip_mean": "How far is a frame from the finest picture, and what does it cost?",
}
WHOLE = ("settled", "triangles", 1e-3, "triangles in a frame, thousands")
"""What a picture costs, in place of the ground alone"""
HOW = (
    " Lower left is better. Each curve is one way to choose detail on the same engine and"
    " data, each mark a threshold in px."
)
INKS = ("#000000", *COLOURS, "#888888", "#7b3294")
MARKERS = "osD^vPXd*"
LABEL_STEP = 0.06
TINY = 1e-3
Json = dict[str, Any]
Series = tuple[str, list[Json]]
Styles = dict[str, tuple[str, str]]
Kind = tuple[str, float, str]


def bench_chart(
    rows: Sequence[Json], about: Json, outs: Sequence[Path], what: Kind = GROUND
) -> None:
    """Draw error over frame time, flown and settled, and over triangles and bytes.

    Parameters
    ----------
    rows, about : as `bench` returns them
    outs : files to write, .svg, .png or .pdf
    what : error that is drawn; that of the pictures where the ground's is not known

    Raises
    ------
    InputError
    """
    plt = pyplot(outs[0])
    up = [what if any(what[0] in row for row in rows) else PICTURE]
    across = [kind for kind in ACROSS if any(kind[0] == row["mode"] for row in rows)]
    if up[0] is PICTURE:
        across = [WHOLE if kind[1] == "ground_triangles" else kind for kind in across]
    size = 3.4 * len(across) + 3.4, 6.0
    figure, panels = plt.subplots(
        len(up), len(across), figsize=size, sharey="row", squeeze=False
    )
    figure.subplots_adjust(0.06, 1.15 / size[1], 0.9, 1 - 1.0 / size[1], 0.06, 0.12)
    make_room(panels, across)
    styles = styles_of(rows)
    for line, vertical in zip(panels, up, strict=True):
        for axes, kind in zip(line, across, strict=True):
            _panel(axes, series_of(rows, kind[0]), kind, vertical, styles)
        line[0].set_ylabel(vertical[2])
        line[0].set_ylim(limits([_points(rows, across[0], vertical)[1]]))
    # Only now are the axes' limits what they will be.
    for line, vertical in zip(panels, up, strict=True):
        for i, kind in enumerate(across):
            if i == len(across) - 1 or across[i + 1][0] != kind[0]:
                _direct_labels(line[i], series_of(rows, kind[0]), kind, vertical, styles)
    for top, axes, kind in zip(panels[0], panels[-1], across, strict=True):
        top.set_title(TITLES[kind[0]], loc="left", fontsize=9)
        axes.set_xlabel(kind[3])
    figure.suptitle(HEADS[up[0][0]], x=0.01, ha="left", fontsize=14)
    flight = f"Flight {about['path']} over {about['store']}, {about['picture']}."
    figure.text(0.01, 1 - 0.52 / size[1], flight + HOW, fontsize=9, color="#555555")
    figure.text(0.01, 0.01, _note(about), fontsize=8, color="#555555")
    for out in outs:
        save(figure, out)
    plt.close(figure)


def make_room(panels: Any, across: Sequence[Any]) -> None:
    """Move the panels of each mode together, with room for labels at their right."""
    modes = list(dict.fromkeys(kind[0] for kind in across))
    left, right, gap, label = 0.06, 0.995, 0.012, 0.085
    width = (right - left - label * len(modes)) / len(across) - gap
    for line in panels:
        x = left
        for i, (axes, kind) in enumerate(zip(line, across, strict=True)):
            place = axes.get_position()
            axes.set_position((x, place.y0, width, place.height))
            is_last = i == len(across) - 1 or across[i + 1][0] != kind[0]
            x += width + (label if is_last else gap)


def series_of(rows: Sequence[Json], mode: str) -> list[Series]:
    """Return the curves of a mode: each method and its rows by threshold."""
    found: dict[str, list[Json]] = {}
    for row in rows:
        if row["mode"] == mode:
            found.setdefault(row["method"], []).append(row)
    return [(name, sorted(of, key=_threshold)) for name, of in found.items()]


def _threshold(row: Json) -> float:
    return float(row["threshold_px"])


def _note(about: Json) -> str:
    return (
        f"{about['machine']}; {about['gl_renderer']}; commit {about['commit']}."
        f" Paced: {about['paced']}. Settled: {about['settled']}.\n"
        "Thresholds are named on the first curve. | is the same flight again with all"
        f" in memory. Errors above {MOST_PX:g} px are drawn there."
    )


def _panel(
    axes: Any, series: Sequence[Series], across: Any, vertical: Any, styles: Styles
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.autoscale(enable=False)
    extent = []
    for i, (method, of) in enumerate(series):
        colour, marker = styles[method]
        x, y = _points(of, across, vertical)
        extent.append(x)
        axes.plot(x, y, "-", marker=marker, color=colour, ms=6, lw=1.2 if i else 2.2)
        if across[1] == "frame_p50_ms":
            extent.append(_times(axes, of, x, y, colour))
        for row, at in zip(of, zip(x, y, strict=True), strict=True) if i == 0 else ():
            words = f"{row['threshold_px']:g}"
            style = {"color": colour, "fontsize": 8, "textcoords": "offset points"}
            axes.annotate(words, at, xytext=(5, 5), **style)
    axes.set_xlim(limits(extent))
    plain_ticks(axes)
    axes.yaxis.set_major_formatter("{x:g}")


def limits(values: Sequence[Floats]) -> tuple[float, float]:
    """Return where a logarithmic axis begins and ends, also when all values are one."""
    known = np.concatenate(values)
    known = known[np.isfinite(known)]
    low, high = float(known.min()), float(known.max())
    margin = max(1.1, (high / low) ** 0.08)
    return low / margin, high * margin


def styles_of(rows: Sequence[Json]) -> Styles:
    """Return colour and marker of each method; the first one's is black."""
    names = list(dict.fromkeys(row["method"] for row in rows))
    return {
        name: (INKS[i % len(INKS)], MARKERS[i % len(MARKERS)])
        for i, name in enumerate(names)
    }


def _points(rows: Sequence[Json], across: Any, vertical: Any) -> tuple[Floats, Floats]:
    """Return x and y, (n,), NaN where not measured; a logarithm has no zero."""
    x = np.array([row.get(across[1], np.nan) for row in rows], np.float64) * across[2]
    y = np.array([row.get(vertical[0], np.nan) for row in rows], np.float64)
    return np.maximum(x, TINY), np.clip(y, vertical[1], MOST_PX)


def _times(axes: Any, rows: list[Json], x: Floats, y: Floats, colour: str) -> Floats:
    """Add bars to the 99th percentile and ticks at the floors; returns where they are."""
    worst = np.array([row["frame_p99_ms"] for row in rows])
    axes.hlines(y, x, np.maximum(worst, x), color=colour, lw=1, alpha=0.45)
    floor = np.array([row.get("floor_p50_ms", np.nan) for row in rows])
    if np.isfinite(floor).any():
        axes.plot(floor, y, "|", color=colour, ms=12, mew=1.6)
    return np.concatenate((worst, floor))


def _direct_labels(
    axes: Any, series: Sequence[Series], across: Any, vertical: Any, styles: Styles
) -> None:
    """Name each curve at the right of its panel, with a line to its coarsest point."""
    ends = []
    for method, of in series:
        x, y = (float(part[-1]) for part in _points(of, across, vertical))
        if np.isfinite(x * y):
            ends.append(Label(method, styles[method][0], (x, y)))
    name_curves(axes, ends, LABEL_STEP, x=1.04, size=8)
