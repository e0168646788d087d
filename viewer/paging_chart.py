# SPDX-License-Identifier: Apache-2.0
"""The chart of `geopage replay`: share of good frames over line speed, a curve a policy."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from viewer.bench_chart import apart
from viewer.charts import COLOURS, pyplot, save

REFERENCE = "oracle"
OURS = "benefit"
OTHERS = (*COLOURS[1:], "#555555", "#8c564b", "#332288", "#999933")
MARKERS = "sD^vPX<>h"
STEP = 0.05
Json = dict[str, Any]


def paging_chart(flights: Sequence[tuple[str, Sequence[Json]]], out: Path) -> None:
    """Draw a panel for each flight.

    Parameters
    ----------
    flights : title and runs, as `viewer.paging` returns them, throttled

    Raises
    ------
    InputError
    """
    plt = pyplot(out)
    size = 6.6 * len(flights) + 0.4, 5.2
    figure, panels = plt.subplots(1, len(flights), figsize=size, sharey=True, squeeze=False)
    for axes, (title, runs) in zip(panels[0], flights, strict=True):
        _panel(axes, runs)
        axes.set_title(title, loc="left", fontsize=11)
        axes.set_xlabel("line speed, MiB/s")
    panels[0, 0].set_ylabel("frames with 95 % of the ground\nwithin the threshold, %")
    figure.tight_layout(rect=(0, 0.03, 1, 1), w_pad=2)
    note = "dashed: clairvoyant, the reference; virtual clock, the same on any machine"
    figure.text(0.01, 0.012, note, fontsize=8, color="#555555")
    for axes, (_, runs) in zip(panels[0], flights, strict=True):
        _labels(axes, runs)
    save(figure, out)
    plt.close(figure)


def curves(runs: Sequence[Json]) -> dict[str, list[tuple[float, float]]]:
    """Return line speed, MiB/s, and share of good frames, %, of each policy."""
    found: dict[str, list[tuple[float, float]]] = {}
    for run in runs:
        if run["throttle"]:
            point = run["throttle"][0], 100 * run["share_frames_within"]
            found.setdefault(run["policy"], []).append(point)
    return {name: sorted(points) for name, points in found.items()}


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


def _panel(axes: Any, runs: Sequence[Json]) -> None:
    found = curves(runs)
    for name, points in found.items():
        axes.plot(*zip(*points, strict=True), **style_of(list(found), name))
    speeds = sorted({speed for points in found.values() for speed, _ in points})
    axes.set_xscale("log")
    axes.set_xticks(speeds, [f"{speed:.2g}" for speed in speeds])
    axes.minorticks_off()
    axes.set_xlim(speeds[0] / 2.6, speeds[-1] * 1.1)
    axes.set_ylim(-2, 103)


def _labels(axes: Any, runs: Sequence[Json]) -> None:
    """Name each curve at its left end, where they differ most."""
    found = curves(runs)
    first = sorted((points[0][1], name, points[0][0]) for name, points in found.items())
    low, high = axes.get_ylim()
    places = apart([(share - low) / (high - low) for share, _, _ in first], STEP)
    for place, (share, name, speed) in zip(places, first, strict=True):
        style = style_of(list(found), name)
        axes.annotate(
            name,
            (speed, share),
            xytext=(0.015, place),
            textcoords="axes fraction",
            color=style["color"],
            fontsize=9,
            fontweight="bold" if name == OURS else "normal",
            va="center",
            arrowprops={"arrowstyle": "-", "color": style["color"], "lw": 0.5},
        )
