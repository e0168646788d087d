# SPDX-License-Identifier: Apache-2.0
"""Which sides of a tile's skirt face the eye: the others need not be drawn.

A skirt is seen where its tile is higher than its neighbour at their edge, or where there
is a gap between the two, and from the neighbour's side only: from its own, the tile hides
it. Which side of an edge the eye is on is judged against the vertical plane through each
of the edge's points, so it can differ along a parallel.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tiles.frames import WGS84_A_M, WGS84_E2, Floats
from tiles.kernels import inlined


@inlined
def faces(
    box_rad: NDArray[np.float64], eye: Floats, lon_rad: float, margin_m: float
) -> int:
    """Return bits of a cell's sides that the eye is outside of, or nearly; `SIDES`.

    Parameters
    ----------
    box_rad : west, south, east, north
    eye : (3,) ECEF m, and its longitude
    margin_m : an eye that is not so far inside of a side counts as outside; of a parallel
        more, because its chords bend aside by more than they sink
    """
    west, south, east, north = box_rad[0], box_rad[1], box_rad[2], box_rad[3]
    axis_m = math.sqrt(eye[0] * eye[0] + eye[1] * eye[1])
    half = (east - west) / 2
    away = abs((lon_rad - west - half + math.pi) % (2 * math.pi) - math.pi)
    near = axis_m * math.cos(max(away - half, 0.0))
    far = axis_m * math.cos(min(away + half, math.pi))
    least, most = max(near, far), min(near, far)
    found = 0
    bent_m = margin_m * max(abs(math.tan(south)), 1.0)
    if -_north_m(south, eye[2], least if south > 0.0 else most) > -bent_m:
        found |= 1
    if axis_m * math.sin(lon_rad - east) > -margin_m:
        found |= 2
    bent_m = margin_m * max(abs(math.tan(north)), 1.0)
    if _north_m(north, eye[2], most if north > 0.0 else least) > -bent_m:
        found |= 4
    if -axis_m * math.sin(lon_rad - west) > -margin_m:
        found |= 8
    return found


@inlined
def _north_m(lat_rad: float, z_m: float, towards_m: float) -> float:
    """Return how far a point is north of the upright plane across a meridian, m.

    Parameters
    ----------
    lat_rad : where the plane stands
    z_m, towards_m : of the point, along the earth's axis and along the meridian's equator
    """
    sine, cosine = math.sin(lat_rad), math.cos(lat_rad)
    centre_m = WGS84_A_M / math.sqrt(1.0 - WGS84_E2 * sine * sine) * WGS84_E2 * sine
    return (z_m + centre_m) * cosine - towards_m * sine
