# SPDX-License-Identifier: Apache-2.0
"""Draws the charts of the experiments: curves, or bars, each named where it is."""

from pathlib import Path
from typing import Any

import numpy as np

from tiles.frames import Floats
from viewer.charts import COLOURS, pyplot, save
from viewer.curve_labels import Label, name_curves
from viewer.experiments.rows import Chart, Series

SIZE = (8.6, 4.4)
PAPER = "#222222"
LABEL_STEP = 0.075
"""Between two labels, as a share of the panel's height"""
TINY = 1e-3


def draw(chart: Chart, folder: Path, note: str) -> Path:
    """Write one chart as SVG and PNG; returns the SVG.

    Parameters
    ----------
    note : the machine, under the chart
    """
    plt = pyplot(folder)
    figure, axes = plt.subplots(figsize=SIZE)
    room = min(0.34, 0.03 + 0.0095 * max(len(one.label) for one in chart.series))
    figure.subplots_adjust(left=0.115, right=0.98 - room, top=0.9, bottom=0.2)
    if chart.bars:
        _bars(axes, chart)
    else:
        _curves(axes, chart)
    axes.set_title(chart.title, loc="left", fontsize=12)
    axes.set_xlabel(chart.x)
    axes.set_ylabel(chart.y)
    figure.text(0.01, 0.015, note, fontsize=7, color="#555555")
    out = folder / f"{chart.name}.svg"
    for path in (out, out.with_suffix(".png")):
        save(figure, path)
    plt.close(figure)
    return out


def colours_of(chart: Chart) -> list[str]:
    """Return a colour for each series; the paper's own is black."""
    free = iter(COLOURS)
    return [PAPER if one.paper else next(free) for one in chart.series]


def _curves(axes: Any, chart: Chart) -> None:
    for scale, is_log in ((axes.set_xscale, chart.log_x), (axes.set_yscale, chart.log_y)):
        scale("log" if is_log else "linear")
    ends = []
    for one, colour in zip(chart.series, colours_of(chart), strict=True):
        x, y = np.asarray(one.x, np.float64), _values(one, is_log=chart.log_y)
        dots = {"marker": "o", "ms": 4} if len(x) < 40 else {}
        style = "--" if one.paper else "-"
        axes.plot(x, y, style, color=colour, lw=1.6 if dots else 0.9, **dots)
        last = int(np.argmax(x))
        ends.append(Label(one.label, colour, (float(x[last]), float(y[last]))))
    if chart.log_x or chart.log_y:
        _plain(axes, chart)
    if not chart.log_y:
        axes.set_ylim(bottom=0)
    if len(chart.series[0].x) > 40:
        ends = _rightmost(chart)
    name_curves(axes, ends, LABEL_STEP, x=1.03)


def _rightmost(chart: Chart) -> list[Label]:
    """Return labels at the medians of noisy curves' last parts."""
    found = []
    for one, colour in zip(chart.series, colours_of(chart), strict=True):
        y = _values(one, is_log=chart.log_y)
        found.append(Label(one.label, colour, (float(one.x[-1]), float(np.median(y[-9:])))))
    return found


def _values(one: Series, *, is_log: bool) -> Floats:
    """Return y; a logarithm has no zero."""
    y = np.asarray(one.y, np.float64)
    return np.maximum(y, TINY) if is_log else y


def _plain(axes: Any, chart: Chart) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter  # noqa: PLC0415

    for axis, is_log in ((axes.xaxis, chart.log_x), (axes.yaxis, chart.log_y)):
        if is_log:
            low, high = axis.get_view_interval()
            subs = (1.0,) if high / low > 1e3 else (1.0, 2.0, 5.0)
            axis.set_major_locator(LogLocator(subs=subs, numticks=12))
            axis.set_major_formatter(FuncFormatter(lambda value, _: _plainly(value)))
            axis.set_minor_formatter(NullFormatter())


def _in_two(name: str) -> str:
    """Break a name at its comma, or else at its first space."""
    return name.replace(", ", ",\n", 1) if ", " in name else name.replace(" ", "\n", 1)


def _plainly(value: float) -> str:
    """Return two digits, and no powers of ten."""
    return f"{value:,.0f}" if value >= 10 else f"{value:.2g}"


def _bars(axes: Any, chart: Chart) -> None:
    count = len(chart.series)
    width = 0.8 / count
    place = np.arange(len(chart.bars))
    ends = []
    for i, (one, colour) in enumerate(zip(chart.series, colours_of(chart), strict=True)):
        x = place + (i - (count - 1) / 2) * width
        y = _values(one, is_log=chart.log_y)
        bars = axes.bar(x, y, width, color=colour, edgecolor="white", lw=0.5)
        axes.bar_label(bars, [_plainly(v) for v in y], fontsize=6.5, color=colour)
        ends.append(Label(one.label, colour, (float(x[-1] + width / 2), float(y[-1]))))
    if chart.log_y:
        axes.set_yscale("log")
        _plain(axes, chart)
    axes.set_xticks(place, [_in_two(name) for name in chart.bars], fontsize=8)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.5, len(place) - 0.5)
    name_curves(axes, ends, LABEL_STEP, x=1.03)
