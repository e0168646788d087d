# SPDX-License-Identifier: Apache-2.0
"""E5: the fly-in of VGIS, with and without the hierarchy, over towns of 471 buildings."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from geopage.draw_list import DrawList
from geopage.screen_error import lens_of
from geopage.selection import Thresholds, everything, select, trees_of
from geopage.settings import MIB, PagerSettings
from geopage.view import ViewState
from tiles.forest import Forest
from tiles.lanes import Lane
from viewer.bench_choices import without_proxies
from viewer.camera import Pose, focal_px, view_state
from viewer.experiments.fly_in_rows import (
    ALL,
    LEVELS,
    METHODS,
    ONE,
    Drawn,
    Town,
    figures,
)
from viewer.experiments.rows import Found, Progress
from viewer.experiments.setting import Setting
from viewer.experiments.town import COUNT, LAT_DEG, LON_DEG, TOWER_M, bare_copy, build
from viewer.session import Picture, Session

SIZE_PX = (790, 592)
"""At 60 degrees 1 px is 1/513 rad: then a tower of 312 m is 1 px at the paper's 160 km"""
FOV_RAD = math.radians(60.0)
TERRAIN_PX, FINE_PX, COARSE_PX = 1.0, 1.0, 10.0
DRAWS = 3
HIGHEST_M, LOWEST_M = 1.2e7, 10.0
BUDGET_BYTES = 512 * MIB
PAN_M, ORBIT_M, ORBIT_RADIUS_M, TURNS = 300.0, 500.0, 3000.0, 8
Forests = dict[Lane, Forest]


def run(setting: Setting, show: Progress) -> Found:
    """Run the experiment."""
    copies = (1, 4, 16) if setting.quick else (1, 4, 16, 64)
    count = int(setting.pick(12, 8))
    store = setting.data / "town.geopage"
    bare_copy(setting.world(), store)
    towns = []
    for i, times in enumerate(copies):
        assert build(store, times) == COUNT * times
        show(100 * (i + 0.3) / len(copies))
        towns.append(measure(store, COUNT * times, count))
        show(100 * (i + 1) / len(copies))
    return figures(towns)


def measure(
    store: Path, buildings: int, count: int, size_px: tuple[int, int] = SIZE_PX
) -> Town:
    """Measure one town."""
    settings = PagerSettings(TERRAIN_PX, budget_bytes=BUDGET_BYTES, fade_s=0.0)
    with Session(store, settings, Picture(size_px)) as session:
        ground_m = float(
            session.surface.heights(*(np.radians([x]) for x in (LON_DEG, LAT_DEG)))[0][0]
        )
        heights_m = np.geomspace(HIGHEST_M, LOWEST_M, count).tolist()
        views = [descent(height_m, ground_m, size_px) for height_m in heights_m]
        forests = session.pager.forests
        cases = {
            method: [(drawn_by(method, forests, view), view) for view in views]
            for method in METHODS
        }
        by_height = in_turn(session, cases)
        turning = {}
        for name, round_ in (("pan", pan), ("orbit", orbit)):
            around = round_(ground_m, size_px)
            for culls in (True, False):
                lists = [chosen(forests, view, FINE_PX, culls=culls) for view in around]
                session.renderer.culls = culls
                both = {name: list(zip(lists, around, strict=True))}
                turning[name, culls] = in_turn(session, both)[name]
            session.renderer.culls = True
        first_m, expected_m = first_building(forests, ground_m, size_px)
        return Town(buildings, heights_m, by_height, turning, first_m, expected_m)


def descent(height_m: float, ground_m: float, size_px: tuple[int, int]) -> ViewState:
    """Return a view of the town's middle: from above, and more level near the ground."""
    share = np.clip(math.log(height_m / 100.0) / math.log(1000.0), 0.0, 1.0)
    pitch = math.radians(-20.0 - 70.0 * float(share))
    back_m = height_m / math.tan(-pitch) if share < 1 else 0.0
    return view_from(0.0, -back_m, height_m + ground_m, 0.0, pitch, size_px)


