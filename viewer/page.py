# SPDX-License-Identifier: Apache-2.0
"""A page that a person can read: pictures, film, figures, charts."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

Json = dict[str, Any]
STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:1100px;margin:2rem auto;padding:0 1rem;
color:#1d2733;background:#fbfbf9}
h1{font-size:2rem;margin:0 0 .3rem}h2{margin:2.2rem 0 .6rem;font-size:1.3rem}
p.lead{font-size:1.1rem;color:#445}
video,img{max-width:100%;border-radius:6px;display:block}
.grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(320px,1fr));gap:12px}
figure{margin:0}figcaption{font-size:.85rem;color:#556;padding:.2rem 0}
table{border-collapse:collapse;margin:.4rem 0}
td,th{padding:.25rem .9rem .25rem 0;text-align:left;vertical-align:top;
border-bottom:1px solid #e3e3de}
td.n{text-align:right;font-variant-numeric:tabular-nums}
.note{font-size:.9rem;color:#556}
"""


@dataclass(frozen=True, slots=True)
class Page:
    """What a page shows; every path is relative to its folder."""

    title: str
    lead: str
    report: Json
    film: str | None = None
    pictures: Sequence[tuple[str, str]] = ()
    """(path, caption)"""
    charts: Sequence[tuple[str, str]] = ()
    sources: Sequence[Json] = field(default_factory=tuple)
    credits: Sequence[str] = ()


def write_page(folder: Path, page: Page) -> None:
    """Write index.html."""
    parts = [
        f"<h1>{escape(page.title)}</h1><p class=lead>{escape(page.lead)}</p>",
        _film(page.film, page.pictures[-1][0] if page.pictures else None),
        _gallery(page.pictures),
        _sources(page.sources),
        figures(page.report),
        *(_chart(*chart) for chart in page.charts),
        _credits(page.credits),
    ]
    write_document(folder, page.title, parts)


def write_document(folder: Path, title: str, parts: Sequence[str]) -> None:
    """Write index.html of parts that are HTML already."""
    head = f"<meta charset=utf-8><title>{escape(title)}</title><style>{STYLE}</style>"
    view = '<meta name=viewport content="width=device-width">'
    body = "\n".join(part for part in parts if part)
    text = (
        f"<!doctype html><html lang=en><head>{head}{view}</head><body>{body}</body></html>"
    )
    (folder / "index.html").write_text(text + "\n")


def _film(path: str | None, still: str | None) -> str:
    if not path:
        return ""
    poster = f' poster="{escape(still)}"' if still else ""
    return f'<video controls muted loop playsinline{poster} src="{escape(path)}"></video>'


def _gallery(pictures: Sequence[tuple[str, str]]) -> str:
    if not pictures:
        return ""
    shown = "".join(
        f'<figure><a href="{escape(path)}"><img loading=lazy src="{escape(path)}" '
        f'alt="{escape(text)}"></a><figcaption>{escape(text)}</figcaption></figure>'
        for path, text in pictures
    )
    return f"<h2>Along the way</h2><div class=grid>{shown}</div>"


def _sources(sources: Sequence[Json]) -> str:
    if not sources:
        return ""
    rows = "".join(
        f"<tr><td>{escape(str(s['name']))}<td>{escape(str(s['kind']))}"
        f"<td>{escape(_about(s))}"
        for s in sources
    )
    return f"<h2>What was ingested</h2><table><tr><th>source<th>kind<th>{rows}</table>"


def _about(source: Json) -> str:
    parts = []
    if "spacing_m" in source:
        parts.append(
            f"{source['width']} x {source['height']}, {source['spacing_m']:,.0f} m apart"
        )
    if "datum" in source:
        parts.append(f"heights above {source['datum']}")
    if "report" in source:
        counts = source["report"]
        parts.append(f"{counts['stored']:,} of {counts['read']:,} footprints stored")
    return "; ".join(parts)


def figures(report: Json) -> str:
    """Return the figures of a report as a table with words."""
    rows = "".join(
        f"<tr><td>{escape(what)}<td class=n>{escape(value)}<td class=note>{escape(why)}"
        for what, value, why in _lines(report)
    )
    machine = report["machine"]
    where = f"{machine['cpu']}, {machine['cores']} cores, {machine['gl_renderer']}"
    title = "<h2>The flight in figures</h2>"
    return f"{title}<table>{rows}</table><p class=note>{escape(where)}</p>"


