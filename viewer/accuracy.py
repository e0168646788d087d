# SPDX-License-Identifier: Apache-2.0
"""`geopage accuracy`: the geometric pixel error of settled random views, in figures."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from geopage.draw_list import DrawList
from geopage.progress import bar
from geopage.settings import MIB, PagerSettings
from geopage.view import ViewState
from tiles.frames import Ecef, Floats
from tiles.lanes import Lane
from tiles.post_tree import PostTree, build_tree
from tiles.source_posts import read_rasters, terrain_sources
from tiles.store import Store
from viewer.accuracy_files import write
from viewer.camera import Pose, pixel_rays, view_state
from viewer.drawn_surface import DrawnTiles
from viewer.geometric_error import FrameError, Hits, Seen, geometric_error, reference
from viewer.globe_flights import globe_flights
from viewer.machine import machine
from viewer.random_heights import random_heights
from viewer.random_views import boxes_of, random_poses
from viewer.renderer import Renderer
from viewer.selection_times import selection_times
from viewer.session import Picture, Session
from viewer.tally import Judged, Tally

NO_OBJECTS_PX = 1e9
Json = dict[str, Any]


class Judge:
    """Measures frames of one store against its sources."""

    def __init__(self, session: Session) -> None:
        self.tree = read_tree(session.store)
        self._tiles = DrawnTiles(session.store, session.pager.forests[Lane.TERRAIN])

    def judge(
        self,
        drawn: DrawList,
        seen: Seen,
        threshold_px: float,
        *,
        tiles: DrawnTiles | None = None,
        hits: Hits | None = None,
        silhouettes: bool = True,
    ) -> FrameError:
        """Measure what was drawn from a list.

        Parameters
        ----------
        tiles : what was drawn, where it is not what the store holds
        hits, silhouettes : as in `geometric_error`
        """
        tiles = tiles or self._tiles
        surface, errors = tiles.surface(drawn), tiles.leaf_error_m(drawn)
        return geometric_error(
            self.tree,
            surface,
            errors,
            seen,
            threshold_px,
            hits=hits,
            silhouettes=silhouettes,
        )


def read_tree(store: Store) -> PostTree:
    """Read all posts of a store, showing how far it is."""
    posts = sum(int(s["width"]) * int(s["height"]) for s in terrain_sources(store))
    with bar("reading the sources' posts", posts, "posts") as show:
        return build_tree(read_rasters(store, show))


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be measured."""

    thresholds_px: tuple[float, ...]
    views: int
    seed: int = 1
    size_px: tuple[int, int] = (320, 240)
    budget_bytes: int = 512 * MIB
    all: bool = False
    """besides views: heights at random places, flights over the poles, selection"""


def accuracy(store: Path, asked: Asked, out: Path | None = None) -> Json:
    """Judge settled random views of a store's terrain.

    Parameters
    ----------
    out : folder for accuracy.json, views.csv, ACCURACY.md and its chart

    Returns
    -------
    The settings, and the `geometric_error_px` object with the worst view; of several
    thresholds a list `thresholds` of such objects. With `all` also `heights`, `flights`
    and `selection`.

    Raises
    ------
    InputError
    """
    finest_px = min(asked.thresholds_px)
    settings = PagerSettings(finest_px, NO_OBJECTS_PX, asked.budget_bytes)
    with Session(store, settings, Picture(asked.size_px)) as session:
        judge = Judge(session)
        tallies = judge_views(session, judge, asked)
        report = report_of(session, asked, tallies)
        if asked.all:
            report["heights"] = random_heights(
                session.surface, judge.tree, session.store, asked.seed
            )
            report["flights"] = globe_flights(session, asked.thresholds_px)
            report["selection"] = selection_times(session.pager.forests)
    if out:
        write(out, report, tallies)
    return report


def judge_views(session: Session, judge: Judge, asked: Asked) -> list[Tally]:
    """Settle, draw and measure every view at every threshold, the largest first.

    The finer tiles of a smaller threshold then never stay in a view of a larger one.
    """
    boxes = boxes_of(terrain_sources(session.store))
    poses = random_poses(session.surface, boxes, asked.views, asked.seed)
    tallies = [Tally(px) for px in sorted(asked.thresholds_px)]
    with bar("judging views", asked.views, "views") as show:
        for done, pose in enumerate(poses):
            hits = None
            for tally in reversed(tallies):
                session.pager.set_limits(tally.threshold_px, NO_OBJECTS_PX)
                judged, hits = judge_pose(session, judge, pose, tally.threshold_px, hits)
                tally.add(judged)
            show(done + 1)
    return tallies


def report_of(session: Session, asked: Asked, tallies: list[Tally]) -> Json:
    """Return all views in figures, and where they were measured."""
    found = []
    for tally in tallies:
        triangles = [row["triangles"] for row in tally.rows]
        found.append(tally.figures() | {"triangles_mean": float(np.mean(triangles))})
    views = found[0] if len(found) == 1 else {"thresholds": found}
    about = {"views": asked.views, "seed": asked.seed, "size_px": asked.size_px}
    where = {"store": session.store.path.name, "machine": machine(session.renderer.gl)}
    return {**views, **about, **where, "faults": list(session.pager.faults)}


def judge_pose(
    session: Session,
    judge: Judge,
    pose: Pose,
    threshold_px: float,
    hits: Hits | None = None,
) -> tuple[Judged, Hits]:
    """Settle one view, draw its terrain alone, and measure it.

    Parameters
    ----------
    hits : what this returned for the same pose, where it was asked before
    """
    view = view_state(pose, session.picture.size_px)
    drawn, _ = session.settle(view)
    bare = without_objects(drawn)
    stats = session.renderer.draw(bare, view)
    about: Json = {
        "threshold_px": threshold_px,
        "lat_deg": math.degrees(pose.lat_rad),
        "lon_deg": math.degrees(pose.lon_rad),
        "height_m": pose.height_m,
        "heading_deg": math.degrees(pose.heading_rad),
        "pitch_deg": math.degrees(pose.pitch_rad),
        "triangles": stats.triangles,
    }
    if drawn.threshold_px > threshold_px * (1 + 1e-9):
        about["raised_threshold_px"] = drawn.threshold_px  # memory was short
    seen = seen_in(session.renderer, view)
    hits = hits or reference(judge.tree, seen)
    return Judged(about, judge.judge(bare, seen, threshold_px, hits=hits)), hits


def without_objects(drawn: DrawList) -> DrawList:
    """Return a list's terrain alone."""
    rows, own, proxies = np.zeros(0, np.int32), np.zeros(0, bool), np.zeros(0, np.uint8)
    return replace(drawn, objects=rows, own=own, proxies=proxies)


def seen_in(renderer: Renderer, view: ViewState) -> Seen:
    """Return what the renderer's last frame shows."""
    ids = renderer.read_ids()
    tile = np.where(ids > 0, ids - 1, -1).astype(np.int64)
    points: Floats = renderer.read_positions()
    return Seen(view.eye, view.forward, view.focal_px, pixel_rays(view), Ecef(points), tile)
