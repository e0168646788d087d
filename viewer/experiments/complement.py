# SPDX-License-Identifier: Apache-2.0
"""E3: REVIEW's complement search, culling and prefetching, on a city of 900,000 boxes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from viewer.experiments.city import COUNT, STORED_BYTES, City, make_city, write_city
from viewer.experiments.city_pages import CityPager, Culled
from viewer.experiments.complement_tuning import culling, index_cache, inertia
from viewer.experiments.packed_tree import PackedTree
from viewer.experiments.pages import Flown
from viewer.experiments.review_walk import Retrieval, Tally, walk_through
from viewer.experiments.rows import SAME, Chart, Found, Progress, Row, Series
from viewer.experiments.setting import Setting
from viewer.experiments.walks import SPEED_M_S, Walk, in_frustum, make_walk

KEY = "E3"

BOX_READS = (1877.75, 1900.94, 1963.73, 2018.24, 1934.57)
BEST_READS = (410.95, 169.96, 265.88, 201.89, 212.48)


class Own(NamedTuple):
    """One way that geopage pages the city."""

    policy: str
    budget_bytes: int = 20_000_000

    def __str__(self) -> str:
        return f"{self.policy}, {self.budget_bytes / 1e6:.0f} MB"


OWN = (Own("review"), Own("benefit"), Own("benefit", 40_000_000))
SEEN_EVERY = 20
FAR_M = 1200.0
"""No corner of the view is farther east, north, west or south"""
TABLE_1 = "REVIEW 2001, table 1"


@dataclass(slots=True)
class Scene:
    """A city, an index of it of either kind, and five walks."""

    city: City
    tree: PackedTree
    store: Path
    walks: list[Walk]


def make_scene(setting: Setting, count: int = COUNT, seconds: float = 240.0) -> Scene:
    """Make the data, the same each time."""
    city = make_city(count)
    start = np.full(2, 0.3 * city.side_m)
    walks = [make_walk(name, start, seconds) for name in SPEED_M_S]
    store = write_city(setting.data / "city.geopage", city)
    return Scene(city, PackedTree(city), store, walks)


def run(setting: Setting, show: Progress) -> Found:
    """Run the experiment."""
    return measure(make_scene(setting, seconds=setting.pick(150.0, 60.0)), show)


def measure(scene: Scene, show: Progress) -> Found:
    """Walk through a scene in all ways."""
    found = Found()
    searches = [_searched(scene, walk) for walk in scene.walks]
    show(10)
    paged: dict[Own, list[tuple[Flown, Culled]]] = {}
    for done, own in enumerate(OWN):
        paged[own] = [_paged(scene, walk, own) for walk in scene.walks]
        show(25 + 15 * done)
    _reads(found, scene, searches, paged)
    culled = [culled for _, culled in paged[OWN[1]]]
    culling(found, scene.tree, scene.walks, culled, f"geopage ({OWN[1]})")
    show(75)
    inertia(found, scene.tree, scene.walks)
    show(90)
    index_cache(found, scene.tree, scene.walks)
    show(100)
    return found


def _paged(scene: Scene, walk: Walk, own: Own) -> tuple[Flown, Culled]:
    """Return a walk by geopage's own pager."""
    pager = CityPager(scene.store, scene.city, walk, own.policy, own.budget_bytes)
    return pager.walk_through(), pager.culled


def _searched(scene: Scene, walk: Walk) -> tuple[Tally, Tally]:
    """Return a walk by box searches and by the paper's best way."""
    box = Retrieval(complement=False, prefetch=False, by_distance=False)
    return walk_through(scene.tree, walk, box), walk_through(scene.tree, walk, Retrieval())


def _reads(
    found: Found,
    scene: Scene,
    searches: Sequence[tuple[Tally, Tally]],
    paged: dict[Own, list[tuple[Flown, Culled]]],
) -> None:
    """Say what each session reads, and draw it."""
    flown = [[paged[own][i][0] for own in OWN] for i in range(len(scene.walks))]
    shares = []
    for i, (box, best) in enumerate(searches):
        shares.append(_per_query(found, i, scene.walks[i].name, box, best))
        shares[i] += _whole_session(found, scene, i, searches[i], flown[i])
    labels = ("paper, Optimal", "ours, Optimal", *(f"geopage, {own}" for own in OWN))
    names = [walk.name for walk in scene.walks]
    found.charts.append(
        Chart(
            "e3_reads",
            "What is read, compared with box searches",
            "session",
            "% of BOX (per query; geopage: whole session)",
            [
                Series(label, range(len(names)), [row[j] for row in shares], j == 0)
                for j, label in enumerate(labels)
            ],
            bars=names,
        )
    )
    low, high = (f([row[1] for row in shares]) for f in (min, max))
    found.says.append(
        f"Complement search reads {low:.0f} to {high:.0f} % of what box searches read for"
        " a query; the paper has 9 to 22 %. Per query flatters it where it also asks"
        " more often: see the rows of whole sessions."
    )
    _say_where_worse(found, names, searches, [row[1] for row in flown])


