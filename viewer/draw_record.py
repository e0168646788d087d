# SPDX-License-Identifier: Apache-2.0
"""What the vertex shader knows of a draw: its record in the instance array, of 20 floats.

    0..2 rest of centre - eye (m)            3 metres per position step
    4..6 up at the tile's centre             7 skirt depth (m)
    8..10 place in the grain of the ground (terrain)
    8 seed; 9, 10 share of the screen's pattern that shows it, from and to (objects)
    11 texture layer (terrain); place of the first own object in the pool, or the
       palette's entry of the proxy (objects)
    12 entry in the draw list
    13 screen error (px)                     14 lean of the skirt (viewer/clearance.py)
    15 texels across what the data show (terrain)
    16..18 whole steps of centre - eye       19 unused

A vertex is at (whole steps + its step) * metres per step + rest. The sum in brackets is
an integer, exact in float32 and small near the eye, so a vertex near the eye is rounded
by its own distance and not by the distance of its tile's centre.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tiles.frames import WGS84_A_M, WGS84_B_M, Floats
from tiles.kernels import inlined

INSTANCE_FLOATS = 20
EXACT = 2.0**24
"""float32 holds all integers up to here: tiles are not farther away than 512 radii."""
STRETCH = WGS84_A_M / WGS84_B_M


@inlined
def put_place(
    instance: NDArray[np.float32], offset_m: tuple[float, float, float], scale_m: float
) -> None:
    """Write where a tile is, split on its own grid of steps; all is rest when far away.

    Parameters
    ----------
    offset_m : centre - eye, ECEF m, made in float64
    scale_m : metres per position step
    """
    per_m = 1.0 / scale_m if scale_m > 0.0 else 0.0
    for i in range(3):
        steps = np.rint(offset_m[i] * per_m)
        if not abs(steps) < EXACT:
            steps = 0.0
        instance[i] = offset_m[i] - steps * scale_m
        instance[16 + i] = steps
    instance[3] = scale_m


@inlined
def fill(
    instance: NDArray[np.float32], slot: np.void, eye: Floats, entry: int, error_px: float
) -> None:
    """Write what terrain and objects have in common.

    Parameters
    ----------
    eye : (3,) ECEF m
    entry : in the draw list
    """
    x, y, z = slot["centre"][0], slot["centre"][1], slot["centre"][2]
    scale_m = float(slot["scale_m"])
    put_place(instance, (x - eye[0], y - eye[1], z - eye[2]), scale_m)
    z = z * STRETCH * STRETCH
    length = max(math.sqrt(x * x + y * y + z * z), 1.0)
    instance[4] = x / length
    instance[5] = y / length
    instance[6] = z / length
    instance[12] = entry
    instance[13] = error_px
