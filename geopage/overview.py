# SPDX-License-Identifier: Apache-2.0
"""What a store holds, for people and as JSON."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.lanes import Lane
from tiles.store import Store

SHOWN = ("path", "datum", "spacing_m", "width", "height", "crs_name", "stored")


def overview(store: Store) -> dict[str, Any]:
    """Return sources, and a row a lane and level: cells, tiles, bytes, errors."""
    sources = [
        {k: s[k] for k in ("name", "kind", *SHOWN) if k in s} for s in store.sources()
    ]
    lanes = {lane.name.lower(): _levels(store.index(lane)) for lane in Lane}
    return {
        "path": str(store.path),
        "bytes": store.path.stat().st_size,
        "objects": store.object_count(),
        "sources": sources,
        "lanes": lanes,
    }


def _levels(records: NDArray[np.void]) -> list[dict[str, Any]]:
    level = cells.level(records["cell"])
    found = []
    for one in np.unique(level):
        here = records[level == one]
        tiles = here[here["row"] > 0]
        found.append(
            {
                "level": int(one),
                "cells": len(here),
                "tiles": len(tiles),
                "bytes": int(tiles["tile_bytes"].sum()),
                "error_median_m": float(np.median(here["error_m"])),
                "error_max_m": float(here["error_m"].max()),
                "largest_object_m": float(here["own_dimension_m"].max()),
            }
        )
    return found


def overview_lines(found: dict[str, Any]) -> list[str]:
    """Return the overview as text."""
    lines = [f"{found['path']}: {found['bytes'] / 1e6:.1f} MB, {found['objects']} objects"]
    for source in found["sources"]:
        details = ", ".join(f"{k} {source[k]}" for k in ("datum", "path") if k in source)
        spacing = f"{source['spacing_m']:.1f} m, " if "spacing_m" in source else ""
        lines.append(f"  {source['kind']:<9} {source['name']}: {spacing}{details}")
    for lane, levels in found["lanes"].items():
        if levels:
            lines.append(f"{lane}: level, cells, tiles, MB, error median and max m")
        lines += [
            f"  {row['level']:>2} {row['cells']:>7} {row['tiles']:>7}"
            f" {row['bytes'] / 1e6:>8.2f} {row['error_median_m']:>9.2f}"
            f" {row['error_max_m']:>9.2f}"
            for row in levels
        ]
    return lines
