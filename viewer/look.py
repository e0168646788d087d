# SPDX-License-Identifier: Apache-2.0
"""Sun, light and air of a frame, as the numbers that the shaders take."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.view import ViewState
from tiles import geodesy
from tiles.frames import WGS84_A_M, WGS84_B_M, Floats
from viewer import air
from viewer.camera import near_m

SUN_ENU = np.array((-0.5, 0.5, math.sqrt(0.5)))
"""From the north-west, 45 degrees high: the light of the relief in the textures."""
AXES_M = np.array((WGS84_A_M, WGS84_A_M, WGS84_B_M))
FRAME_ROWS = 15
HEIGHT = 15
"""Where the frame block holds the eye's height, m."""


HIGH_M = 30_000.0
"""Above this height the shaders' HIGH variants draw."""


@dataclass(frozen=True, slots=True)
class Look:
    """How the world is lit; the defaults are for people, `PLAIN` is for tests."""

    sun: NDArray[np.float64] | None = None
    """(3,) ECEF unit vector; by default it keeps its place in the eye's sky."""
    night_light: float = 0.16
    haze: float = 0.75
    """1 is clear air of one scale height of 8 km."""
    grain: float = 1.0
    light: float = 1.12


PLAIN = Look(night_light=1.0, haze=0.0, grain=0.0, light=1.0)
"""Terrain textures come out as they are."""


def frame_block(view: ViewState, look: Look, supersample: float = 1) -> NDArray[np.float32]:
    """Return the frame block of `frame.glsl`, (FRAME_ROWS * 4,) float32."""
    lon, lat, height_m = geodesy.to_geodetic(view.eye)
    axes: Floats = geodesy.enu_axes(lon, lat)
    sun = axes.T @ SUN_ENU if look.sun is None else look.sun
    block = np.zeros((FRAME_ROWS, 4))
    block[:3, :3] = view.rotation
    block[0, 3] = 2.0 * view.focal_px / view.width_px
    block[1, 3] = 2.0 * view.focal_px / view.height_px
    block[2, 3] = near_m(view)
    block[3, :3] = view.eye / AXES_M
    block[3, 3] = max(float(height_m), 0.0)
    block[4] = *sun, look.night_light
    block[5] = *axes[2], look.haze
    size = view.width_px * supersample, view.height_px * supersample
    block[6] = *size, look.grain, look.light
    rise = float(sun @ axes[2])
    block[7] = *air.sunlight(rise, look.night_light), rise
    block[8:14, :3] = air.skylight(rise, look.night_light).reshape(6, 3)
    block[8:11, 3] = view.rotation @ sun
    block[11:14, 3] = *air.densities(block[3, 3]), np.linalg.norm(block[3, :3])
    block[14, :3] = view.rotation @ axes[2]
    return block.astype(np.float32).ravel()
