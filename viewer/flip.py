# SPDX-License-Identifier: Apache-2.0
"""LDR-FLIP: how different two pictures look to a person who flips between them.

Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: A Difference
Evaluator for Alternating Images", Proceedings of the ACM on Computer Graphics and
Interactive Techniques 3(2), 2020. Section 3 has the steps; the constants are theirs. The
observer sits 0.7 m from a screen of 3840 pixels in 0.7 m: 67 pixels a degree.

A picture is prepared once and can then be compared with many.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.kernels import kernel

PX_PER_DEG = 0.7 * 3840 / 0.7 * math.pi / 180
F4 = NDArray[np.float32]

PRIMARIES = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
WHITE = (0.3127, 0.3290)
"""Chromaticities of sRGB: red, green, blue, and D65"""
SENSITIVITY = (
    ((1.0, 0.0047),),
    ((1.0, 0.0053),),
    ((34.1, 0.04), (13.5, 0.025)),
)
"""Contrast sensitivity of the achromatic, red-green and blue-yellow channels, as sums of
Gaussians: height and width, table 1"""
FEATURE_DEG = 0.082
"""Width of an edge or a point that is seen best"""
COLOUR_POWER, FEATURE_POWER = 0.7, 0.5
KNEE, KNEE_TO = 0.4, 0.95
"""The lowest part of the colour differences is spread over nearly the whole scale."""


class Prepared(NamedTuple):
    """A picture as FLIP compares it."""

    lab: F4
    """(3, h, w) filtered by contrast sensitivity, CIELAB with Hunt's adjustment"""
    edges: F4
    """(h, w) strength"""
    points: F4
    """(h, w) strength"""


def prepare(rgb: NDArray[np.uint8]) -> Prepared:
    """Filter a picture, (h, w, 3) sRGB."""
    linear = LINEAR[np.moveaxis(rgb, -1, 0)]
    opponent = _opponent(_times(TO_XYZ, linear))
    seen = np.stack([_contrast(*pair) for pair in zip(opponent, SENSITIVITY, strict=True)])
    inside = np.clip(_times(np.linalg.inv(TO_XYZ), _from_opponent(seen)), 0.0, 1.0)
    grey = (opponent[0] + 16) / 116
    return Prepared(_hunt_lab(inside), _feature(grey, _edge), _feature(grey, _point))


def compare(a: Prepared, b: Prepared) -> F4:
    """Return the difference of each pixel, (h, w) from 0, alike, to 1."""
    colour = _spread(_hyab(a.lab, b.lab) ** COLOUR_POWER)
    most = np.maximum(np.abs(a.edges - b.edges), np.abs(a.points - b.points))
    feature = (most / math.sqrt(2)) ** FEATURE_POWER
    return np.asarray(colour ** (1 - feature), np.float32)


def _to_xyz() -> F4:
    xyz = np.array([(x / y, 1.0, (1 - x - y) / y) for x, y in (*PRIMARIES, WHITE)]).T
    return np.asarray(xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3]), np.float32)


TO_XYZ = _to_xyz()
"""(3, 3) from linear sRGB to CIE XYZ"""
WHITE_XYZ = TO_XYZ.sum(axis=1)[:, None, None]


def _linear(srgb: F4) -> F4:
    high = ((srgb + 0.055) / 1.055) ** 2.4
    return np.asarray(np.where(srgb > 0.04045, high, srgb / 12.92), np.float32)


LINEAR = _linear(np.arange(256, dtype=np.float32) / np.float32(255))
"""Of each 8-bit value"""


def _times(matrix: F4, channels: F4) -> F4:
    return _mix(np.ascontiguousarray(matrix, np.float32), np.ascontiguousarray(channels))


@kernel
def _mix(matrix: F4, channels: F4) -> F4:
    out = np.empty_like(channels)
    for i in range(3):
        a, b, c = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        for row in range(channels.shape[1]):
            for col in range(channels.shape[2]):
                x, y, z = (
                    channels[0, row, col],
                    channels[1, row, col],
                    channels[2, row, col],
                )
                out[i, row, col] = a * x + b * y + c * z
    return out


def _opponent(xyz: F4) -> F4:
    """Return YCxCz, CIELAB without its cube roots."""
    x, y, z = xyz / WHITE_XYZ
    return np.stack((116 * y - 16, 500 * (x - y), 200 * (y - z)))


def _from_opponent(ycc: F4) -> F4:
    y = (ycc[0] + 16) / 116
    return np.asarray(np.stack((y + ycc[1] / 500, y, y - ycc[2] / 200)) * WHITE_XYZ)


