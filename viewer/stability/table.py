# SPDX-License-Identifier: Apache-2.0
"""The stability table as a file of figures, as a page and as a document."""

import math
from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

from viewer.files import csv_text
from viewer.stability.row import Finding, Row

Json = dict[str, Any]


class Line(NamedTuple):
    """A row with what was found."""

    row: Row
    found: Finding


COLUMNS = (
    "name",
    "fails_in_others",
    "stress",
    "practical",
    "breaks_at",
    "looked_to",
    "margin",
    "measure",
    "allowed",
    "ours",
    "others",
    "verdict",
    "note",
)
HEAD = (
    "what may fail",
    "what is made harder",
    "worst practical case",
    "we fail from",
    "margin",
    "what is measured",
    "allowed",
    "ours",
    "others",
    "",
)
LEAD = (
    "Each line is one way in which viewers of terrain and cities fail. One thing is made"
    " harder until geopage stops being right. The *margin* says how many times harder than"
    " the worst practical case that is; “no limit found” that it did not fail as far as"
    " was looked. *Ours* and *others* are measured in the worst practical case, the latter"
    " with the method that is known to fail there. All figures were measured by this run."
)


def as_dict(line: Line) -> Json:
    """Return a line, JSON-ready; what was not measured is None."""
    row, found = line
    figures = {name: getattr(found, name) for name in FIGURES}
    margin = row.margin(found)
    return {
        "name": row.name,
        "fails_in_others": row.fails,
        "stress": row.stress,
        "measure": row.measure,
        "allowed": row.allowed,
        **{k: None if math.isnan(v) else v for k, v in figures.items()},
        "margin": None if math.isnan(found.breaks_at) else margin,
        "verdict": row.verdict(found),
        "note": found.note,
    }


FIGURES = ("practical", "breaks_at", "looked_to", "ours", "others")


def as_csv(lines: Sequence[Line], about: Json) -> str:
    """Return stability.csv: comment lines that say where it was measured, the table."""
    dicts = map(as_dict, lines)
    return csv_text(about, COLUMNS, ([plain(one[key]) for key in COLUMNS] for one in dicts))


def plain(value: Any) -> str:
    """Return a value as text with as many digits as it is worth."""
    return (
        "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
    )


def short(value: float) -> str:
    """Return a number for people: three digits, thousands apart."""
    if math.isnan(value):
        return ""
    if value and not 1e-3 <= abs(value) < 1e7:
        return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")
    digits = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
    text = f"{value:,.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def cells_of(line: Line) -> list[str]:
    """Return what the page and the document show of a line."""
    row, found = line
    broke = not math.isnan(found.breaks_at)
    return [
        row.name,
        row.stress,
        short(found.practical),
        short(found.breaks_at) if broke else f"not up to {short(found.looked_to)}",
        f"{short(row.margin(found))} x" if broke else "no limit found",
        row.measure,
        short(row.allowed),
        short(found.ours),
        short(found.others),
        row.verdict(found),
    ]


def as_markdown(lines: Sequence[Line], about: Json) -> str:
    """Return STABILITY.md."""
    command = "`geopage stability --out DIR` wrote this file: don't edit it."
    parts = [
        "# Where methods fail, and how far geopage is from it",
        command,
        LEAD,
        "\n".join(f"- {key.replace('_', ' ')}: {value}" for key, value in about.items()),
        "\n".join(["| " + " | ".join(row) + " |" for row in _table(lines)]),
        "## What fails in others, and notes",
        "\n".join(f"- **{names}**: {words}" for words, names in _remarks(lines).items()),
    ]
    return "\n\n".join(parts) + "\n"


def _remarks(lines: Sequence[Line]) -> dict[str, str]:
    """Return what is said of rows, and which rows it is said of."""
    found: dict[str, str] = {}
    for row, finding in lines:
        words = _remark(row, finding)
        found[words] = f"{found[words]}; {row.name}" if words in found else row.name
    return found


def _table(lines: Sequence[Line]) -> list[Sequence[str]]:
    return [HEAD, ["---"] * len(HEAD), *(cells_of(line) for line in lines)]


def _remark(row: Row, found: Finding) -> str:
    return f"{row.fails}." + (f" Here: {found.note}." if found.note else "")


def as_html(lines: Sequence[Line], about: Json) -> list[str]:
    """Return the parts of index.html."""
    where = "".join(
        f"<tr><td>{escape(key.replace('_', ' '))}<td>{escape(str(value))}"
        for key, value in about.items()
    )
    head = "".join(f"<th>{escape(word)}" for word in HEAD)
    body = "".join(f"<tr>{_line(line)}" for line in lines)
    title = "Where methods fail, and how far geopage is from it"
    return [
        f"{WIDE}<h1>{title}</h1><p class=lead>{escape(LEAD).replace('*', '')}</p>",
        f"<table>{where}</table>",
        f"<h2>The table</h2><div class=wide><table><tr>{head}{body}</table></div>",
        '<p class=note>All figures are in <a href="stability.csv">stability.csv</a>.</p>',
    ]


def _line(line: Line) -> str:
    row, found = line
    cells = cells_of(line)
    remark = f"<div class=note>{escape(_remark(row, found))}</div>"
    shown = [f"<td>{escape(cells[0])}{remark}", f"<td>{escape(cells[1])}"]
    shown += [f"<td class=n>{escape(cell)}" for cell in cells[2:5]]
    shown += [f"<td>{escape(cells[5])}"]
    shown += [f"<td class=n>{escape(cell)}" for cell in cells[6:9]]
    return "".join(shown) + f'<td class="{cells[9]}">{cells[9]}'


WIDE = """<style>body{max-width:1500px}.wide{overflow-x:auto;font-size:.85rem}
.FAILS{color:#a30;font-weight:700}.holds{color:#061}th{vertical-align:bottom}
.note{max-width:34rem}</style>"""
