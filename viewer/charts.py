# SPDX-License-Identifier: Apache-2.0
"""Speed against accuracy, as one chart; and one flight over time."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geopage.settings import DETAILS
from tiles.errors import InputError

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""Okabe and Ito's colours, which colour-blind people can tell apart."""
Json = dict[str, Any]


def read_report(run: Path) -> Json:
    """Read the report of a run: a folder with report.json, or the file itself.

    Raises
    ------
    InputError
    """
    path = run / "report.json" if run.is_dir() else run
    if not path.is_file():
        raise InputError(
            run, "holds no report.json", "name a folder that `geopage fly` wrote"
        )
    try:
        report: Json = json.loads(path.read_text())
        float(report["frames"]["p50_ms"]), float(report["screen_error_px"]["p50"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            path, f"is not a flight's report ({error})", "fly again"
        ) from error
    return report


def pyplot(out: Path) -> Any:
    """Return matplotlib's pyplot without a screen.

    Raises
    ------
    InputError
        When matplotlib is not installed.
    """
    try:
        import matplotlib as mpl  # noqa: PLC0415  (an extra, slow to import)
        from matplotlib import pyplot as plt  # noqa: PLC0415
    except ImportError as error:
        advice = "install the extra `report`: pip install geopage[report]"
        raise InputError(out, "charts need matplotlib", advice) from error
    mpl.use("Agg")
    mpl.rcParams.update({"font.size": 10, "svg.hashsalt": "geopage", "axes.grid": True})
    mpl.rcParams.update({"grid.color": "#dddddd", "axes.axisbelow": True})
    return plt


def speed_against_accuracy(reports: Sequence[Json], out: Path) -> None:
    """Draw a curve per method: frame time against what the pictures err.

    The geometric error was measured against the sources' own posts. Beside it stands what
    the selection itself knows: a bound that it keeps, not a measurement of the picture.
    Reports of flights that were not measured show only that.
    """
    plt = pyplot(out)
    figure, axes = plt.subplots(figsize=(8, 5.6))
    series: dict[str, list[Json]] = {}
    for report in reports:
        settings = report["settings"]
        series.setdefault(method_of(settings), []).append(report)
    for (name, runs), colour in zip(sorted(series.items()), _cycle(), strict=False):
        _curves(axes, name, runs, colour)
    axes.set_xscale("log")
    axes.set_yscale("log")
    plain_ticks(axes)
    axes.set_xlabel("frame time, ms (dot: median, bar to the 99th percentile)")
    axes.set_ylabel("error, px")
    first = reports[0]
    size = "x".join(str(n) for n in first["settings"]["size_px"])
    axes.set_title(
        f"Speed against accuracy: {first['settings']['path']}, {size}", loc="left"
    )
    machine = first["machine"]
    note = f"{machine['cpu']}, {machine['cores']} cores; {machine['gl_renderer']}"
    if any(map(_measured, reports)):
        note += "\nmeasured: shortest distances between the drawn terrain and the sources' "
        note += "own posts, both ways, at key frames; 95 % of pixels err less"
    figure.text(0.01, 0.01, note, fontsize=7, color="#555555")
    axes.legend(frameon=False, fontsize=8)
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    save(figure, out)
    plt.close(figure)


def method_of(settings: Json) -> str:
    """Return the name of what was flown: all but the threshold that makes a method."""
    detail = settings.get("detail", DETAILS[0])
    by_speed = [] if detail == DETAILS[0] else [f"detail by {detail.replace('-', ' ')}"]
    return ", ".join((settings["policy"], *by_speed, settings["mode"]))


def _measured(run: Json) -> float | None:
    """Return the 95th percentile of the measured error, None where none was measured."""
    found = run.get("geometric_error_px", {}).get("p95")
    # A logarithmic axis has no zero; what is below a thousandth of a pixel is as good.
    return None if found is None else max(float(found), 1e-3)


def _curves(axes: Any, name: str, runs: list[Json], colour: str) -> None:
    """Draw a method's measured error, and the selection's own number in a thinner line."""
    runs = sorted(runs, key=lambda run: float(run["settings"]["threshold_px"]))
    known = [run for run in runs if _measured(run) is not None]
    own = [float(run["screen_error_px"]["p50"]) for run in runs]
    words = f"{name}: known to the selection, median of frames"
    if known:
        _curve(
            axes, known, [_measured(run) for run in known], f"{name}: measured, p95", colour
        )
        x = [run["frames"]["p50_ms"] for run in runs]
        style = {"color": colour, "lw": 1, "alpha": 0.6, "mfc": "white"}
        axes.plot(x, own, "o--", label=words, **style)
    else:
        _curve(axes, runs, own, words, colour)


def _curve(axes: Any, runs: list[Json], errors: Any, label: str, colour: str) -> None:
    x = np.array([run["frames"]["p50_ms"] for run in runs])
    worst = np.array([run["frames"]["p99_ms"] for run in runs])
    y = np.array(errors, np.float64)
    floor = [run["floor"]["frame_p50_ms"] for run in runs]
    axes.hlines(y, x, np.maximum(worst, x), color=colour, lw=1, alpha=0.5)
    axes.plot(x, y, "o-", color=colour, label=label)
    axes.plot(
        floor, y, "|", color=colour, ms=14, mew=2, label="the same, resident replay (floor)"
    )
    for run, px, error in zip(runs, x, y, strict=True):
        label = f" {run['settings']['threshold_px']:g} px"
        axes.annotate(
            label, (px, error), textcoords="offset points", xytext=(4, 6), color=colour
        )


def plain_ticks(axes: Any) -> None:
    """Label logarithmic axes with plain numbers: 1, 2, 5, 10."""
    from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter  # noqa: PLC0415

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
        axis.set_major_formatter(ScalarFormatter())
        axis.set_minor_formatter(NullFormatter())


def flight_over_time(
    table: Any,
    out: Path,
    *,
    budget_bytes: int,
    floor_ms: Any,
    error_px: Any,
    measured: Sequence[Json] = (),
    limit_ms: float | None = None,
) -> None:
    """Draw one flight: height, frame time beside its floor, errors, memory.

    Parameters
    ----------
    measured : key frames with their time `t_s` and measured `p50` and `p95`, px
    limit_ms : the frame budget, if one was held, by other thresholds
    """
    plt = pyplot(out)
    figure, rows = plt.subplots(4, 1, figsize=(8, 8), sharex=True)
    t = table["t_s"]
    rows[0].plot(t, table["height_m"], color=COLOURS[0])
    rows[0].set_yscale("log")
    rows[0].set_ylabel("height, m")
    rows[1].plot(t, table["frame_ms"], color=COLOURS[1], label="flight", lw=1)
    rows[1].plot(t, floor_ms, color="#444444", label="resident replay (floor)", lw=1)
    if limit_ms is not None:
        rows[1].plot(t, table["expected_ms"], color=COLOURS[5], label="expected", lw=1)
        rows[1].axhline(limit_ms, color="#444444", ls="--", lw=1, label="budget")
        rows[2].plot(t, table["threshold_px"], color=COLOURS[5], label="threshold", lw=1)
    rows[1].set_ylabel("frame, ms")
    rows[1].set_ylim(0, None)
    rows[1].legend(frameon=False, ncols=4)
    rows[2].plot(t, error_px, color=COLOURS[2], label="known to the selection")
    judged = [frame for frame in measured if "p95" in frame]
    for mark, key in (("o", "p95"), (".", "p50")):
        if judged:
            at, found = zip(*((frame["t_s"], frame[key]) for frame in judged), strict=True)
            rows[2].plot(at, found, mark, color="#444444", label=f"measured, {key}")
    rows[2].legend(frameon=False, ncols=4)
    rows[2].set_ylabel("error, px")
    rows[3].plot(t, table["memory_bytes"] / 2**20, color=COLOURS[3], label="accounted")
    rows[3].axhline(budget_bytes / 2**20, color="#444444", ls="--", lw=1, label="budget")
    rows[3].set_ylabel("memory, MiB")
    rows[3].set_ylim(0, None)
    rows[3].legend(frameon=False, ncols=2)
    rows[3].set_xlabel("time, s")
    figure.tight_layout()
    save(figure, out)
    plt.close(figure)


def save(figure: Any, out: Path) -> None:
    """Write a figure.

    Raises
    ------
    InputError
    """
    try:
        figure.savefig(out, metadata={"Date": None} if out.suffix == ".svg" else None)
    except (OSError, ValueError) as error:
        advice = "name a .svg, .png or .pdf in a folder that exists"
        raise InputError(out, str(error).splitlines()[0], advice) from error


def _cycle() -> tuple[str, ...]:
    return COLOURS * 4
