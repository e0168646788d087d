# SPDX-License-Identifier: Apache-2.0
"""What a store holds, for people and as JSON."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.check import ROUNDING, bounds_m
from tiles.codec import read_header
from tiles.errors import TileFault
from tiles.lanes import Lane
from tiles.store import Store

RASTER = "path", "datum", "spacing_m", "reach_m", "meets", "width", "height", "crs_name"
SHOWN = (*RASTER, "stored")
SAMPLE = 256
"""Of a level with more tiles, so many are read for their triangles, spread evenly."""
WIDTHS = (14, 7, 7, 10, 8, 8, 10, 9)
FREE = "freelist_count", "page_size"
TITLES = ("cells", "tiles", "triangles", "MB", "bound m", "error p50", "max")


def overview(store: Store) -> dict[str, Any]:
    """Return sources, and a row a lane and level.

    Of the cells: `bound_m` (the median of edge / 256, terrain only), and the measured
    `error_median_m` and `error_max_m`; `over_bound` counts cells with a larger error. Of
    the tiles: `bytes`, and `triangles` without skirts, estimated from the `tiles_read`.
    """
    sources = [_source(one) for one in store.sources()]
    lanes = {lane.name.lower(): _levels(store, lane) for lane in Lane}
    return {
        "path": str(store.path),
        "bytes": store.path.stat().st_size,
        "free_bytes": _free_bytes(store),
        "objects": store.object_count(),
        "objects_per_cell": _objects_per_cell(store),
        "sources": sources,
        "lanes": lanes,
    }


def _free_bytes(store: Store) -> int:
    """Return how much of the file the next ingest will use again."""
    counts = (store.connection.execute(f"PRAGMA {name}").fetchone()[0] for name in FREE)
    return math.prod(int(count) for count in counts)


def _objects_per_cell(store: Store) -> dict[str, float]:
    """Return the spread of the number of objects in the cells that hold any."""
    held = store.connection.execute("SELECT COUNT(*) FROM object GROUP BY cell").fetchall()
    count = np.array(held, np.int64).ravel()
    if not len(count):
        return {}
    median, p90 = np.percentile(count, (50, 90), method="nearest").tolist()
    return {"median": median, "p90": p90, "max": int(count.max())}


def _source(details: dict[str, Any]) -> dict[str, Any]:
    """Return what is shown of a source; a raster's CRS is too long a text for it."""
    shown = {k: details[k] for k in ("name", "kind", *SHOWN) if k in details}
    if details["kind"] == "buildings":
        shown |= {k: details[k] for k in ("files", "crs") if k in details}
        shown["stored"] = details["report"]["stored"]
    return shown


def _levels(store: Store, lane: Lane) -> list[dict[str, Any]]:
    records = store.index(lane)
    level = cells.level(records["cell"])
    return [_row(store, lane, int(one), records[level == one]) for one in np.unique(level)]


def _row(store: Store, lane: Lane, level: int, here: NDArray[np.void]) -> dict[str, Any]:
    tiles = here[here["row"] > 0]
    found = {
        "level": level,
        "cells": len(here),
        "tiles": len(tiles),
        **_triangles(store, lane, tiles["row"]),
        "bytes": int(tiles["tile_bytes"].sum()),
        "error_median_m": float(np.median(here["error_m"])),
        "error_max_m": float(here["error_m"].max()),
        "largest_object_m": float(here["own_dimension_m"].max()),
    }
    if lane is Lane.TERRAIN:
        bound_m = bounds_m(here)
        found["bound_m"] = float(np.median(bound_m))
        found["over_bound"] = int((here["error_m"] > bound_m * (1 + ROUNDING)).sum())
    return found


def _triangles(store: Store, lane: Lane, rows: NDArray[np.int32]) -> dict[str, int]:
    """Count the triangles of a level's tiles, skirts apart, from at most SAMPLE of them."""
    picked = rows[np.linspace(0, len(rows) - 1, min(len(rows), SAMPLE)).astype(int)]
    field = "surface_index_count" if lane is Lane.TERRAIN else "index_count"
    counts = []
    for row in picked.tolist():
        try:
            counts.append(int(read_header(lane, store.body(row))[field]) // 3)
        except TileFault:  # `geopage check` names it
            continue
    total = round(sum(counts) / len(counts) * len(rows)) if counts else 0
    return {"triangles": total, "tiles_read": len(counts)}


def overview_lines(found: dict[str, Any]) -> list[str]:
    """Return the overview as text."""
    lines = [f"{found['path']}: {found['bytes'] / 1e6:.1f} MB, {found['objects']} objects"]
    if found["free_bytes"] > found["bytes"] / 10:
        lines[0] += f", {found['free_bytes'] / 1e6:.1f} MB of it free for the next ingest"
    if spread := found["objects_per_cell"]:
        lines[0] += " ({median} a cell, median; at most {max})".format(**spread)
    for source in found["sources"]:
        shown = ("stored", "crs", "datum", "path", "files")
        details = ", ".join(f"{k} {_words(source[k])}" for k in shown if k in source)
        spacing = f"{source['spacing_m']:.1f} m, " if "spacing_m" in source else ""
        if source.get("reach_m") and "meets" in source:
            met = source["meets"] or "sea level"
            spacing += f"meets {met} over {source['reach_m'] / 1000:.3g} km, "
        lines.append(f"  {source['kind']:<9} {source['name']}: {spacing}{details}")
    for lane, levels in found["lanes"].items():
        if levels:
            lines.append(_columns(f"{lane}: level", *TITLES))
        lines += [_line(row) for row in levels]
        if over := sum(row.get("over_bound", 0) for row in levels):
            lines.append(f"!: {over} cells state a larger error than their bound")
    return lines


def _words(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _line(row: dict[str, Any]) -> str:
    estimated = "~" if row["tiles_read"] < row["tiles"] else ""
    return _columns(
        row["level"],
        row["cells"],
        row["tiles"],
        f"{estimated}{row['triangles']}",
        f"{row['bytes'] / 1e6:.2f}",
        f"{row['bound_m']:.2f}" if "bound_m" in row else "",
        f"{row['error_median_m']:.2f}",
        f"{row['error_max_m']:.2f}" + "!" * (row.get("over_bound", 0) > 0),
    )


def _columns(*words: object) -> str:
    return " ".join(f"{w!s:>{n}}" for w, n in zip(words, WIDTHS, strict=True))
