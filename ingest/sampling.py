# SPDX-License-Identifier: Apache-2.0
"""Heights between posts.

A source's surface is *its own posts joined by triangles*. The diagonal of each square
of posts runs from (row, column) to (row + 1, column + 1), rows counted as in the file:
from north-west to south-east in a north-up raster.
"""

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import kernel

ROUNDING = 1e-6
"""Places this little outside, in posts, count as on the edge."""


@kernel
def triangulated(window: NDArray[np.float32], x: Floats, y: Floats) -> Floats:
    """Interpolate linearly in the triangles of a window of posts.

    Parameters
    ----------
    window : (h, w) float32, NaN where there is no data
    x, y : (n,) float64, column and row of the wanted points in the window

    Returns
    -------
    (n,) float64, NaN outside the posts and where a needed post holds no data
    """
    height, width = window.shape
    out = np.full(len(x), np.nan)
    if not (height and width):
        return out  # a place a rounding outside may have asked for no post at all
    for i in range(len(x)):
        xi, yi = min(max(x[i], 0.0), width - 1.0), min(max(y[i], 0.0), height - 1.0)
        if abs(x[i] - xi) > ROUNDING or abs(y[i] - yi) > ROUNDING:
            continue
        c, r = min(int(xi), max(width - 2, 0)), min(int(yi), max(height - 2, 0))
        c1, r1 = min(c + 1, width - 1), min(r + 1, height - 1)
        fx, fy = xi - c, yi - r
        total = 0.0
        if min(fx, fy) > 0.0:
            total += min(fx, fy) * window[r1, c1]
        if fx > fy:
            total += (fx - fy) * window[r, c1]
        if fy > fx:
            total += (fy - fx) * window[r1, c]
        if max(fx, fy) < 1.0:
            total += (1.0 - max(fx, fy)) * window[r, c]
        out[i] = total
    return out
