# SPDX-License-Identifier: Apache-2.0
"""Colours to BC1 (DXT1) blocks with mip levels: what the GPU samples, 4 bits a texel.

Range fit: the block's end points are the extremes along its principal axis, slightly
drawn in; each texel takes the nearest of the four colours on that line. A block of
nearly one colour takes the two end points whose third comes closest to it, so that open
sea and plains show no steps of the 5-6-5 bit end points.

References
----------
Brown 2006, DXT Compression Techniques (range fit).
"""

import numpy as np
from numpy.typing import NDArray

from tiles.kernels import inlined, summing
from tiles.terrain import MIP_SIDES, TEXTURE_BYTES

Picture = NDArray[np.float32]
PLAIN = np.float32(2.0)
"""A block whose colours reach no further than this along their axis is of one colour."""
NEARLY_PLAIN = np.float32(0.99 * PLAIN * PLAIN)
"""Then its box's squared diagonal is shorter, and its axis need not be looked for."""
ZERO, HALF, ONE, THREE = (np.float32(k) for k in (0.0, 0.5, 1.0, 3.0))
SIXTEENTH, QUARTER, TOP = np.float32(1 / 16), np.float32(0.25), np.float32(255)
SPAN_5, SPAN_6 = np.float32(255 / 31), np.float32(255 / 63)
EVEN = np.uint32(0x55555555)


