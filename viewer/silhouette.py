# SPDX-License-Identifier: Apache-2.0
"""How far silhouettes of the drawn terrain are from those of the reference.

A pixel shows another side of a silhouette than the reference when no pixel around it,
itself included, has a depth like its own there (sky is as deep as can be). How far away
the nearest such pixel is, is how far the silhouette was moved.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import kernel

LIKE = 0.02
"""Depths that differ by less than this share are alike."""
FARTHEST_PX = 16
PIXEL = 1.5
"""Displacements are between pixels' middles, corner to corner."""


@dataclass(frozen=True, slots=True)
class Silhouette:
    """Displaced silhouettes of one frame."""

    compared: int
    """Pixels that show terrain in either picture and that could be compared"""
    moved_px: Floats
    """(k,) displacement of each pixel on another side, FARTHEST_PX at most"""
    beyond_px: Floats
    """(m,) those of them that moved by a pixel more than the error allowed there"""


def silhouette(
    drawn_m: Floats, reference_m: Floats, blind: NDArray[np.bool_], allowed_px: Floats
) -> Silhouette:
    """Compare the depths of two pictures, (h, w) m, inf where sky.

    Parameters
    ----------
    blind : pixels where one of the two is not known; they are not compared
    allowed_px : error that the threshold or a leaf allows in each pixel
    """
    there = _moved(drawn_m, reference_m, blind)
    back = _moved(reference_m, drawn_m, blind)
    moved = np.where(blind, 0.0, np.maximum(there, back))
    beyond = (moved > 0) & (moved > allowed_px + PIXEL)
    shown = (np.isfinite(drawn_m) | np.isfinite(reference_m)) & ~blind
    return Silhouette(int(shown.sum()), moved[moved > 0], moved[beyond])


@kernel
def _moved(a: Floats, b: Floats, blind: NDArray[np.bool_]) -> Floats:
    """Return for each pixel of `a` how far the nearest like depth in `b` is, 0 if beside.

    A pixel beside a blind one, or beside the picture's edge, may have its like there.
    """
    height, width = a.shape
    out = np.zeros((height, width))
    for row in range(height):
        for col in range(width):
            if blind[row, col]:
                continue
            best = math.inf
            for ring in range(FARTHEST_PX + 1):
                if ring > 1 and ring - 1 >= best:
                    break
                best = min(best, _in_ring(a[row, col], b, blind, (row, col), ring))
                if ring == 1 and best < math.inf:
                    break
            out[row, col] = 0.0 if best < 2.0 else min(best, FARTHEST_PX)
    return out


@kernel
def _in_ring(
    depth: float, b: Floats, blind: NDArray[np.bool_], at: tuple[int, int], ring: int
) -> float:
    """Return the distance to the nearest like depth in a square ring of pixels."""
    best = math.inf
    low, high = math.inf, -math.inf
    for row in range(at[0] - ring, at[0] + ring + 1):
        edge = abs(row - at[0]) == ring
        step = 1 if edge or ring == 0 else 2 * ring
        for col in range(at[1] - ring, at[1] + ring + 1, step):
            away = math.hypot(row - at[0], col - at[1])
            if not (0 <= row < b.shape[0] and 0 <= col < b.shape[1]) or blind[row, col]:
                best = min(best, away)
                continue
            low, high = min(low, b[row, col]), max(high, b[row, col])
            if _alike(depth, b[row, col]):
                best = min(best, away)
    if ring == 1 and low * (1.0 - LIKE) <= depth <= high * (1.0 + LIKE):
        return 1.0
    return best


@kernel
def _alike(a: float, b: float) -> bool:
    if math.isinf(a) or math.isinf(b):
        return math.isinf(a) and math.isinf(b)
    return abs(a - b) <= LIKE * min(a, b)
