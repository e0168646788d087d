# SPDX-License-Identifier: Apache-2.0
"""Whether every object of a store is found where it stands."""

from collections.abc import Iterator

import numpy as np

from tiles import cells
from tiles.footprints import place_inside
from tiles.query import Standing
from tiles.store import Store

CELLS_AT_ONCE = 64


def unreachable(store: Store) -> Iterator[int]:
    """Yield the ids of objects that a query at a place inside them does not find.

    Raises
    ------
    TileFault
    """
    standing = Standing(store)
    home = np.flatnonzero(standing.forest.records["own_dimension_m"] > 0)
    home = home[np.argsort(cells.range_min(standing.forest.records["cell"][home]))]
    reached = []
    # In the order of the cells, so that a cell's neighbours are still in the cache.
    for first in range(0, len(home), CELLS_AT_ONCE):
        some = [standing.footprints(row) for row in home[first : first + CELLS_AT_ONCE]]
        own = np.concatenate([one.id for one in some])
        inside = np.concatenate([place_inside(one) for one in some], axis=1)
        place, number = standing.at(*np.radians(inside))
        reached.append(number[own[place] == number])
    found = np.concatenate([np.zeros(0, np.int64), *reached])
    rows = store.connection.execute("SELECT id FROM object ORDER BY id").fetchall()
    stored = np.array(rows, np.int64).ravel()
    yield from np.setdiff1d(stored, found).tolist()
