# SPDX-License-Identifier: Apache-2.0
"""Frames as types, and the ellipsoid's constants.

Two frames carry positions, and they never mix without a named conversion:

- `Ecef`: earth-centred, earth-fixed, float64, metres (EPSG:4978).
- `Local`: relative to a tile's float64 centre, axes parallel to ECEF, metres.

What is relative to the eye, float32, is only on its way to the GPU and has no type.
Geographic angles are radians, longitude before latitude before height; heights are
metres above the WGS84 ellipsoid.
"""

from typing import NewType

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

Ecef = NewType("Ecef", NDArray[np.float64])
Local = NewType("Local", NDArray[np.float64])

WGS84_A_M = 6378137.0
WGS84_F = 1.0 / 298.257223563
WGS84_B_M = WGS84_A_M * (1.0 - WGS84_F)
WGS84_E2 = WGS84_F * (2.0 - WGS84_F)
