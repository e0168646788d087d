# SPDX-License-Identifier: Apache-2.0
"""E2's rows and chart, made of what `cull_chain` counted."""

from dataclasses import dataclass, field

import numpy as np

from viewer.experiments.rows import LESS, MORE, Chart, Found, Row, Series

KEY = "E2"
THRESHOLDS_PX = (1.0, 2.0, 4.0, 8.0)
BERKELEY = "Funkhouser 1992, table 2"
DETAIL = "Funkhouser 1992, table 4"
MMR = "MMR 1999, table 1"
NO_ROOMS = "not reproduced: a city has no cells and portals, and we work out none"


@dataclass(slots=True)
class Chain:
    """What is left of all buildings after each stage, at each view."""

    buildings: int
    triangles: int
    left: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    """objects and triangles, by stage"""
    times_ms: dict[str, list[float]] = field(default_factory=dict)

    def add(self, stage: str, count: int, triangles: int) -> None:
        """Note what a stage leaves at one more view."""
        self.left.setdefault(stage, []).append((count, triangles))

    def share(self, stage: str) -> float:
        """Return the mean share of all triangles that a stage leaves, per cent."""
        return 100 * float(np.mean([t for _, t in self.left[stage]])) / self.triangles

    def count(self, stage: str) -> float:
        """Return the mean number of objects that a stage leaves."""
        return float(np.mean([n for n, _ in self.left[stage]]))

    def removed(self, stage: str, before: str) -> float:
        """Return the mean share that a stage takes of what another left, per cent."""
        pairs = zip(self.left[stage], self.left[before], strict=True)
        return float(np.mean([100 * (1 - a / b) for (_, a), (_, b) in pairs if b]))

    def faster(self, name: str) -> float:
        """Return how many times as fast as everything something is drawn."""
        return float(np.mean(self.times_ms["all"]) / np.mean(self.times_ms[name]))


def figures(walk: Chain, orbit: Chain) -> Found:
    """Return rows, chart and sentences of a walk and of a flight around."""
    found = Found()
    _berkeley(found, walk)
    _mmr(found, orbit)
    kept = ("tiles in view", "buildings in view", "buildings with a pixel")
    stages = (*kept, *(f"{px:g} px" for px in THRESHOLDS_PX))
    series = [
        Series(name, range(len(stages)), [chain.share(stage) for stage in stages])
        for name, chain in (("walk in the street", walk), ("orbit, 400 m off", orbit))
    ]
    title = "What is left of the buildings' triangles"
    y = "% of all at full detail"
    found.charts.append(
        Chart("e2_chain", title, "stage", y, series, log_y=True, bars=stages)
    )
    more = walk.share("tiles in view") / max(walk.share("buildings with a pixel"), 1e-9)
    found.says.append(
        f"In the street, culling by tile keeps {more:.0f} times the triangles that have a"
        " pixel: there is no culling of what houses hide, and that is where we lose to the"
        " papers' walkthroughs. Detail by size cannot make up for it near the eye."
    )
    return found


def _berkeley(found: Found, chain: Chain) -> None:
    where = "Berkeley's chain, walk in the street"
    add = found.rows.append
    note = f"of {chain.triangles:,} triangles of {chain.buildings:,} buildings"
    quantity = "left after cell-to-cell visibility"
    add(Row(KEY, where, quantity, "%", 32.0, BERKELEY, None, NO_ROOMS))
    quantity = "left after cell-to-object visibility"
    add(Row(KEY, where, quantity, "%", 15.0, BERKELEY, None, NO_ROOMS))
    quantity = "left after eye-to-cell culling (ours: tiles in view)"
    share = chain.share("tiles in view")
    add(Row(KEY, where, quantity, "%", 8.5, BERKELEY, share, note, LESS))
    quantity = "left after eye-to-object culling (ours: none)"
    add(Row(KEY, where, quantity, "%", 5.6, BERKELEY, share, "we cull tiles only", LESS))
    for stage, words in (
        ("buildings in view", "if each building were culled: not built"),
        ("buildings with a pixel", "if all that is hidden were culled: not built"),
    ):
        quantity = f"left, {stage}"
        add(Row(KEY, where, quantity, "%", None, "", chain.share(stage), words))
    for px, paper, faces in ((1.0, 4.0, 64), (2.0, 2.5, 256), (8.0, 1.4, 1024)):
        quantity = f"left after detail by size (theirs {faces} px a face, ours {px:g} px)"
        note = "their measure has no like here" if px == 1.0 else ""
        share = chain.share(f"{px:g} px")
        add(Row(KEY, where, quantity, "%", paper, DETAIL, share, note, LESS))
    source = "Funkhouser 1992, section 6"
    quantity = "drawing, culled / everything: times as fast"
    note = "buildings alone"
    add(
        Row(
            KEY,
            where,
            quantity,
            "",
            17.0,
            source,
            chain.faster("in view"),
            note,
            MORE,
            timed=True,
        )
    )
    quantity = "drawing, culled and by detail / everything: times as fast"
    ours, note = chain.faster("2 px"), "their tables' own means give 26 (256 px a face)"
    add(Row(KEY, where, quantity, "", 39.0, source, ours, note, MORE, timed=True))


def _mmr(found: Found, chain: Chain) -> None:
    where = "MMR's chain, orbit 400 m off"
    add = found.rows.append
    note = "not reproduced: we have no impostors; proxies come with the detail below"
    quantity = "removed by textured depth meshes"
    add(Row(KEY, where, quantity, "%", 96.0, MMR, None, note))
    share = 100 - chain.share("tiles in view")
    quantity = "removed by the view frustum"
    note = "theirs of what the meshes left, ours of everything"
    add(Row(KEY, where, quantity, "%", 47.0, MMR, share, note, MORE))
    share = chain.removed("2 px", "tiles in view")
    quantity = "removed by levels of detail (ours 2 px), of what was left"
    add(Row(KEY, where, quantity, "%", 47.0, MMR, share, "", MORE))
    share = chain.removed("buildings with a pixel", "tiles in view")
    quantity = "removable by occlusion, at full detail: not built"
    add(Row(KEY, where, quantity, "%", 10.0, MMR, share, "theirs after detail"))
    quantity = "left in the end"
    share = chain.share("2 px")
    add(Row(KEY, where, quantity, "%", 0.9, "MMR 1999, section 6.2", share, "", LESS))
