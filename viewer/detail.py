# SPDX-License-Identifier: Apache-2.0
"""How fine the data are that a terrain tile was made of."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.forest import Forest

SHOWN = "terrain", "imagery"
AS_IT_IS_M = 1000.0
"""A picture finer than this is shown as it is, however near: no grain is made up on it."""


def detail_m(forest: Forest, sources: Sequence[dict[str, Any]]) -> NDArray[np.float32]:
    """Return the spacing of the finest source that covers all of each cell.

    A cell beside finer data is smaller than its own data need: its texels show nothing
    of their own then.

    Parameters
    ----------
    forest : of the terrain
    sources : as the store lists them

    Returns
    -------
    spacing_m : (rows,) of posts or of a picture's pixels; 0 where no source is; negative
        where a fine picture covers the cell
    """
    west, south, east, north = np.degrees(cells.bounds_rad(forest.records["cell"]))
    finest, drawn = np.full(len(west), np.inf, np.float32), np.zeros(len(west), np.bool_)
    for source in sources:
        if source["kind"] in SHOWN:
            left, low, right, high = source["bounds_deg"]
            beside = (west - left) % 360 + (east - west) <= right - left
            inside = beside & (south >= low) & (north <= high)
            finest[inside] = np.minimum(finest[inside], source["spacing_m"])
            drawn |= (
                inside & (source["kind"] == "imagery") & (source["spacing_m"] < AS_IT_IS_M)
            )
    finest[np.isinf(finest)] = 0.0
    return np.where(drawn, -finest, finest)
