# SPDX-License-Identifier: Apache-2.0
"""Colours as the store keeps them: 1 to 255 in each band, and 0, 0, 0 for transparent."""

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.windows import Window

from tiles.kernels import kernel

OPAQUE = 128
"""Least alpha of a texel that is painted."""


def read_colours(dataset: rasterio.DatasetReader, window: Window) -> NDArray[np.uint8]:
    """Read a part of a picture.

    What the file says is transparent, in whatever way, is 0, 0, 0: an alpha band, nodata
    values, a mask in the file or beside it.

    Returns
    -------
    (h, w, 3) uint8
    """
    colours = np.maximum(dataset.read([1, 2, 3], window=window), 1)
    colours *= dataset.dataset_mask(window=window) >= OPAQUE
    return np.ascontiguousarray(np.moveaxis(colours, 0, -1))


@kernel
def halve_colours(finer: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Average 2 x 2 texels; where some are transparent, the others."""
    out = np.zeros((finer.shape[0] // 2, finer.shape[1] // 2, 3), np.uint8)
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            for k in range(3):
                total, known = 0, 0
                for y in range(2 * r, 2 * r + 2):
                    for x in range(2 * c, 2 * c + 2):
                        total += finer[y, x, k]
                        known += finer[y, x, k] > 0
                if known:
                    out[r, c, k] = (total + known // 2) // known
    return out
