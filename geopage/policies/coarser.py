# SPDX-License-Identifier: Apache-2.0
"""The missing tiles on the way down to a wanted one."""

import numpy as np

from geopage.tree import U1, Tree
from tiles.forest import Rows


def on_the_way(tree: Tree, uploaded: U1, rows: Rows) -> Rows:
    """List the tiles between each row and what is uploaded above it.

    A tile above an object tile is on the way when it has a proxy for what lies below.

    Returns
    -------
    (k, w) rows, the coarsest first, the wanted row itself last; -1 where the way is
    shorter than others
    """
    helps = (tree.has_tile > 0) & ((tree.own_m == 0) | (tree.proxies > 0))
    way, at = [rows], rows
    going = np.ones(len(rows), np.bool_)
    while going.any():
        above = np.where(going, tree.parent[at], -1)
        going = (above >= 0) & (uploaded[above] == 0)
        at = np.where(going, above, at)
        way.append(np.where(going & helps[at], at, -1).astype(np.int32))
    return np.stack(way[::-1])


def next_down(tree: Tree, uploaded: U1, rows: Rows, skip: int) -> Rows:
    """Return the tile to ask for first on the way to each row, skipping `skip` coarser."""
    way = on_the_way(tree, uploaded, rows)
    place = np.cumsum(way >= 0, axis=0)
    wanted = np.minimum(skip + 1, place[-1])
    return np.asarray(way[np.argmax(place >= wanted, axis=0), np.arange(len(rows))])
