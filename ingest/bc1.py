# SPDX-License-Identifier: Apache-2.0
"""Colours to BC1 (DXT1) blocks with mip levels: what the GPU samples, 4 bits a texel.

Range fit: the block's end points are the extremes along its principal axis, slightly
drawn in; each texel takes the nearest of the four colours.

References
----------
Brown 2006, DXT Compression Techniques (range fit).
"""

import numpy as np
from numpy.typing import NDArray

from tiles.kernels import kernel
from tiles.terrain import MIP_SIDES


def encode(picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Compress a square picture and its halvings.

    Parameters
    ----------
    picture : (256, 256, 3) float32, sRGB 0..255, row 0 south

    Returns
    -------
    (TEXTURE_BYTES,) uint8, finest level first
    """
    levels = []
    for side in MIP_SIDES:
        if side != picture.shape[0]:
            half = picture.reshape(side, 2, side, 2, 3)
            picture = half.mean(axis=(1, 3))
        levels.append(_blocks(np.ascontiguousarray(picture, np.float32)))
    return np.concatenate(levels).view(np.uint8)


@kernel
def _pack565(colour: NDArray[np.float32]) -> int:
    r = int(min(max(colour[0], 0.0), 255.0) * 31.0 / 255.0 + 0.5)
    g = int(min(max(colour[1], 0.0), 255.0) * 63.0 / 255.0 + 0.5)
    b = int(min(max(colour[2], 0.0), 255.0) * 31.0 / 255.0 + 0.5)
    return (r << 11) | (g << 5) | b


@kernel
def _unpack565(packed: int, out: NDArray[np.float32]) -> None:
    out[0] = (packed >> 11) * 255.0 / 31.0
    out[1] = ((packed >> 5) & 63) * 255.0 / 63.0
    out[2] = (packed & 31) * 255.0 / 31.0


@kernel
def _axis(texels: NDArray[np.float32], mean: NDArray[np.float32]) -> NDArray[np.float32]:
    """Principal axis of 16 colours by four power iterations on their covariance."""
    covariance = np.zeros((3, 3), np.float32)
    for i in range(16):
        for j in range(3):
            for k in range(3):
                covariance[j, k] += (texels[i, j] - mean[j]) * (texels[i, k] - mean[k])
    axis = np.array([0.6, 0.6, 0.5], np.float32)
    for _ in range(4):
        turned = np.zeros(3, np.float32)
        for j in range(3):
            for k in range(3):
                turned[j] += covariance[j, k] * axis[k]
        length = np.sqrt(turned[0] ** 2 + turned[1] ** 2 + turned[2] ** 2)
        if length > 1e-6:
            for j in range(3):
                axis[j] = turned[j] / length
    return axis


@kernel
def _ends(texels: NDArray[np.float32]) -> tuple[int, int]:
    """Return the two end colours, packed, the larger first."""
    mean = np.zeros(3, np.float32)
    for i in range(16):
        for k in range(3):
            mean[k] += texels[i, k] / 16.0
    axis = _axis(texels, mean)
    low, high = np.inf, -np.inf
    for i in range(16):
        along = 0.0
        for k in range(3):
            along += (texels[i, k] - mean[k]) * axis[k]
        low, high = min(low, along), max(high, along)
    inset = (high - low) / 16.0
    first = _pack565(mean + axis * np.float32(high - inset))
    second = _pack565(mean + axis * np.float32(low + inset))
    return max(first, second), min(first, second)


@kernel
def _block(texels: NDArray[np.float32]) -> int:
    """Compress 16 colours, (16, 3), row by row, to one 64-bit block."""
    first, second = _ends(texels)
    palette = np.zeros((4, 3), np.float32)
    _unpack565(first, palette[0])
    _unpack565(second, palette[1])
    for k in range(3):
        palette[2, k] = (2.0 * palette[0, k] + palette[1, k]) / 3.0
        palette[3, k] = (palette[0, k] + 2.0 * palette[1, k]) / 3.0
    choices = 0
    for i in range(16):
        best, best_distance = 0, np.inf
        for n in range(4):
            distance = 0.0
            for k in range(3):
                distance += (texels[i, k] - palette[n, k]) ** 2
            if distance < best_distance:
                best, best_distance = n, distance
        choices |= (best if first != second else 0) << (2 * i)
    return first | (second << 16) | (choices << 32)


@kernel
def _blocks(picture: NDArray[np.float32]) -> NDArray[np.int64]:
    count = picture.shape[0] // 4
    out = np.zeros(count * count, np.int64)
    texels = np.zeros((16, 3), np.float32)
    for r in range(count):
        for c in range(count):
            for i in range(16):
                for k in range(3):
                    texels[i, k] = picture[4 * r + i // 4, 4 * c + i % 4, k]
            out[r * count + c] = _block(texels)
    return out
