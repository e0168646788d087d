# SPDX-License-Identifier: Apache-2.0
"""The paging of a flight, tile by tile: a table, a chart and a page."""

import csv
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geopage.trace import LATE_MS, TRACE, late_ms, summary
from geopage.tree import Tree
from tiles.errors import InputError
from tiles.lanes import Lane
from viewer.charts import COLOURS, pyplot, save
from viewer.page import write_document

Trace = NDArray[np.void]
NAMES = tuple(name for name in TRACE.names or () if name not in {"lane", "row"})
STAGES = (
    ("asked_s", "taken_s", "#c8ccd2", "waits for its turn"),
    ("taken_s", "decoded_s", COLOURS[0], "read and decoded"),
    ("decoded_s", "uploaded_s", COLOURS[5], "waits for the upload"),
    ("uploaded_s", "drawn_s", COLOURS[4], "there, not drawn yet"),
)
LATE = COLOURS[1]
TRACE_TEXT = (
    "Paging, tile by tile. A line for each tile, from when it was asked for until it was"
    " first drawn; red: something coarser was drawn in its place meanwhile. Every tile with"
    " its ranks is in trace.csv."
)
WORST = 15
Json = dict[str, Any]


def write_trace(out: Path, table: Trace, trees: Mapping[Lane, Tree]) -> None:
    """Write a line for each tile.

    Raises
    ------
    InputError
    """
    late = late_ms(table)
    try:
        with out.open("w", newline="") as file:
            lines = csv.writer(file)
            lines.writerow(("lane", "row", "level", "bytes", *NAMES, "late_ms"))
            for tile, ms in zip(table, late.tolist(), strict=True):
                lane, row = Lane(int(tile["lane"])), int(tile["row"])
                about = lane.name.lower(), row, trees[lane].level[row]
                values = [_text(tile[name]) for name in NAMES]
                size = trees[lane].tile_bytes[row]
                lines.writerow((*about, size, *values, _text(round(ms, 1))))
    except OSError as error:
        advice = "name a folder that can be written"
        raise InputError(out, str(error.strerror or error), advice) from error


def _text(value: Any) -> str:
    """Return a number, empty where it never came to that."""
    return "" if np.isnan(value) else f"{value:.7g}"


def write_trace_page(
    folder: Path, table: Trace, trees: Mapping[Lane, Tree], about: Json
) -> None:
    """Write trace.csv, trace.svg and index.html into a folder.

    Parameters
    ----------
    about : figures of the flight, as `viewer.paging` returns them
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_trace(folder / "trace.csv", table, trees)
    draw_trace(table, folder / "trace.svg")
    line = about["throttle"]
    rate = f"a line of {line[0]:.3g} MiB/s" if line else "no throttle"
    lead = (
        f"{len(table)} tiles were asked for by the policy {about['policy']}, over {rate}:"
        f" {about['share_frames_within']:.1%} of the frames had 95 % of their ground within"
        " the threshold."
    )
    parts = [
        f"<h1>Paging, tile by tile</h1><p class=lead>{escape(lead)}</p>",
        "<p>A line for each tile, from the first one asked for at the top. It begins when"
        " the tile was first asked for and ends when it was first drawn. Red: something"
        " coarser was drawn in its place meanwhile. A mere grey dash was asked for and"
        " never read: others were worth more, or it was no longer needed.</p>"
        '<img src="trace.svg" alt="time line of every tile">',
        _figures(summary(table)),
        _latest(table, trees),
        '<p class=note>Every tile, with ranks: <a href="trace.csv">trace.csv</a></p>',
    ]
    write_document(folder, "Paging, tile by tile", parts)


WORDS = {
    "tiles_late": ("tiles that came late", "{:.0f}"),
    "late_p50_ms": ("half of those came later than", "{:.0f} ms"),
    "late_p95_ms": ("5 % of those came later than", "{:.0f} ms"),
    "late_max_ms": ("the latest came after", "{:.0f} ms"),
    "tiles_predicted": ("tiles asked for before a view missed them", "{:.0f}"),
    "prediction_hit_share": ("of those that were read, were drawn", "{:.1%}"),
    "prediction_in_time_share": ("of those that were read, came in time", "{:.1%}"),
    "never_drawn_share": ("of all tiles read, never drawn", "{:.1%}"),
}


def _figures(found: Mapping[str, float]) -> str:
    rows = "".join(
        f"<tr><td>{text}<td class=n>{form.format(found[key])}"
        for key, (text, form) in WORDS.items()
        if key in found
    )
    return f"<h2>In figures</h2><table>{rows}</table>"


def _latest(table: Trace, trees: Mapping[Lane, Tree]) -> str:
    """Return the tiles that came latest as a table."""
    late = late_ms(table)
    order = np.argsort(-np.nan_to_num(late), kind="stable")[:WORST]
    rows = ""
    for i in order[np.nan_to_num(late)[order] > LATE_MS].tolist():
        lane, row = Lane(int(table["lane"][i])), int(table["row"][i])
        level, size = int(trees[lane].level[row]), int(trees[lane].tile_bytes[row])
        times = (table["asked_s"][i], table["awaited_s"][i], table["uploaded_s"][i])
        cells = "".join(f"<td class=n>{time:.2f}" for time in times)
        rows += (
            f"<tr><td>{lane.name.lower()}<td class=n>{level}<td class=n>{size / 1e3:.1f}"
            f"{cells}<td class=n>{late[i]:.0f}"
        )
    head = "<th>lane<th>level<th>kB<th>asked, s<th>missed from, s<th>there, s<th>late, ms"
    return f"<h2>The latest</h2><table><tr>{head}{rows}</table>" if rows else ""


def draw_trace(table: Trace, out: Path) -> None:
    """Draw a line for each tile over time, the lanes apart."""
    plt = pyplot(out)
    lanes = [lane for lane in Lane if (table["lane"] == lane).any()]
    shares = [max(int((table["lane"] == lane).sum()), 40) for lane in lanes] or [1]
    figure, panels = plt.subplots(
        max(len(lanes), 1),
        1,
        figsize=(11, 9),
        sharex=True,
        squeeze=False,
        gridspec_kw={"height_ratios": shares},
    )
    for axes, lane in zip(panels[:, 0], lanes, strict=False):
        _draw_lane(axes, table[table["lane"] == lane])
        axes.set_ylabel(f"{lane.name.lower()}: tiles in the order of asking")
    panels[-1, 0].set_xlabel("time of the flight, s")
    entries = [(colour, text) for _, _, colour, text in STAGES]
    entries += [(LATE, "something coarser is drawn in its place")]
    handles = [plt.Line2D([], [], color=colour, lw=4) for colour, _ in entries]
    labels = [text for _, text in entries]
    figure.legend(handles, labels, ncols=3, frameon=False, loc="upper left", fontsize=9)
    figure.tight_layout(rect=(0, 0, 1, 0.95))
    save(figure, out)
    plt.close(figure)


def _draw_lane(axes: Any, table: Trace) -> None:
    y = np.arange(len(table))
    for begin, end, colour, _ in STAGES:
        until = table[end]
        if begin == "asked_s":  # never taken: until it was given up, or the end
            until = np.where(np.isnan(until), table[begin] + 0.05, until)
        axes.hlines(y, table[begin], until, color=colour, lw=1.2)
    late = late_ms(table) > LATE_MS
    shown = table[late]
    axes.hlines(y[late] + 0.35, shown["awaited_s"], shown["uploaded_s"], color=LATE, lw=0.7)
    axes.set_ylim(len(table) + 1, -2)
    axes.margins(x=0.01)
    axes.grid(axis="y", visible=False)
