# SPDX-License-Identifier: Apache-2.0
"""The screen error that the selection knows, pixel by pixel of a replayed frame.

Each terrain pixel shows a tile whose measured error is known in metres; at the pixel's
depth that is so many pixels. This is what the selection knows, not a measurement of the
picture: a tile may be better than its largest error nearly everywhere.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.view import ViewState
from tiles.forest import Forest
from tiles.index_tree import drawn_errors_m


@dataclass(frozen=True, slots=True)
class PixelError:
    """One frame's screen error."""

    mean_px: float
    """Mean over the terrain's pixels"""
    kept: float
    """Share of terrain pixels within the threshold, or of a leaf: nothing finer exists"""


def pixel_error(
    forest: Forest,
    drawn: DrawList,
    view: ViewState,
    ids: NDArray[np.int32],
    distance_m: NDArray[np.float32],
) -> PixelError:
    """Return the screen error of a frame.

    Parameters
    ----------
    ids, distance_m : (h, w) of the frame, coarse or not: 1 + entry of the draw list for
        terrain, and the distance from the eye
    """
    terrain = ids > 0
    if not terrain.any():
        return PixelError(0.0, 1.0)
    entries = ids[terrain] - 1
    records = forest.records[drawn.terrain[entries]]
    error_m = drawn_errors_m(records, drawn.rungs()[entries])
    error_m = np.maximum(error_m, records["texel_m"])
    depth_m = distance_m[terrain] * _cosines(view, ids.shape)[terrain]
    error_px = error_m * view.focal_px / np.maximum(depth_m, 1e-3)
    kept = (error_px <= drawn.threshold_px) | (records["children"] == 0)
    return PixelError(float(error_px.mean()), float(kept.mean()))


def _cosines(view: ViewState, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Cosine of each pixel's ray with the view axis, for a picture of any fineness."""
    x = ((np.arange(shape[1]) + 0.5) / shape[1] - 0.5) * view.width_px / view.focal_px
    y = ((np.arange(shape[0]) + 0.5) / shape[0] - 0.5) * view.height_px / view.focal_px
    return np.asarray(1.0 / np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2))