def view_from(
    east_m: float,
    north_m: float,
    height_m: float,
    heading: float,
    pitch: float,
    size_px: tuple[int, int],
) -> ViewState:
    """Return a view from metres east and north of the town's middle."""
    lat, lon = math.radians(LAT_DEG), math.radians(LON_DEG)
    earth_m = 6_371_000.0
    pose = Pose(
        lon + east_m / (earth_m * math.cos(lat)),
        lat + north_m / earth_m,
        height_m,
        heading,
        pitch,
    )
    return view_state(pose, size_px, FOV_RAD)


def pan(ground_m: float, size_px: tuple[int, int]) -> list[ViewState]:
    """Turn around above the town's middle."""
    turns = np.linspace(0, 2 * math.pi, TURNS, endpoint=False).tolist()
    pitch = math.radians(-10.0)
    return [view_from(0.0, 0.0, ground_m + PAN_M, turn, pitch, size_px) for turn in turns]


def orbit(ground_m: float, size_px: tuple[int, int]) -> list[ViewState]:
    """Fly around the town's middle and look at it."""
    turns = np.linspace(0, 2 * math.pi, TURNS, endpoint=False).tolist()
    pitch = -math.atan2(ORBIT_M, ORBIT_RADIUS_M)
    return [
        view_from(
            -ORBIT_RADIUS_M * math.sin(turn),
            -ORBIT_RADIUS_M * math.cos(turn),
            ground_m + ORBIT_M,
            turn,
            pitch,
            size_px,
        )
        for turn in turns
    ]


def chosen(
    forests: Forests, view: ViewState, objects_px: float, *, culls: bool = True
) -> DrawList:
    """Return what a view draws when all is there; without culling, in all directions."""
    trees = trees_of(forests)
    lens = lens_of(view)
    if not culls:
        lens = lens._replace(cone_cos=-1.0, cone_sin=0.0)
    limits = Thresholds(TERRAIN_PX, objects_px)
    return select(trees, lens, everything(trees), limits).draw_list(
        1, view, limits, settled=True
    )


def drawn_by(method: str, forests: Forests, view: ViewState) -> DrawList:
    """Return what a method draws of a view."""
    if method == LEVELS:
        return chosen(forests, view, COARSE_PX)
    if method == ONE:
        return without_proxies(forests, view, FINE_PX)
    plain = chosen(forests, view, FINE_PX)
    records = forests[Lane.OBJECTS].records
    rows = np.flatnonzero((records["own_dimension_m"] > 0) & (method == ALL))
    return replace(
        plain,
        objects=rows.astype(np.int32),
        own=np.ones(len(rows), np.bool_),
        proxies=np.zeros(len(rows), np.uint8),
        object_threshold_px=1e-9,
    )


def in_turn(
    session: Session, cases: dict[str, list[tuple[DrawList, ViewState]]]
) -> dict[str, list[Drawn]]:
    """Draw views, at each all methods in turn; the shortest of some draws counts."""
    found: dict[str, list[Drawn]] = {method: [] for method in cases}
    for i in range(len(next(iter(cases.values())))):
        times: dict[str, list[float]] = {method: [] for method in cases}
        stats = {}
        for _ in range(DRAWS + 1):
            for method, views in cases.items():
                session.hold(views[i][0])
                stats[method] = session.renderer.draw(*views[i])
                times[method].append(stats[method].frame_ms)
        for method, one in stats.items():
            shortest = min(times[method][1:])
            found[method].append(Drawn(shortest, one.triangles, one.objects))
    return found


def first_building(
    forests: Forests, ground_m: float, size_px: tuple[int, int]
) -> tuple[float, float]:
    """Return the height from where a building is drawn at 1 px, and s f / threshold."""
    low, high = 1e4, 1e7
    while high - low > 1.0:
        middle = (low + high) / 2
        view = view_from(0.0, 0.0, middle + ground_m, 0.0, -math.pi / 2, size_px)
        if len(without_proxies(forests, view, FINE_PX).objects):
            low = middle
        else:
            high = middle
    return low, TOWER_M * focal_px(size_px[1], FOV_RAD) / FINE_PX
