# SPDX-License-Identifier: Apache-2.0
"""Which tiles go first when memory is short, and which never go."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from geopage.tile_table import LaneTable
from geopage.tree import F8
from tiles.forest import Rows
from tiles.lanes import Lane

Leaving = Callable[[Lane, Rows, NDArray[np.int64]], F8]
"""Orders tiles that may go, the smallest first: see `geopage.policies`."""
PINNED = np.iinfo(np.int64).max
"""A tile that was last needed then never goes."""
PINNED_LEVELS = 2
PINNED_SHARE = 8
"""Levels 1 and 2 are pinned, too, where they take at most an eighth of the budget."""


def least_recently_used(lane: Lane, rows: Rows, last_used: NDArray[np.int64]) -> F8:  # noqa: ARG001
    """Order tiles by when they were last needed."""
    return last_used.astype(np.float64)


def pinned(
    level: NDArray[np.int16], cost: NDArray[np.int64], budget_bytes: int
) -> NDArray[np.bool_]:
    """Say which terrain tiles never go, (n,): the coarsest levels.

    Parameters
    ----------
    level, cost : (n,) of the tiles, the cost in bytes
    """
    coarse = level <= PINNED_LEVELS
    if int(cost[coarse].sum()) * PINNED_SHARE > budget_bytes:
        coarse = level == 0
    return np.asarray(coarse)


def first_to_go(
    tables: Mapping[Lane, LaneTable], leaving: Leaving, older_than: int, missing: int
) -> dict[Lane, Rows]:
    """Choose by the policy's order: enough to free `missing` bytes, or all there are.

    A city has thousands of tiles that may go; sorting them as arrays needs no GIL.

    Parameters
    ----------
    older_than : only tiles that no list from this number on needs may go
    """
    rows = {lane: table.unneeded(older_than) for lane, table in tables.items()}
    last_used = {lane: tables[lane].last_used[these] for lane, these in rows.items()}
    order = [leaving(lane, these, last_used[lane]) for lane, these in rows.items()]
    cost = np.concatenate([tables[lane].cost[these] for lane, these in rows.items()])
    first = np.argsort(np.concatenate(order), kind="stable")
    enough = int(np.searchsorted(np.cumsum(cost[first]), missing)) + 1
    goes = np.zeros(len(cost), np.bool_)
    goes[first[:enough]] = True
    ends = np.cumsum([len(these) for these in rows.values()])[:-1]
    parts = zip(rows.items(), np.split(goes, ends), strict=True)
    return {lane: these[part] for (lane, these), part in parts}
