# SPDX-License-Identifier: Apache-2.0
"""Noise for the grain of the ground: a small tile that repeats without a seam."""

import numpy as np
from numpy.typing import NDArray

from viewer import gl
from viewer.gl import Gl

SIDE = 256
SPREAD = 0.16
"""Standard deviation of the noise around 0.5."""
CYCLES = (4.0, 64.0)
"""Waves across the tile: none shorter than 4 texels, so two texels a pixel are safe."""


def noise_tile(side: int = SIDE) -> NDArray[np.uint8]:
    """Return isotropic noise of equal strength in every octave.

    Returns
    -------
    noise : (side, side, 2) uint8, two independent channels around 127.5
    """
    white = np.random.default_rng(11).normal(size=(2, side, side))
    cycles = np.hypot(*np.meshgrid(*[np.fft.fftfreq(side, 1 / side)] * 2))
    passed = (cycles >= CYCLES[0]) & (cycles <= CYCLES[1])
    strength = np.where(passed, 1.0 / np.maximum(cycles, 1.0), 0.0)
    noise = np.fft.ifft2(np.fft.fft2(white) * strength).real
    noise *= SPREAD / noise.std(axis=(1, 2), keepdims=True)
    return np.rint(np.clip(noise + 0.5, 0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)


def make_texture(calls: Gl) -> int:
    """Return the name of a texture of the noise."""
    noise = np.ascontiguousarray(noise_tile())
    name = calls.create("glCreateTextures", gl.TEXTURE_2D)
    calls.call("glTextureStorage2D", name, 1, gl.RG8, SIDE, SIDE)
    place = name, 0, 0, 0, SIDE, SIDE
    data = noise.ctypes.data
    calls.call("glTextureSubImage2D", *place, gl.RG, gl.UNSIGNED_BYTE, data)
    for parameter, value in (
        (gl.MIN_FILTER, gl.LINEAR),
        (gl.MAG_FILTER, gl.LINEAR),
        (gl.WRAP_S, gl.REPEAT),
        (gl.WRAP_T, gl.REPEAT),
    ):
        calls.call("glTextureParameteri", name, parameter, value)
    return name


def release_texture(calls: Gl, name: int) -> None:
    """Free the texture's memory."""
    names = np.array([name], np.uint32)
    calls.call("glDeleteTextures", 1, names.ctypes.data)
