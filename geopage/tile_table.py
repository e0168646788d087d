# SPDX-License-Identifier: Apache-2.0
"""What the residency knows about one lane's tiles, as arrays over the forest's rows."""

import numpy as np

from geopage.tile_state import State
from geopage.tree import U1, Tree
from tiles.forest import Rows


class LaneTable:
    """What is known about the tiles of one lane, over the rows of its forest."""

    def __init__(self, tree: Tree) -> None:
        n = len(tree.parent)
        self.state = np.zeros(n, np.uint8)
        self.cost = tree.memory_bytes
        self.stored = tree.tile_bytes
        self.last_used = np.zeros(n, np.int64)
        """number of the newest list that drew or will draw the tile"""
        self.drawn: U1 = np.zeros(n, np.uint8)
        self.awaited: U1 = np.zeros(n, np.uint8)
        """a stand-in has been drawn for it"""

    def price(self, row: int, state: State) -> int:
        """Return the bytes that a tile takes in a state."""
        if state in {State.ABSENT, State.QUEUED, State.FAILED}:
            return 0
        stored = self.stored[row] if state is State.LOADING else 0
        return int(self.cost[row] + stored)

    def unused(self) -> int:
        """Count tiles that are in memory and have not been drawn."""
        here = (State.RESIDENT, State.UPLOADED, State.RELEASING)
        return int((np.isin(self.state, here) & (self.drawn == 0)).sum())

    def unneeded(self, older_than: int) -> Rows:
        """Return the uploaded tiles that no list from a number on needs."""
        free = (self.state == State.UPLOADED) & (self.last_used < older_than)
        return np.flatnonzero(free).astype(np.int32)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that are the table's own."""
        arrays = (self.state, self.last_used, self.drawn, self.awaited)
        return sum(array.nbytes for array in arrays)
