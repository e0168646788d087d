# SPDX-License-Identifier: Apache-2.0
"""The page of `geopage bench`: chart, table, the worst frames, and what words mean."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from viewer.bench_methods import ABSENT, METHODS
from viewer.bench_score import Worst
from viewer.bench_table import COLUMNS, cell
from viewer.charts import pyplot
from viewer.flip import F4
from viewer.page import write_document
from viewer.picture import write_png

Json = dict[str, Any]
FRAMES = "frames"
"""Folder of the pictures, beside the page"""
AS_IT_IS = -1
SHOWN = (
    ("method", "method", 0),
    ("mode", "mode", 0),
    ("threshold_px", "threshold, px", AS_IT_IS),
    ("frame_p50_ms", "frame p50, ms", 1),
    ("frame_p99_ms", "p99, ms", 1),
    ("floor_p50_ms", "floor p50, ms", 1),
    ("jank_ms", "jank, ms", 0),
    ("triangles", "triangles", 0),
    ("draw_calls", "draws", 0),
    ("objects", "objects", 0),
    ("bytes", "drawn, bytes", 0),
    ("error_p50_px", "error p50, px", 2),
    ("error_p95_px", "p95, px", 2),
    ("error_max_px", "max, px", 2),
    ("share_within_threshold", "within", 4),
    ("psnr_db", "PSNR, dB", 1),
    ("flip_mean", "FLIP", 4),
    ("popping_mean", "popping", 5),
)
"""Columns of results.csv on the page, in words, with decimals"""
WIDE = """<style>body{max-width:1500px}.wide{overflow-x:auto;font-size:.82rem}
.wide td{white-space:nowrap}h3{font-size:1rem;margin:1.2rem 0 .3rem}
.three{display:grid;grid-template-columns:1fr 1fr 1fr;gap:12px}</style>"""
LEAD = (
    "Every method draws the same data with the same renderer. The error that counts is the"
    " distance between the drawn terrain and the sources' own posts; the measures of"
    " pictures stand beside it."
)


@dataclass(frozen=True, slots=True)
class Triple:
    """A frame, its reference and their difference, as files beside the page."""

    files: tuple[str, str, str]
    caption: str


def write_triple(out: Path, row: Json, worst: Worst) -> Triple:
    """Write the three pictures of the worst key frame of a row."""
    method, mode, px = row["method"], row["mode"], f"{row['threshold_px']:g}"
    stem = "_".join((*method.split(), mode, f"{px}px"))
    pictures = worst.rgb, worst.reference, magma(worst.difference, out)
    files = []
    for name, picture in zip(("drawn", "reference", "difference"), pictures, strict=True):
        files.append(f"{FRAMES}/{stem}_{name}.png")
        write_png(out / files[-1], picture)
    caption = f"{method}, {mode}, {px} px, at {worst.t_s:.2f} s: FLIP {worst.flip:.4f}"
    return Triple((files[0], files[1], files[2]), caption)


def magma(difference: F4, out: Path) -> NDArray[np.uint8]:
    """Return FLIP, (h, w) 0..1, in the colours that its authors use, (h, w, 3)."""
    plt = pyplot(out)
    return np.asarray(plt.get_cmap("magma")(difference, bytes=True)[..., :3], np.uint8)


def bench_page(
    out: Path, rows: Sequence[Json], about: Json, triples: Sequence[Triple]
) -> None:
    """Write index.html beside the chart and results.csv."""
    title = f"Speed against accuracy: {about['path']} over {about['store']}"
    head = f"{WIDE}<h1>{escape(title)}</h1><p class=lead>{escape(LEAD)}</p>"
    parts = [
        head,
        _about(about),
        _charts(),
        _methods(rows),
        _table(rows),
        _frames(triples),
        _definitions(),
    ]
    write_document(out, title, parts)


def _charts() -> str:
    shown = [
        f'<a href="{name}"><img src="{name}" alt="Chart: {words}, over frame time,'
        ' triangles and bytes, a curve a method"></a>'
        for name, words in (
            ("chart.svg", "error of the drawn ground"),
            ("pictures.svg", "difference from the finest picture"),
        )
    ]
    return f"<h2>The charts</h2>{''.join(shown)}"


def _about(about: Json) -> str:
    lines = "".join(
        f"<tr><td>{escape(key.replace('_', ' '))}<td>{escape(str(value))}"
        for key, value in about.items()
    )
    return f"<h2>What was measured, and where</h2><table>{lines}</table>"


def _methods(rows: Sequence[Json]) -> str:
    there = {row["method"] for row in rows}
    lines = "".join(
        f"<tr><td>{escape(one.name)}<td>{escape(one.about)}"
        for one in METHODS
        if one.name in there
    )
    return f"<h2>Methods</h2><table>{lines}</table><p class=note>{escape(ABSENT)}</p>"


def _table(rows: Sequence[Json]) -> str:
    shown = [kind for kind in SHOWN if any(kind[0] in row for row in rows)]
    head = "".join(f"<th>{escape(words)}" for _, words, _ in shown)
    body = "".join(
        "<tr>" + "".join(_cell(row.get(name), digits) for name, _, digits in shown)
        for row in rows
    )
    note = 'All columns are in <a href="results.csv">results.csv</a>.'
    return (
        f"<h2>Results</h2><div class=wide><table><tr>{head}{body}</table></div>"
        f"<p class=note>{note} An empty cell was not measured.</p>"
    )


def _cell(value: Any, digits: int) -> str:
    if value is None or isinstance(value, str):
        return f"<td>{escape(value or '')}"
    as_it_is = digits == AS_IT_IS or not np.isfinite(value)
    text = cell(value) if as_it_is else f"{value:,.{digits}f}"
    return f"<td class=n>{text}"


def _frames(triples: Sequence[Triple]) -> str:
    if not triples:
        return ""
    words = ("drawn", "reference", "difference (FLIP: black alike, bright different)")
    parts = [
        f"<h3>{escape(triple.caption)}</h3><div class=three>"
        + "".join(
            f'<figure><a href="{escape(file)}"><img loading=lazy src="{escape(file)}"'
            f' alt="{escape(word)}"></a><figcaption>{escape(word)}</figcaption></figure>'
            for file, word in zip(triple.files, words, strict=True)
        )
        + "</div>"
        for triple in triples
    ]
    lead = (
        "Of each method the key frame that looks least like its reference, at the threshold"
        " next to the default of 2 px and at the coarsest."
    )
    return f"<h2>The worst frames</h2><p class=note>{lead}</p>{''.join(parts)}"


def _definitions() -> str:
    lines = "".join(
        f"<tr><td><code>{escape(one.name)}</code><td>{escape(one.means)}"
        f"<td class=note>{escape(one.source)}"
        for one in COLUMNS
    )
    title = "<h2>What the columns mean</h2>"
    return f"{title}<table><tr><th>column<th>meaning<th>source{lines}</table>"
