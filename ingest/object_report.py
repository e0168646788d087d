# SPDX-License-Identifier: Apache-2.0
"""What an objects lane is like: cells, tiles, proxies, bytes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Ints
from tiles.index_tree import INDEX


def lane_report(cell: Ints, index: NDArray[np.void]) -> dict[str, Any]:
    """Describe an objects lane.

    Parameters
    ----------
    cell : (n,) cell of each object
    index : (c,) INDEX
    """
    count = len(cell)
    proxied = index["proxy_dimension_m"] > 0
    return {
        "objects": count,
        "objects_per_cell": objects_per_cell(cell),
        "cells": len(index),
        "tiles": int(np.count_nonzero(index["row"])),
        "tile_bytes": int(index["tile_bytes"].sum()),
        "index_bytes_per_building": round(len(index) * INDEX.itemsize / max(count, 1), 2),
        "cells_with_proxies_below": int(proxied.sum()),
        "proxy_error_m": float(index["error_m"].max(initial=0.0)),
        "warnings": [],
    }


def objects_per_cell(cell: Ints) -> dict[str, float]:
    """Say how many objects a cell holds: mean, median, 90th percentile, most."""
    _, held = np.unique(cell, return_counts=True)
    if not len(held):
        return {"mean": 0.0, "median": 0.0, "p90": 0.0, "max": 0.0}
    return {
        "mean": round(float(held.mean()), 1),
        "median": float(np.median(held)),
        "p90": round(float(np.percentile(held, 90)), 1),
        "max": float(held.max()),
    }
