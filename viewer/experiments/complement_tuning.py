# SPDX-License-Identifier: Apache-2.0
"""E3's tables on culling, on the inertia k, and on the cache of index nodes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from viewer.experiments.city_pages import Culled
from viewer.experiments.packed_tree import PackedTree
from viewer.experiments.review_walk import Retrieval, Tally, walk_through
from viewer.experiments.rows import SAME, Chart, Found, Row, Series
from viewer.experiments.walks import Walk

KEY = "E3"
CULLED = {1.0: 91.34, 1.2: 92.26, 1.5: 92.93, 2.1: 93.99, 2.5: 94.86, 3.1: 95.33}
TIME_SAVED = (34.93, 46.13, 50.53, 61.02, 65.16, 90.77)
TABLE_2 = "REVIEW 2001, table 2"
K_S = (0.0, 0.4, 0.8, 1.2, 1.6, 2.4)
K_SCALE = 2.1
"""A cell around the far plane's middle holds the view only from a factor of 2 on"""
INDEX_MB = (0.25, 0.5, 1.0, 2.0)


def culling(
    found: Found, tree: PackedTree, walks: Sequence[Walk], paged: Sequence[Culled], own: str
) -> None:
    """Table 2: how much of what is in memory the view does not need."""
    ours = []
    for (scale, paper), saved in zip(CULLED.items(), TIME_SAVED, strict=True):
        tallies = [walk_through(tree, walk, Retrieval(scale)) for walk in walks]
        ours.append(100 * _share_culled(tallies))
        where = f"SF {scale:g}"
        row = Row(KEY, where, "objects culled", "%", paper, TABLE_2, ours[-1])
        found.rows.append(replace(row, good=SAME))
        note = (
            "not reproduced: this city has an index and no meshes to draw"
            if scale == 1.0
            else ""
        )
        quantity = "frame time saved by culling"
        found.rows.append(Row(KEY, where, quantity, "%", saved, TABLE_2, None, note))
    for name, counts in (
        ("by tile", [one.sent for one in paged]),
        ("by box, as they do", [one.seen for one in paged]),
    ):
        held = np.concatenate([one.held for one in paged])
        kept = np.concatenate(counts) / np.maximum(held, 1)
        part = 100 * float(1 - kept.mean())
        where = own
        note = (
            "we cull whole tiles" if name == "by tile" else "what finer culling would add"
        )
        quantity = f"objects culled {name}"
        found.rows.append(Row(KEY, where, quantity, "%", None, "", part, note))
    series = [
        Series("paper", [*CULLED], [*CULLED.values()], paper=True),
        Series("ours, their method", [*CULLED], ours),
        Series("geopage, by tile", [*CULLED], [found.rows[-2].ours or 0.0] * len(CULLED)),
    ]
    title = "Boxes in memory that the view does not need"
    found.charts.append(Chart("e3_culled", title, "disk cell / view, SF", "%", series))


def _share_culled(tallies: Sequence[Tally]) -> float:
    held = np.concatenate([one.held for one in tallies])
    seen = np.concatenate([one.seen for one in tallies])
    return float(1 - (seen / np.maximum(held, 1)).mean())


def inertia(found: Found, tree: PackedTree, walks: Sequence[Walk]) -> None:
    """Figure 10: the factor k of F' = F + k velocity."""
    series = []
    for walk in walks:
        reads = [walk_through(tree, walk, Retrieval(K_SCALE, k_s=k)).reads for k in K_S]
        best = K_S[int(np.argmin(reads))] if min(reads) < max(reads) else None
        note = f"{min(reads):,} to {max(reads):,} reads; SF {K_SCALE:g}"
        if walk is walks[0]:
            note += "; theirs by frame time, ours by reads, k in seconds"
        where, source = walk.name, "REVIEW 2001, section 5.1"
        found.rows.append(Row(KEY, where, "best k", "s", 0.8, source, best, note, SAME))
        series.append(Series(walk.name, K_S, [one / max(reads[0], 1) for one in reads]))
    title = "Inertia of the prefetched cell"
    y = "reads in the session / reads at k = 0"
    found.charts.append(Chart("e3_k", title, "k, s", y, series))


def index_cache(found: Found, tree: PackedTree, walks: Sequence[Walk]) -> None:
    """Figure 11: distance-priority-LRU against LRU on index nodes."""
    shares = []
    for size_mb in INDEX_MB:
        ways = [
            Retrieval(index_bytes=int(size_mb * 1e6), by_distance=by_distance)
            for by_distance in (False, True)
        ]
        lru, distance = (
            sum(walk_through(tree, walk, how).node_reads for walk in walks) for how in ways
        )
        shares.append(100 * distance / max(lru, 1))
        where, source = f"index cache {size_mb:g} MB", "REVIEW 2001, figure 11"
        note = "theirs below 100 up to 20 MB (figure missing)" if len(shares) == 1 else ""
        quantity = "index reads, distance-priority-LRU / LRU"
        found.rows.append(Row(KEY, where, quantity, "%", None, source, shares[-1], note))
    low = min(zip(shares, INDEX_MB, strict=True))
    found.says.append(
        f"Distance-priority-LRU saves at best {100 - low[0]:.0f} % of index reads (at"
        f" {low[1]:g} MB). Index reads are few beside boxes, so it hardly matters; our"
        " whole index is in memory."
    )