def _where(i: int, name: str) -> str:
    return f"session {i + 1}, {name}"


def _per_query(found: Found, i: int, name: str, box: Tally, best: Tally) -> list[float]:
    """Add what one query reads; return the paper's share of box searches and ours, %."""
    where, theirs = _where(i, name), (BOX_READS[i], BEST_READS[i])
    ours = per_query(box), per_query(best)
    for way, paper, one in zip(("BOX", "Optimal"), theirs, ours, strict=True):
        note = "index nodes and boxes read, each one I/O" if i == 0 else ""
        quantity = f"I/Os per query, {way}"
        found.rows.append(Row(KEY, where, quantity, "reads", paper, TABLE_1, one, note))
    share = [100 * theirs[1] / theirs[0], 100 * ours[1] / max(ours[0], 1e-9)]
    row = Row(KEY, where, "Optimal / BOX, per query", "%", share[0], TABLE_1, share[1])
    found.rows.append(replace(row, good=SAME))
    return share


def _whole_session(
    found: Found,
    scene: Scene,
    i: int,
    searches: tuple[Tally, Tally],
    flown: Sequence[Flown],
) -> list[float]:
    """Add what a session reads; return each own way's share of box searches, %."""
    walk, (box, best), shares = scene.walks[i], searches, []
    where, boxes = _where(i, walk.name), max(box.box_reads, 1)
    total = 100 * best.reads / max(box.reads, 1)
    note = f"{best.queries} queries against {box.queries}"
    row = Row(KEY, where, "Optimal / BOX, whole session", "%", None, "", total, note)
    found.rows.append(row)
    for own, one in zip(OWN, flown, strict=True):
        shares.append(100 * one.bytes_read / STORED_BYTES / boxes)
        raised = max(one.raised)
        note = f"{one.tiles_read} tiles"
        note += f"; thresholds raised up to {raised:.2f} times" if raised > 1 else ""
        quantity = f"geopage ({own}): boxes read / BOX, whole session"
        found.rows.append(Row(KEY, where, quantity, "%", None, "", shares[-1], note))
    floor = 100 * _ever_seen(scene.city, walk) / boxes
    note = "what a clairvoyant would read that forgets nothing"
    quantity = "boxes that ever come into view / BOX"
    found.rows.append(Row(KEY, where, quantity, "%", None, "", floor, note))
    return shares


def _say_where_worse(
    found: Found,
    names: Sequence[str],
    searches: Sequence[tuple[Tally, Tally]],
    flown: Sequence[Flown],
) -> None:
    """Name the sessions in which our pager reads more than the paper's best way."""
    all_of = zip(names, searches, flown, strict=True)
    worse = [
        name
        for name, (_, best), one in all_of
        if one.bytes_read > best.box_reads * STORED_BYTES
    ]
    if worse:
        index_mb = flown[0].index_bytes / 1e6
        found.says.append(
            f"geopage ({OWN[1]}) reads more boxes than REVIEW's best way in"
            f" {len(worse)} of {len(names)} sessions ({', '.join(worse)}): its index"
            f" takes {index_mb:.1f} MB of the 20, it asks for whole tiles, and earlier than"
            " they come into view, and it keeps little of what is out of view."
        )


def _ever_seen(city: City, walk: Walk) -> int:
    """Count boxes that come into view after the first step."""
    near = np.zeros(len(city.low), np.bool_)
    first = near
    for i in range(0, len(walk.place), SEEN_EVERY):
        low, high = walk.place[i] - FAR_M, walk.place[i] + FAR_M
        here = ((city.high[:, :2] >= low) & (city.low[:, :2] <= high)).all(axis=1)
        rows = np.flatnonzero(here)
        heading = float(walk.heading_rad[i])
        seen = in_frustum(city.low[rows], city.high[rows], walk.place[i], heading)
        near[rows[seen]] = True
        first = near.copy() if i == 0 else first
    return int((near & ~first).sum())


def per_query(tally: Tally) -> float:
    """Return the reads of one search; 0 where there was none."""
    return tally.reads / max(tally.queries, 1)
