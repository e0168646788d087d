# SPDX-License-Identifier: Apache-2.0
"""Measure all rows, or some, and write what was found."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from geopage.progress import bar
from tiles.errors import InputError
from viewer.machine import machine, where_measured
from viewer.page import write_document
from viewer.stability import (
    depth,
    flicker,
    floats,
    globe,
    ground,
    hostile,
    lanes,
    lens,
    memory,
    queue,
    seams,
)
from viewer.stability.place import FOCAL_PX, SCREEN_PX, Place
from viewer.stability.row import Row
from viewer.stability.table import Line, as_csv, as_dict, as_html, as_markdown

ROWS: tuple[Row, ...] = (
    *floats.ROWS,
    *depth.ROWS,
    *seams.ROWS,
    *globe.ROWS,
    *flicker.ROWS,
    *memory.ROWS,
    *lanes.ROWS,
    *queue.ROWS,
    *lens.ROWS,
    *ground.ROWS,
    *hostile.ROWS,
)
Json = dict[str, Any]


def chosen(words: Sequence[str]) -> list[Row]:
    """Return the rows whose names hold one of some words; all without words.

    Raises
    ------
    InputError
    """
    found = [row for row in ROWS if not words or any(w in row.name for w in words)]
    if not found:
        names = ", ".join(row.name for row in ROWS)
        raise InputError(
            "--only", f"no row is called so; rows: {names}", "name some of them"
        )
    return found


def stability(store: Path, out: Path, rows: Sequence[Row], *, quick: bool) -> Json:
    """Measure rows and write stability.csv, STABILITY.md and index.html.

    Returns
    -------
    `about`, where it was measured, and `rows`, as in stability.csv

    Raises
    ------
    InputError
    """
    place, lines = Place(store, quick=quick), []
    try:
        about = about_of(place)
        with bar("measuring", len(rows), "rows") as show:
            for row in rows:
                lines.append(Line(row, row.find(place)))
                show(len(lines))
    finally:
        place.close()
    write(out, lines, about)
    return {"about": about, "rows": [as_dict(line) for line in lines]}


def about_of(place: Place) -> Json:
    """Return what the header says."""
    where = machine(place.session.renderer.gl)
    size = f"{SCREEN_PX[0]} x {SCREEN_PX[1]} px, 60 degrees high"
    return {
        **where_measured(where),
        "store": place.store.name,
        "pixels": f"of a picture of {size}: {FOCAL_PX:.0f} px a radian",
        "cases": "fewer than usual (--quick)" if place.quick else "all",
    }


def write(out: Path, lines: Sequence[Line], about: Json) -> None:
    """Write the files.

    Raises
    ------
    InputError
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / "stability.csv").write_text(as_csv(lines, about))
        (out / "STABILITY.md").write_text(as_markdown(lines, about))
        write_document(out, "geopage stability", as_html(lines, about))
    except OSError as error:
        reason = str(error.strerror or error)
        raise InputError(out, reason, "name a folder that can be written") from error
