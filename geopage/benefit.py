# SPDX-License-Identifier: Apache-2.0
"""Ranks: one currency for both lanes, screen error removed for each byte read.

A rank is a sort key, smaller is sooner, always. What the newest view wants comes before
anything that only a predicted view wants.
"""

from collections.abc import Sequence

import numpy as np

from geopage.selection import Wants
from geopage.tree import F8
from tiles.forest import Rows

LATER = 1000.0
"""Added to the rank of what only a predicted view wants; a logarithm never reaches it."""
_LEAST = 1e-30


def ranks(wants: Wants) -> F8:
    """Return the ranks of what the newest view wants, (w,)."""
    return np.asarray(-np.log(np.maximum(wants.benefit, _LEAST)))


def merged_ranks(now: Wants, later: Sequence[tuple[float, Wants]]) -> tuple[Rows, F8]:
    """Rank the wants of the newest view and of predicted views together.

    Parameters
    ----------
    now : what the newest view wants
    later : pairs of weight (0..1) and what a predicted view wants

    Returns
    -------
    rows : (w,) int32, each row once, best rank first
    ranks : (w,) float64, ascending
    """
    rows = [now.rows, *(wants.rows for _, wants in later)]
    keys = [ranks(now)]
    keys += [LATER + ranks(wants) - np.log(weight) for weight, wants in later]
    row, rank = np.concatenate(rows), np.concatenate(keys)
    order = np.lexsort((row, rank))
    row, rank = row[order], rank[order]
    _, first = np.unique(row, return_index=True)
    first.sort()
    return row[first], rank[first]
