# SPDX-License-Identifier: Apache-2.0
"""How far a surface is from the triangles between the places where it was sampled.

A source is bent only along its own lines. Where one such line crosses an edge between
two samples, the bends at the two say how far the edge is off: the squares where they are
largest are looked at closely.
"""

from collections.abc import Callable

import numpy as np

from tiles.frames import Floats

SQUARES = 256
"""Squares that are looked at closely"""
EIGHTHS = 8
"""Steps across such a square, each way"""

Surface = Callable[[Floats, Floats], Floats]
"""Heights, (n,) m, at longitudes and latitudes, (n,) rad"""


def missed_between(surface: Surface, lon: Floats, lat: Floats, heights: Floats) -> float:
    """Return how far a surface is from the triangles between its samples, m.

    Parameters
    ----------
    lon, lat, heights : (h, w) samples; lines between them run along parallels and
        meridians, and from each to that in the next row and column

    Returns
    -------
    What was found, and as much more as may lie between two places that were looked at
    """
    worst = bends(heights).ravel()
    most = min(SQUARES, len(worst))
    r, c = np.divmod(np.argpartition(-worst, most - 1)[:most], heights.shape[1] - 1)
    y, x = (one.ravel()[:, None] / EIGHTHS for one in np.indices((EIGHTHS + 1,) * 2))
    weights = 1 - np.maximum(x, y), np.maximum(x - y, 0), np.maximum(y - x, 0)
    there = [
        weights[0] * one[r, c]
        + weights[1] * one[r, c + 1]
        + weights[2] * one[r + 1, c]
        + np.minimum(x, y) * one[r + 1, c + 1]
        for one in (lon, lat, heights)
    ]
    gap_m = surface(there[0].ravel(), there[1].ravel()) - there[2].ravel()
    return float(np.abs(gap_m).max()) * EIGHTHS / (EIGHTHS - 1)


def bends(heights: Floats) -> Floats:
    """Return how far one line that bends the surface may lift it from a square's edges.

    Between two samples where the slope changes by a and b in all (m a step), a line bends
    the surface away from the edge by a b / (a + b).

    Returns
    -------
    (h - 1, w - 1), of each square's four edges and diagonal the largest, m
    """
    rows, cols = _along(heights), _along(heights.T).T
    across = np.full(heights.shape, np.inf)
    across[1:-1, 1:-1] = np.abs(
        heights[:-2, :-2] - 2 * heights[1:-1, 1:-1] + heights[2:, 2:]
    )
    diagonal = _between(across[:-1, :-1], across[1:, 1:])
    found = np.maximum(
        np.maximum(rows[:-1], rows[1:]), np.maximum(cols[:, :-1], cols[:, 1:])
    )
    return np.asarray(np.maximum(found, diagonal))


def _along(heights: Floats) -> Floats:
    """Return the same of the edges along rows, (h, w - 1)."""
    bend = np.full(heights.shape, np.inf)
    bend[:, 1:-1] = np.abs(heights[:, :-2] - 2 * heights[:, 1:-1] + heights[:, 2:])
    return _between(bend[:, :-1], bend[:, 1:])


def _between(a: Floats, b: Floats) -> Floats:
    """Return a b / (a + b); an unknown bend is infinite and leaves the other's."""
    least, most = np.minimum(a, b), np.maximum(a, b)
    part = np.divide(
        least, most, out=np.zeros_like(a), where=(most > 0) & np.isfinite(most)
    )
    return np.asarray(least / (1 + part))