def _thirds(bits: int) -> NDArray[np.int64]:
    """Return, for each value, the ends (first, second) whose (2 first + second) / 3 fits.

    Of those that fit equally well, the closest: decoders round differently.
    """
    top = (1 << bits) - 1
    shown = np.arange(top + 1) * (255.0 / top)
    third = (2.0 * shown[:, None] + shown) / 3.0
    apart = np.abs(shown[:, None] - shown) * 0.01
    gap = np.abs(np.arange(256)[:, None, None] - third) + apart
    best = gap.reshape(256, -1).argmin(axis=1)
    return np.stack([best // (top + 1), best % (top + 1)], axis=1)


THIRDS_5, THIRDS_6 = _thirds(5), _thirds(6)


def encode(picture: Picture) -> NDArray[np.uint8]:
    """Compress a square picture and its halvings.

    Parameters
    ----------
    picture : (256, 256, 3) float32, sRGB 0..255, row 0 south

    Returns
    -------
    (TEXTURE_BYTES,) uint8, finest level first
    """
    out = np.empty(TEXTURE_BYTES // 8, np.int64)
    start = 0
    for side in MIP_SIDES:
        picture = _blocks(picture, out[start:])
        start += (side // 4) ** 2
    return out.view(np.uint8)


@summing
def _blocks(picture: Picture, out: NDArray[np.int64]) -> Picture:
    """Compress one level, row by row of blocks; return the mean of each 2 x 2 texels."""
    count = picture.shape[0] // 4
    texels = np.empty((3, 16), np.float32)
    halved = np.empty((2 * count, 2 * count, 3), np.float32)
    for r in range(count):
        for c in range(count):
            for i in range(4):
                for j in range(4):
                    for k in range(3):
                        texels[k, 4 * i + j] = picture[4 * r + i, 4 * c + j, k]
            for k in range(3):
                for i in range(2):
                    for j in range(2):
                        at = 8 * i + 2 * j
                        north = texels[k, at] + texels[k, at + 1]
                        south = texels[k, at + 4] + texels[k, at + 5]
                        halved[2 * r + i, 2 * c + j, k] = (north + south) * QUARTER
            out[r * count + c] = _block(texels)
    return halved


@summing
def _block(texels: Picture) -> int:
    """Compress 16 colours, (3, 16), to one 64-bit block."""
    m0 = m1 = m2 = ZERO
    l0, l1, l2 = texels[0, 0], texels[1, 0], texels[2, 0]
    h0, h1, h2 = l0, l1, l2
    for i in range(16):
        m0 += texels[0, i]
        m1 += texels[1, i]
        m2 += texels[2, i]
        l0, l1, l2 = min(l0, texels[0, i]), min(l1, texels[1, i]), min(l2, texels[2, i])
        h0, h1, h2 = max(h0, texels[0, i]), max(h1, texels[1, i]), max(h2, texels[2, i])
    m0, m1, m2 = m0 * SIXTEENTH, m1 * SIXTEENTH, m2 * SIXTEENTH
    h0, h1, h2 = h0 - l0, h1 - l1, h2 - l2
    if h0 * h0 + h1 * h1 + h2 * h2 < NEARLY_PLAIN:
        return _plain(m0, m1, m2)
    a0, a1, a2 = _axis(texels, m0, m1, m2)
    low = high = ZERO
    for i in range(16):
        along = (texels[0, i] - m0) * a0 + (texels[1, i] - m1) * a1
        along += (texels[2, i] - m2) * a2
        low, high = min(low, along), max(high, along)
    if high - low < PLAIN:
        return _plain(m0, m1, m2)
    inset = (high - low) * SIXTEENTH
    low, high = low + inset, high - inset
    first = _pack(m0 + a0 * high, m1 + a1 * high, m2 + a2 * high)
    second = _pack(m0 + a0 * low, m1 + a1 * low, m2 + a2 * low)
    if first == second:
        return _plain(m0, m1, m2)
    if first < second:
        first, second = second, first
    return first | (second << 16) | (_choices(texels, first, second) << 32)


@inlined
def _axis(
    texels: Picture, m0: np.float32, m1: np.float32, m2: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    """Principal axis of 16 colours by two power iterations on their covariance."""
    rr = rg = rb = gg = gb = bb = ZERO
    for i in range(16):
        r, g, b = texels[0, i] - m0, texels[1, i] - m1, texels[2, i] - m2
        rr, rg, rb = rr + r * r, rg + r * g, rb + r * b
        gg, gb, bb = gg + g * g, gb + g * b, bb + b * b
    # From the channel that varies most, so that the start is never across the axis.
    if rr >= gg and rr >= bb:
        x, y, z = rr, rg, rb
    elif gg >= bb:
        x, y, z = rg, gg, gb
    else:
        x, y, z = rb, gb, bb
    for _ in range(2):
        size = ONE / (abs(x) + abs(y) + abs(z) + np.float32(1e-20))
        x, y, z = x * size, y * size, z * size
        x, y, z = (
            rr * x + rg * y + rb * z,
            rg * x + gg * y + gb * z,
            rb * x + gb * y + bb * z,
        )
    size = ONE / (np.sqrt(x * x + y * y + z * z) + np.float32(1e-20))
    return x * size, y * size, z * size


@inlined
def _pack(r: np.float32, g: np.float32, b: np.float32) -> int:
    """Round a colour to 5-6-5 bits."""
    red = int(min(max(r, ZERO), TOP) * (ONE / SPAN_5) + HALF)
    green = int(min(max(g, ZERO), TOP) * (ONE / SPAN_6) + HALF)
    blue = int(min(max(b, ZERO), TOP) * (ONE / SPAN_5) + HALF)
    return (red << 11) | (green << 5) | blue


@inlined
def _plain(r: np.float32, g: np.float32, b: np.float32) -> int:
    """Return the block that shows one colour."""
    red = int(min(max(r, ZERO), TOP) + HALF)
    green = int(min(max(g, ZERO), TOP) + HALF)
    blue = int(min(max(b, ZERO), TOP) + HALF)
    first = (THIRDS_5[red, 0] << 11) | (THIRDS_6[green, 0] << 5) | THIRDS_5[blue, 0]
    second = (THIRDS_5[red, 1] << 11) | (THIRDS_6[green, 1] << 5) | THIRDS_5[blue, 1]
    if first > second:
        return int(first | (second << 16) | (0xAAAAAAAA << 32))
    if first < second:
        return int(second | (first << 16) | (0xFFFFFFFF << 32))
    return int(first | (second << 16))


@inlined
def _choices(texels: Picture, first: int, second: int) -> int:
    """Return each texel's nearest of the four colours, 2 bits each."""
    r0, r1 = np.float32(second >> 11), np.float32(first >> 11)
    g0, g1 = np.float32((second >> 5) & 63), np.float32((first >> 5) & 63)
    b0, b1 = np.float32(second & 31), np.float32(first & 31)
    r0, r1, b0, b1 = r0 * SPAN_5, r1 * SPAN_5, b0 * SPAN_5, b1 * SPAN_5
    g0, g1 = g0 * SPAN_6, g1 * SPAN_6
    dr, dg, db = r1 - r0, g1 - g0, b1 - b0
    size = THREE / (dr * dr + dg * dg + db * db)
    dr, dg, db = dr * size, dg * size, db * size
    start = HALF - (r0 * dr + g0 * dg + b0 * db)
    thirds = np.uint32(0)
    for i in range(16):
        along = start + texels[0, i] * dr + texels[1, i] * dg + texels[2, i] * db
        third = np.uint32(np.int32(min(max(along, ZERO), THREE)))
        thirds |= third << np.uint32(2 * i)
    # BC1's codes of 0, 1, 2 and 3 thirds of the way to the first end are 1, 3, 2 and 0.
    high = (thirds >> np.uint32(1)) & EVEN
    return int(((thirds & EVEN) ^ high) << np.uint32(1) | (high ^ EVEN))
