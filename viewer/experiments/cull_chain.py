# SPDX-License-Identifier: Apache-2.0
"""E2: what each stage of culling and of detail leaves, as in Berkeley 1992 and MMR 1999.

Along two sample paths through San Francisco, of whose 13,024 buildings all are drawn at
full detail at first. Triangles are the buildings' alone. Two stages that we do not have
are worked out beside the chain, from the objects' spheres and from the picture's own
ids, to say what they would bring; others, which need rooms or impostors, are only named.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.selection import ideal
from geopage.settings import MIB, PagerSettings
from geopage.view import ViewState
from tiles import objects
from tiles.frames import Ecef, Floats, Ints
from tiles.lanes import Lane
from viewer.cull import eye_of
from viewer.experiments.cull_rows import THRESHOLDS_PX, Chain, figures
from viewer.experiments.rows import Found, Progress
from viewer.experiments.setting import Setting, sample_flight
from viewer.session import Picture, Session

SIZE_PX = (640, 360)
WALK, AROUND = "street_revisit", "street_orbit"
NOTHING = np.zeros(0, np.int32)
OWN_SHIFT = 1 << 16


@dataclass(frozen=True, slots=True)
class Buildings:
    """All buildings of a store, tile after tile."""

    rows: Ints
    """(t,) forest rows of their tiles"""
    first: Ints
    """(t + 1,) where each tile's buildings begin"""
    triangles: Ints
    """(n,)"""
    centre: Ecef
    """(n, 3)"""
    radius_m: Floats


def buildings_of(session: Session) -> Buildings:
    """Read all object tiles."""
    records = session.pager.forests[Lane.OBJECTS].records
    rows = np.flatnonzero(records["own_dimension_m"] > 0)
    tables, centres, counts = [], [], []
    for record in records[rows]:
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        tile = objects.decode(session.store.checked_body(Lane.OBJECTS, *key))
        tables.append(tile.objects)
        centres.append(tile.objects["centre"] + tile.mesh.centre)
        counts.append(np.diff(tile.objects["index_end"].astype(np.int64), prepend=0) // 3)
    first = np.concatenate(([0], np.cumsum([len(table) for table in tables])))
    table = np.concatenate(tables)
    return Buildings(
        rows,
        first,
        np.concatenate(counts),
        Ecef(np.concatenate(centres)),
        table["radius_m"].astype(np.float64),
    )


def run(setting: Setting, show: Progress) -> Found:
    """Run the experiment."""
    store = setting.world()
    settings = PagerSettings(2.0, budget_bytes=512 * MIB, fade_s=0.0)
    chains = {}
    count = int(setting.pick(12, 6))
    with Session(store, settings, Picture(SIZE_PX)) as session:
        for i, name in enumerate((WALK, AROUND)):
            flight = sample_flight(store, name, SIZE_PX)
            times_s = np.linspace(0, flight.path.duration_s, count, endpoint=False)
            views = [flight.view(t_s) for t_s in times_s.tolist()]

            def done(share: float, before: float = 50.0 * i) -> None:
                show(before + 50 * share)

            chains[name] = measure(session, views, done)
    return figures(chains[WALK], chains[AROUND])


def measure(session: Session, views: Sequence[ViewState], show: Progress) -> Chain:
    """Take buildings through the chain at some views."""
    town = buildings_of(session)
    chain = Chain(len(town.triangles), int(town.triangles.sum()))
    for i, view in enumerate(views):
        whole = everything(session, town, view)
        session.hold(whole)
        by_tile = in_view(town, view, session)
        by_sphere = spheres_in_view(town, view)
        shown = visible(session, town, whole, view)
        for name, kept in (
            ("tiles in view", by_tile),
            ("buildings in view", by_sphere),
            ("buildings with a pixel", shown),
        ):
            chain.add(name, int(kept.sum()), int(town.triangles[kept].sum()))
        _details(session, view, chain)
        _times(session, whole, view, chain)
        show((i + 1) / len(views))
    return chain


def everything(session: Session, town: Buildings, view: ViewState) -> DrawList:
    """Return a list of all buildings at full detail, on the ground of the view."""
    plain = ideal(session.pager.forests, view, 2.0, 2.0)
    count = len(town.rows)
    return replace(
        plain,
        objects=town.rows.astype(np.int32),
        own=np.ones(count, np.bool_),
        proxies=np.zeros(count, np.uint8),
        object_threshold_px=1e-9,
    )


def without_ground(drawn: DrawList) -> DrawList:
    """Return a list with nothing but its objects."""
    none_m, no = np.zeros(0, np.float32), np.zeros(0, np.bool_)
    return replace(drawn, terrain=NOTHING, skirt_m=none_m, stand_in=no)


def in_view(town: Buildings, view: ViewState, session: Session) -> NDArray[np.bool_]:
    """Say which buildings are in tiles that our culling keeps."""
    forest = session.pager.forests[Lane.OBJECTS]
    keep = spheres(forest.centre[town.rows], forest.radius_m[town.rows], view)
    return np.repeat(keep, np.diff(town.first))


def spheres_in_view(town: Buildings, view: ViewState) -> NDArray[np.bool_]:
    """Say which buildings a cull of each one would keep."""
    return spheres(town.centre, town.radius_m, view)


def spheres(centre: Floats, radius_m: Floats, view: ViewState) -> NDArray[np.bool_]:
    """Say which spheres reach into the view's pyramid."""
    away = (centre - view.eye) @ eye_of(view).planes.T
    return np.asarray((away >= -radius_m[:, None]).all(axis=1))


def visible(
    session: Session, town: Buildings, whole: DrawList, view: ViewState
) -> NDArray[np.bool_]:
    """Say which buildings own a pixel of the picture with everything in it."""
    session.renderer.draw(whole, view)
    ids = np.unique(session.renderer.read_ids())
    entry, ordinal = np.divmod(-1 - ids[ids < 0].astype(np.int64), OWN_SHIFT)
    found = np.zeros(len(town.triangles), np.bool_)
    place = town.first[entry] + ordinal
    found[place[place < town.first[entry + 1]]] = True
    return found


def _details(session: Session, view: ViewState, chain: Chain) -> None:
    """Count what is drawn at each threshold."""
    for px in THRESHOLDS_PX:
        drawn = ideal(session.pager.forests, view, px, px)
        session.hold(drawn)
        stats = session.renderer.draw(without_ground(drawn), view)
        chain.add(f"{px:g} px", stats.objects, stats.triangles)


def _times(session: Session, whole: DrawList, view: ViewState, chain: Chain) -> None:
    """Time everything without culling, with culling, and at the default threshold."""
    ours = ideal(session.pager.forests, view, 2.0, 2.0)
    lists = {"all": whole, "in view": whole, "2 px": ours}
    for drawn in lists.values():
        session.hold(drawn)
    for name, drawn in lists.items():
        session.renderer.culls = name != "all"
        bare = without_ground(drawn)
        times_ms = [session.renderer.draw(bare, view).frame_ms for _ in range(4)]
        chain.times_ms.setdefault(name, []).append(min(times_ms[1:]))
    session.renderer.culls = True
