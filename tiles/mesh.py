# SPDX-License-Identifier: Apache-2.0
"""The vertex that both lanes share: 16 bytes, the same on disk and on the GPU."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Ecef, Local

VERTEX = np.dtype(
    [
        ("position", "<i2", 3),  # tile-local, ECEF axes, in units of `scale_m`
        ("flags", "<i2"),  # terrain: SKIRT bit; objects: 0 wall, 1 roof
        ("detail", "<u2", 2),  # terrain: u, v; objects: dm above ground (signed), ordinal
        ("normal", "i1", 4),  # unit normal x 127, ECEF axes; fourth byte: 0
    ]
)
UV_ONE = 32768
"""Value of `detail` at the east or north edge of a terrain tile (0 at west and south)."""
SKIRT = 1
"""Flag of a vertex that the renderer pushes down by the draw's skirt depth."""
WALL, ROOF = 0, 1
STEPS = 32767
"""Positions are stored in steps of (half extent) / STEPS."""


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles of one tile around a float64 centre."""

    centre: Ecef
    """(3,) float64, metres."""
    scale_m: float
    """Metres per position step; half a step times sqrt(3) is the largest rounding error."""
    vertices: NDArray[np.void]
    """(n,) VERTEX"""
    indices: NDArray[np.uint16]
    """(3 t,) uint16, counter-clockwise seen from outside"""

    @property
    def local(self) -> Local:
        """Vertex positions, (n, 3) float64 m around `centre`."""
        return Local(self.vertices["position"].astype(np.float64) * self.scale_m)

    @property
    def gpu_bytes(self) -> int:
        """Bytes that the mesh takes in the arena."""
        return int(self.vertices.nbytes + self.indices.nbytes)


def quantise(local: Local) -> tuple[NDArray[np.int16], float]:
    """Round tile-local metres to 16-bit steps.

    Parameters
    ----------
    local : (n, 3) float64, m

    Returns
    -------
    steps : (n, 3) int16
    scale_m : metres per step
    """
    reach_m = float(np.abs(local).max()) if len(local) else 1.0
    scale_m = max(reach_m, 1e-3) / STEPS
    return np.rint(local / scale_m).astype(np.int16), scale_m
