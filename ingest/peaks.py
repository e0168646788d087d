# SPDX-License-Identifier: Apache-2.0
"""The largest of many numbers that change one by one: a tree of peaks over chunks."""

from tiles.frames import Floats
from tiles.kernels import inlined

CHUNK = 8
"""Triangles whose largest error is one of the numbers that the worst is chosen from"""


@inlined
def raised(peak: Floats, half: int, worst: Floats, chunk: int) -> None:
    """Tell a tree of largest values, the root at 1, that a chunk has changed."""
    most = -1.0
    for t in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(worst))):
        most = max(most, worst[t])
    node = half + chunk
    while node > 0 and peak[node] != most:
        peak[node] = most
        most = max(most, peak[node ^ 1])
        node //= 2


@inlined
def first(peak: Floats, half: int, worst: Floats) -> int:
    """Return the first triangle whose value is the tree's largest."""
    node = 1
    while node < half:
        node *= 2
        if peak[node] != peak[1]:
            node += 1
    t = (node - half) * CHUNK
    while worst[t] != peak[1]:
        t += 1
    return t