def _hunt_lab(linear: F4) -> F4:
    """Return CIELAB whose colours fade where it is dark, as Hunt found."""
    share = _times(TO_XYZ, linear) / WHITE_XYZ
    root = np.where(share > (6 / 29) ** 3, np.cbrt(share), share * 841 / 108 + 4 / 29)
    light, a, b = 116 * root[1] - 16, 500 * (root[0] - root[1]), 200 * (root[1] - root[2])
    return np.asarray(np.stack((light, 0.01 * light * a, 0.01 * light * b)), np.float32)


def _hyab(a: F4, b: F4) -> F4:
    """Return the HyAB distance: city block in lightness, Euclidean in colour."""
    d = a - b
    return np.asarray(np.abs(d[0]) + np.hypot(d[1], d[2]), np.float32)


def _spread(difference: F4) -> F4:
    """Bring colour differences to 0..1; the largest is that of green and blue."""
    green, blue = (_hunt_lab(np.eye(3, dtype=np.float32)[i][:, None, None]) for i in (1, 2))
    largest = float(_hyab(green, blue)[0, 0]) ** COLOUR_POWER
    knee = KNEE * largest
    above = KNEE_TO + (difference - knee) / (largest - knee) * (1 - KNEE_TO)
    return np.asarray(np.where(difference < knee, difference * KNEE_TO / knee, above))


def _contrast(channel: F4, gaussians: tuple[tuple[float, float], ...]) -> F4:
    """Filter a channel by its contrast sensitivity."""
    widest = max(width for kind in SENSITIVITY for _, width in kind)
    reach = math.ceil(3 * math.sqrt(widest / (2 * math.pi**2)) * PX_PER_DEG)
    x = np.arange(-reach, reach + 1) / PX_PER_DEG
    lines = [np.exp(-((math.pi * x) ** 2) / width) for _, width in gaussians]
    heights = [height * math.sqrt(math.pi / width) for height, width in gaussians]
    whole = sum(
        height * line.sum() ** 2 for height, line in zip(heights, lines, strict=True)
    )
    parts = [
        _along(_along(channel, line, 0), line * (height / whole), 1)
        for height, line in zip(heights, lines, strict=True)
    ]
    return np.asarray(sum(parts), np.float32)


def _edge(x: Floats, width: float) -> Floats:
    return -x * np.exp(-(x**2) / (2 * width**2))


def _point(x: Floats, width: float) -> Floats:
    return (x**2 / width**2 - 1) * np.exp(-(x**2) / (2 * width**2))


def _feature(grey: F4, kind: Callable[[Floats, float], Floats]) -> F4:
    """Return the strength of edges or points, both ways together."""
    width = 0.5 * FEATURE_DEG * PX_PER_DEG
    reach = math.ceil(3 * width)
    x = np.arange(-reach, reach + 1, dtype=np.float64)
    smooth, across = np.exp(-(x**2) / (2 * width**2)), kind(x, width)
    ups, downs = across * (across > 0), across * (across < 0)
    across = ups / ups.sum() - downs / downs.sum()
    smooth /= smooth.sum()
    both = [_along(_along(grey, across, i), smooth, 1 - i) for i in (0, 1)]
    return np.asarray(np.hypot(*both), np.float32)


def _along(channel: F4, weights: Floats, axis: int) -> F4:
    """Correlate with weights of odd number along an axis; the border's pixels go on."""
    taps = weights.astype(np.float32)
    return _down(channel, taps) if axis == 0 else _across(channel, taps)


@kernel
def _down(channel: F4, weights: F4) -> F4:
    height, width = channel.shape
    reach, out = len(weights) // 2, np.zeros_like(channel)
    for row in range(height):
        for k in range(len(weights)):
            other = min(max(row + k - reach, 0), height - 1)
            for col in range(width):
                out[row, col] += weights[k] * channel[other, col]
    return out


@kernel
def _across(channel: F4, weights: F4) -> F4:
    height, width = channel.shape
    reach, out = len(weights) // 2, np.zeros_like(channel)
    wide = np.empty(width + 2 * reach, np.float32)
    for row in range(height):
        wide[:reach], wide[reach + width :] = channel[row, 0], channel[row, width - 1]
        wide[reach : reach + width] = channel[row]
        for k in range(len(weights)):
            for col in range(width):
                out[row, col] += weights[k] * wide[col + k]
    return out
