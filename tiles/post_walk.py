# SPDX-License-Identifier: Apache-2.0
"""What searches of a `PostTree` share: nodes that wait, the most promising one last."""

import numpy as np

from tiles.frames import Floats, Ints
from tiles.kernels import kernel
from tiles.post_chunks import SIDE
from tiles.post_tree import LEVELS

STACK = 4 * LEVELS
Rooms = tuple[Floats, Ints, Floats]
"""What a search needs: room for posts, nodes that wait, and their bounds."""


@kernel
def new_rooms() -> Rooms:
    """Make rooms for one loop of searches."""
    posts = np.empty((SIDE + 1, SIDE + 1, 4))
    return posts, np.empty((STACK, 3), np.int64), np.empty(STACK)


@kernel
def put(
    waiting: Ints,
    bound: Floats,
    start: int,
    count: int,
    node: tuple[int, int, int],
    value: float,
) -> int:
    """Add a node to a stack whose last entries, from `start`, fall; the least is last."""
    at = count
    while at > start and bound[at - 1] < value:
        bound[at] = bound[at - 1]
        for k in range(3):
            waiting[at, k] = waiting[at - 1, k]
        at -= 1
    bound[at] = value
    waiting[at, 0], waiting[at, 1], waiting[at, 2] = node
    return count + 1
