# SPDX-License-Identifier: Apache-2.0
"""The chart of paging: share of good frames over line speed, a curve a policy."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from viewer.charts import COLOURS, pyplot, save
from viewer.curve_labels import Label, name_curves

REFERENCE = "oracle"
OURS = "benefit"
OTHERS = (*COLOURS[1:], "#555555", "#8c564b", "#332288", "#999933")
MARKERS = "sD^vPX<>h"
STEP, TOP = 0.0485, 0.97
"""Of the axes' height: between two names, and of the highest"""
ALIKE = 1.0
"""Points within which curves need no names"""
SHARES = {
    "share_frames_within": "frames with 95 % of the ground\nwithin the threshold, %",
    "share_frames_complete": "and with no object tile missing, %",
}
Json = dict[str, Any]
Curves = dict[str, list[tuple[float, float]]]
"""of each policy: line speed and share, %"""


def panels_of(runs: Sequence[Json]) -> dict[str, list[Json]]:
    """Return runs by title of a panel: of each store the first flight, and the others."""
    panels: dict[str, list[Json]] = {}
    first: dict[str, str] = {}
    for run in runs:
        store = run["store"]
        is_first = first.setdefault(store, run["flight"]) == run["flight"]
        count = len({one["flight"] for one in runs if one["store"] == store}) - 1
        others = f"mean of {count} other flights over {store}"
        panels.setdefault(run["flight"] if is_first else others, []).append(run)
    return panels


def paging_chart(panels: Mapping[str, Sequence[Json]], out: Path) -> None:
    """Draw a column for each title.

    Parameters
    ----------
    panels : runs of a flight, or of several to be averaged, as `viewer.paging` returns
        them, with `times`

    Raises
    ------
    InputError
    """
    plt = pyplot(out)
    size = 6.0 * len(panels) + 0.4, 4.4 * len(SHARES)
    figure, grid = plt.subplots(
        len(SHARES), len(panels), figsize=size, sharey=True, sharex=True, squeeze=False
    )
    for axes, title in zip(grid[0], panels, strict=True):
        axes.set_title(title, loc="left", fontsize=11)
    for axes in grid[-1]:
        axes.set_xlabel("line speed, times what the flight needs")
    for row, (key, label) in zip(grid, SHARES.items(), strict=True):
        row[0].set_ylabel(label)
        for axes, runs in zip(row, panels.values(), strict=True):
            _panel(axes, curves(runs, key))
    figure.tight_layout(rect=(0, 0.03, 1, 1), w_pad=2)
    note = "dashed: clairvoyant, the reference; virtual clock, the same on any machine"
    figure.text(0.01, 0.012, note, fontsize=8, color="#555555")
    for row, key in zip(grid, SHARES, strict=True):
        for axes, runs in zip(row, panels.values(), strict=True):
            _labels(axes, curves(runs, key))
    save(figure, out)
    plt.close(figure)


def curves(runs: Sequence[Json], key: str) -> Curves:
    """Return line speed and mean share, %, of each policy."""
    found: dict[str, dict[float, list[float]]] = {}
    for run in runs:
        if run["times"]:
            points = found.setdefault(run["policy"], {})
            points.setdefault(run["times"], []).append(100 * run[key])
    return {
        name: [(times, fmean(points[times])) for times in sorted(points)]
        for name, points in found.items()
    }


def style_of(names: Sequence[str], name: str) -> Json:
    """Return how a policy's curve looks: ours strong, the reference dashed and black."""
    if name == REFERENCE:
        return {"color": "#000000", "ls": "--", "lw": 1.6, "marker": "", "zorder": 2}
    if name == OURS:
        return {"color": COLOURS[0], "lw": 3.0, "marker": "o", "zorder": 4}
    others = [other for other in names if other not in {OURS, REFERENCE}]
    i = others.index(name)
    colour, marker = OTHERS[i % len(OTHERS)], MARKERS[i % len(MARKERS)]
    return {"color": colour, "lw": 1.4, "marker": marker, "ms": 5, "zorder": 3}


def _panel(axes: Any, found: Curves) -> None:
    for name, points in found.items():
        axes.plot(*zip(*points, strict=True), **style_of(list(found), name))
    speeds = sorted({speed for points in found.values() for speed, _ in points})
    axes.set_xscale("log")
    axes.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
    axes.minorticks_off()
    axes.set_xlim(speeds[0] / 2.6, speeds[-1] * 1.1)
    axes.set_ylim(-2, 103)


def _labels(axes: Any, found: Curves) -> None:
    """Name each curve at its left end, where they differ most."""
    first = sorted((points[0][1], name, points[0][0]) for name, points in found.items())
    shares = zip(
        *([share for _, share in points] for points in found.values()), strict=True
    )
    if len(found) > 1 and all(max(ones) - min(ones) < ALIKE for ones in shares):
        text = f"all {len(found)} policies are within {ALIKE:g} point of each other"
        axes.text(
            0.5,
            max(first[0][0] / 100 - 0.1, 0.04),
            text,
            transform=axes.transAxes,
            ha="center",
        )
        return
    labels = []
    for share, name, speed in first:
        weight = "bold" if name == OURS else "normal"
        colour = style_of(list(found), name)["color"]
        labels.append(Label(name, colour, (speed, share), weight))
    name_curves(axes, labels, STEP, x=0.015, top=TOP)