def _lines(report: Json) -> list[tuple[str, str, str]]:
    error, drawn = report["screen_error_px"], report["drawn"]
    why = "as the selection knows it, weighted by area; not measured on the picture"
    return [
        *_of_frames(report["settings"]["mode"], report["frames"], report["floor"]),
        ("screen error, median", f"{error['p50']:.2f} px", why),
        ("screen error, 95th percentile", f"{error['p95']:.2f} px", ""),
        *_measured(report),
        *_of_bytes(report["memory"], report["io"], report["floor"]),
        ("triangles a frame", f"{drawn['triangles_mean']:,.0f}", "mean"),
        ("where a frame's time goes", _stages(report), "mean (99th percentile)"),
    ]


def _of_frames(mode: str, frames: Json, floor: Json) -> list[tuple[str, str, str]]:
    """Say how long frames took, and what went wrong in how many."""
    mean, sd = f"{frames['mean_ms']:.1f}", f"{frames['sd_ms']:.1f}"
    why = f"floor (same frames, everything resident): {floor['frame_mean_ms']:.1f} ms"
    lines = [
        ("frames", f"{frames['count']}", f"{mode} run"),
        ("frame time, mean ± sd", f"{mean} ± {sd} ms", why),
    ]
    for what, key in (("median", "p50_ms"), ("99th percentile", "p99_ms")):
        took, least = frames[key], floor[f"frame_{key}"]
        why = f"floor {least:.1f} ms, ratio {took / least:.2f}"
        lines.append((f"frame time, {what}", f"{took:.1f} ms", why))
    if "waits" in frames:
        worst = frames["wait_max_ms"]
        why = f"more than 0.5 ms in locks, reads or for the GIL; worst {worst:.2f} ms"
        lines.append(("frames that waited", f"{frames['waits']}", why))
    lines.append(("frames with a hole", f"{frames['holes']}", "pixels or objects missing"))
    why = "a coarser tile drawn while the wanted one is read"
    lines.append(("frames with a stand-in", f"{frames['with_stand_ins']}", why))
    return lines


def _of_bytes(memory: Json, io: Json, floor: Json) -> list[tuple[str, str, str]]:
    """Say how much memory was in use, and how much was read."""
    mib = 2**20
    grew = (memory["rss_peak_bytes"] - memory["rss_before_bytes"]) / mib
    return [
        (
            "memory in use, peak",
            f"{memory['peak_bytes'] / mib:.0f} MiB",
            f"budget {memory['budget_bytes'] / mib:.0f} MiB; the process grew by"
            f" {grew:.0f} MiB",
        ),
        (
            "read",
            f"{io['bytes_read'] / mib:.1f} MiB, {io['tiles_loaded']} tiles",
            f"drawn tiles, each once: {floor['bytes'] / mib:.1f} MiB",
        ),
    ]


def _measured(report: Json) -> list[tuple[str, str, str]]:
    """Say how far the picture was from the sources, where that was measured."""
    error = report.get("geometric_error_px")
    if not error:
        return []
    why = (
        "measured: shortest distances between what was drawn and the sources' own posts,"
        f" both ways, at {len(error['frames'])} frames"
    )
    within = 100 * error["share_within_threshold"]
    judged = 100 * (1 - error["share_not_judged"])
    kept = (
        f"{within:.2f} % of pixels within the threshold or the finest tile's own bound;"
        f" {judged:.0f} % of the earth's pixels are judged, the others show houses or lie"
        " beside a source's rim"
    )
    return [
        ("geometric error, median", f"{error['p50']:.2f} px", why),
        ("geometric error, 95th percentile", f"{error['p95']:.2f} px", kept),
    ]


def _stages(report: Json) -> str:
    spreads = report.get("stages_spread_ms", {})
    return ", ".join(
        f"{name} {value:.1f}"
        + (f" ({spreads[name]['p99']:.1f}) ms" if name in spreads else " ms")
        for name, value in report["stages_ms"].items()
    )


def _chart(path: str, text: str) -> str:
    title = escape(text.split(".", maxsplit=1)[0])
    image = f'<img src="{escape(path)}" alt="{escape(text)}">'
    return f"<h2>{title}</h2>{image}<p class=note>{escape(text)}</p>"


def _credits(lines: Sequence[str]) -> str:
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line)}" for line in lines)
    return f"<h2>Data</h2><ul class=note>{items}</ul>"
