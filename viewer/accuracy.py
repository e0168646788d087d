# SPDX-License-Identifier: Apache-2.0
"""`geopage accuracy`: the geometric pixel error of settled random views, in figures."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from geopage.draw_list import DrawList
from geopage.settings import PagerSettings
from geopage.view import ViewState
from tiles.errors import InputError
from tiles.frames import Ecef, Floats
from tiles.lanes import Lane
from tiles.post_tree import PostTree, build_tree
from tiles.source_posts import read_rasters, terrain_sources
from tiles.store import Store
from viewer.camera import Pose, pixel_rays, view_state
from viewer.drawn_surface import DrawnTiles
from viewer.geometric_error import FrameError, Hits, Seen, geometric_error
from viewer.progress import bar
from viewer.random_views import boxes_of, random_poses
from viewer.renderer import Renderer
from viewer.session import Picture, Session
from viewer.tally import Judged, Tally

NO_OBJECTS_PX = 1e9
COLUMNS = (
    *("lat_deg", "lon_deg", "height_m", "heading_deg", "pitch_deg", "judged"),
    *("p50", "p95", "p99", "max", "share_within_threshold", "raised_threshold_px"),
)
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


def accuracy(
    store: Path,
    settings: PagerSettings,
    picture: Picture,
    count: int,
    seed: int,
    out: Path | None = None,
) -> Json:
    """Judge settled random views of a store's terrain.

    Returns
    -------
    The `geometric_error_px` object, with the views' settings and the worst view.

    Raises
    ------
    InputError
    """
    alone = replace(settings, object_threshold_px=NO_OBJECTS_PX)
    with Session(store, alone, picture) as session:
        judge = Judge(session)
        sources = terrain_sources(session.store)
        poses = random_poses(session.surface, boxes_of(sources), count, seed)
        tally = Tally(settings.threshold_px)
        with bar("judging views", count, "views") as show:
            for done, pose in enumerate(poses):
                tally.add(judge_pose(session, judge, pose, settings.threshold_px))
                show(done + 1)
        about = {"views": count, "seed": seed, "size_px": picture.size_px}
        report = {**tally.figures(), **about, "faults": list(session.pager.faults)}
    if out:
        write(out, report, tally.rows)
    return report


def judge_pose(session: Session, judge: Judge, pose: Pose, threshold_px: float) -> Judged:
    """Settle one view, draw its terrain alone, and measure it."""
    view = view_state(pose, session.picture.size_px)
    drawn, _ = session.settle(view)
    bare = without_objects(drawn)
    session.renderer.draw(bare, view)
    about: Json = {
        "lat_deg": math.degrees(pose.lat_rad),
        "lon_deg": math.degrees(pose.lon_rad),
        "height_m": pose.height_m,
        "heading_deg": math.degrees(pose.heading_rad),
        "pitch_deg": math.degrees(pose.pitch_rad),
    }
    if drawn.threshold_px > threshold_px * (1 + 1e-9):
        about["raised_threshold_px"] = drawn.threshold_px  # memory was short
    return Judged(about, judge.judge(bare, seen_in(session.renderer, view), threshold_px))


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


def write(out: Path, report: Json, rows: list[Json]) -> None:
    """Write accuracy.json, and views.csv with a line per view.

    Raises
    ------
    InputError
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        text = json.dumps(report, indent=2, allow_nan=False)
        (out / "accuracy.json").write_text(text + "\n")
        with (out / "views.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, COLUMNS)
            table.writeheader()
            table.writerows(rows)
    except OSError as error:
        advice = "name a folder that can be made"
        raise InputError(out, str(error.strerror or error), advice) from error


def summary(found: Json) -> str:
    """Say what was measured in a few lines."""
    if not found["pixels_judged"]:
        return "no pixel could be judged: no view shows a place where a source has posts"
    worst, share = found["worst_view"], {k: 100 * v for k, v in shares(found).items()}
    lines = [
        f"geometric error of {found['views']} views: p50 {found['p50']:.2f} px,"
        f" p95 {found['p95']:.2f}, p99 {found['p99']:.2f}, largest {found['max']:.2f}",
        f"{share['within_threshold']:.4f} % of {found['pixels_judged']:,} pixels are"
        f" within {found['threshold_px']:g} px or the leaf's own bound; the leaf limits"
        f" {share['limited_by_leaf']:.2f} %; {share['not_judged']:.2f} % were not judged",
        f"worst pixel: {worst['error_px']:.2f} px, allowed {worst['limit_px']:.2f} px;"
        f" seen with --at {worst['lat_deg']:.6f},{worst['lon_deg']:.6f},"
        f"{worst['height_m']:.2f} --height-reference ellipsoid"
        f" --look {worst['heading_deg']:.3f},{worst['pitch_deg']:.3f}",
    ]
    if "views_with_raised_threshold" in found:
        raised = found["views_with_raised_threshold"]
        lines.append(
            f"{raised} views needed more than --budget: their threshold was raised"
        )
    if "silhouette" in found:
        moved = {k: 100 * v for k, v in shares(found["silhouette"]).items()}
        lines.append(
            f"silhouettes: {moved['displaced']:.3f} % of pixels show another side,"
            f" {moved['beyond_limit']:.3f} % by more than the limit and a pixel"
        )
    return "\n".join(lines)


def shares(found: Json) -> Json:
    """Return the shares of a report, by their names without `share_`."""
    prefix = "share_"
    return {
        key.removeprefix(prefix): value
        for key, value in found.items()
        if key.startswith(prefix)
    }
