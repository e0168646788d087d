# SPDX-License-Identifier: Apache-2.0
"""Writes what was found: experiments.csv, EXPERIMENTS.md, index.html."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from tiles.errors import InputError
from viewer.experiments.rows import Chart, Found, Row
from viewer.files import csv_text
from viewer.page import write_document

Json = dict[str, Any]
HEAD = (
    "experiment",
    "condition",
    "quantity",
    "unit",
    "paper",
    "source",
    "ours",
    "against the paper",
    "depends on the machine",
    "note",
)
LEAD = (
    "Paper and ours side by side. Times of 1990s machines do not compare with ours: their"
    " ratios do. *Better* and *worse* say how geopage stands against the paper; *differs*"
    " stands where the paper's own method, run again, comes to something else; within a"
    " tenth is *alike*. An empty place was not given by the paper or does not compare; a"
    " dash could not be had here."
    " Rows marked † depend on this machine's speed; all others are the same in every run."
)
WIDE = (
    "<style>body{max-width:1300px}.worse,.differs{color:#a33e00}.note{max-width:26rem}"
    "</style>"
)
VERDICTS = ("better", "alike", "worse", "differs")
MARK, DASH = "†", "-"


@dataclass(frozen=True, slots=True)
class Part:
    """One experiment with what it found."""

    key: str
    title: str
    paper: str
    about: str
    found: Found


def number(value: float | None, missing: str = "") -> str:
    """Return a value as people read it: four digits, thousands apart."""
    if value is None:
        return missing
    if abs(value) >= 1e4:
        return f"{value:,.0f}"
    return f"{value:.4g}"


def as_csv(parts: Sequence[Part], about: Json) -> str:
    """Return experiments.csv: comment lines that say where, then the table."""
    table = []
    for part in parts:
        for row in part.found.rows:
            values = ["" if v is None else f"{v:.6g}" for v in (row.paper, row.ours)]
            told = row.experiment, row.condition, row.quantity, row.unit
            ending = row.against, "yes" if row.timed else "", row.note
            table.append([*told, values[0], row.source, values[1], *ending])
    return csv_text(about, HEAD, table)


def counted(rows: Sequence[Row]) -> str:
    """Say how often ours stands how against the paper, and what could not be had."""
    count = Counter(row.against for row in rows if row.against)
    words = [f"{count[word]} {word}" for word in VERDICTS if count[word]]
    none = sum(row.ours is None for row in rows)
    told = f"Rows that compare: {', '.join(words)}. " if words else "No row compares. "
    return (told + (f"{none} could not be had here." if none else "")).strip()


def as_markdown(parts: Sequence[Part], about: Json) -> str:
    """Return EXPERIMENTS.md."""
    lines = ["# The experiments of the literature, run again", ""]
    lines += [f"Made by `{about['command']}`; changes by hand are lost.", ""]
    lines += [f"- {key.replace('_', ' ')}: {value}" for key, value in about.items()]
    lines += ["", LEAD]
    for part in parts:
        rows = part.found.rows
        lines += ["", f"## {part.key}: {part.title}", "", f"{part.paper}. {part.about}", ""]
        lines += [*(f"- {text}" for text in part.found.says), "", counted(rows), ""]
        lines += ["| condition | quantity | paper | ours | | note |"]
        lines += ["| --- | --- | ---: | ---: | --- | --- |"]
        lines += [
            _line(row, before) for before, row in zip([None, *rows], rows, strict=False)
        ]
    return "\n".join(lines) + "\n"


def _line(row: Row, before: Row | None) -> str:
    same = before is not None and before.condition == row.condition
    paper = number(row.paper)
    note = "; ".join(part for part in (row.note, row.source) if part)
    unit = f", {row.unit}" if row.unit else ""
    mark = f" {MARK}" if row.timed else ""
    told = ("" if same else row.condition), f"{row.quantity}{unit}{mark}", paper
    found = number(row.ours, DASH), row.against, note
    return "| " + " | ".join(text.replace("|", "/") for text in (*told, *found)) + " |"


def as_page(
    out: Path,
    parts: Sequence[Part],
    charts: dict[str, list[tuple[Chart, Path]]],
    about: Json,
) -> None:
    """Write index.html beside the charts."""
    title = "The experiments of the literature, run again"
    lines = "".join(
        f"<tr><td>{escape(key.replace('_', ' '))}<td>{escape(str(value))}"
        for key, value in about.items()
    )
    lead = escape(LEAD.replace("*", ""))
    head = f"{WIDE}<h1>{title}</h1><p class=lead>{lead}</p><table>{lines}</table>"
    body = [head]
    for part in parts:
        says = "".join(f"<p>{escape(text)}</p>" for text in part.found.says)
        shown = "".join(
            f'<figure><img loading=lazy src="{path.name}" alt="{escape(chart.title)}">'
            "</figure>"
            for chart, path in charts.get(part.key, [])
        )
        body.append(
            f"<h2>{part.key}: {escape(part.title)}</h2><p>{escape(part.paper)}."
            f" {escape(part.about)}</p>{says}<p>{escape(counted(part.found.rows))}</p>"
            f"{shown}{_table(part.found.rows)}"
        )
    note = (
        '<p class=note>All rows are in <a href="experiments.csv">experiments.csv</a>.</p>'
    )
    write_document(out, title, [*body, note])


def _table(rows: Sequence[Row]) -> str:
    body = ""
    for before, row in zip([None, *rows], rows, strict=False):
        same = before is not None and before.condition == row.condition
        unit = f", {row.unit}" if row.unit else ""
        mark = f" {MARK}" if row.timed else ""
        body += (
            f"<tr><td>{'' if same else escape(row.condition)}"
            f"<td>{escape(row.quantity + unit + mark)}"
            f"<td class=n>{number(row.paper)}<td class=n>{number(row.ours, DASH)}"
            f"<td class={row.against or 'none'}>{row.against}"
            f"<td class=note>{escape('; '.join(t for t in (row.note, row.source) if t))}"
        )
    head = "<tr><th>condition<th>quantity<th>paper<th>ours<th><th>note, source"
    return f"<details open><summary>Table</summary><table>{head}{body}</table></details>"


def write(
    out: Path,
    parts: Sequence[Part],
    charts: dict[str, list[tuple[Chart, Path]]],
    about: Json,
) -> None:
    """Write all three.

    Raises
    ------
    InputError
    """
    try:
        (out / "experiments.csv").write_text(as_csv(parts, about))
        (out / "EXPERIMENTS.md").write_text(as_markdown(parts, about))
        as_page(out, parts, charts, about)
    except OSError as error:
        reason = str(error.strerror or error)
        raise InputError(out, reason, "name a folder that can be written") from error
