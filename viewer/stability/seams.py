# SPDX-License-Identifier: Apache-2.0
"""Cracks between tiles: anywhere, at the poles, at the antimeridian, at zone corners."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geopage.draw_list import DrawList
from geopage.screen_error import lens_of
from geopage.selection import Flags, Thresholds, everything, select
from geopage.view import ViewState
from tiles import cells
from tiles.lanes import Lane
from viewer.camera import Pose, view_state
from viewer.stability.place import SIZE_PX, Place
from viewer.stability.row import Finding, Row

MOST_GONE = 6
HALVINGS = 8
Random = np.random.Generator
Spot = Callable[[Place, Random], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Shown:
    """A view, and a list as the pager may have it while tiles are on their way."""

    view: ViewState
    drawn: DrawList
    apart: DrawList
    """The same if tiles knew no neighbours in other zones"""


def near(rng: Random, lowest: float, highest: float) -> float:
    """Return an angle, rad, of any order of size, to either side."""
    return float(rng.choice([-1, 1]) * 10.0 ** rng.uniform(lowest, highest))


def anywhere(place: Place, rng: Random) -> tuple[float, float]:
    """Return a place, half the time on the finest ground."""
    if rng.random() < 0.5:
        return float(rng.uniform(-math.pi, math.pi)), float(np.arcsin(rng.uniform(-1, 1)))
    return place.fine_spot(rng)


def pole(_: Place, rng: Random) -> tuple[float, float]:
    """Return a place at one of the poles, or near it."""
    lat = rng.choice([-1, 1]) * (math.pi / 2 - abs(near(rng, -6, -0.5)))
    return float(rng.uniform(-math.pi, math.pi)), float(lat)


def antimeridian(_: Place, rng: Random) -> tuple[float, float]:
    """Return a place beside the antimeridian."""
    lon = near(rng, -7, -1) % (2 * math.pi) - math.pi
    return lon, float(np.arcsin(rng.uniform(-0.99, 0.99)))


def zone_corner(_: Place, rng: Random) -> tuple[float, float]:
    """Return a place near a corner where four zones meet."""
    corner = np.radians(45.0 * rng.integers((-3, -1), (4, 2)))
    return float(corner[0]) + near(rng, -7, -1), float(corner[1]) + near(rng, -7, -1)


def random_pose(place: Place, spot: tuple[float, float], rng: Random) -> Pose:
    """Return a pose 10 m above the ground to 10,000 km, looking anywhere."""
    height_m = place.session.surface.height_at(*spot) + 10.0 ** rng.uniform(1, 7)
    pitch = math.radians(rng.uniform(-90, 30))
    return Pose(*spot, height_m, float(rng.uniform(0, 2 * math.pi)), pitch)


def some_tiles(place: Place, pose: Pose, rng: Random) -> Flags:
    """Return flags without all that lies below a few cells, most of them near the eye.

    What is drawn there instead lies beside the finest tiles: any pair of levels.
    """
    there, cell = everything(place.trees), place.ground.records["cell"]
    for _ in range(rng.integers(0, MOST_GONE)):
        top = int(rng.choice(cell))
        if rng.random() < 0.6:
            lon = pose.lon_rad + near(rng, -5, -1)
            lat = float(np.clip(pose.lat_rad + near(rng, -5, -1), -1.57, 1.57))
            top = int(cells.cell_at(lon, lat, int(rng.integers(0, 8))))
        there[Lane.TERRAIN][cells.contains(top, cell) & (cell != top)] = 0
    return there


def shown(place: Place, spot: Spot, rng: Random) -> Shown:
    """Return a random view of a place, and what may be drawn for it."""
    pose = random_pose(place, spot(place, rng), rng)
    view, there = view_state(pose, SIZE_PX), some_tiles(place, pose, rng)
    threshold_px = float(10.0 ** rng.uniform(-0.5, 1.5))
    land = place.trees[Lane.TERRAIN]
    zone = place.ground.records["cell"] >> 2 * cells.MAX_LEVEL + 1
    alone = np.where(zone[land.links] == zone[:, None], land.links, -1).astype(np.int32)
    trees = {**place.trees, Lane.TERRAIN: land._replace(links=alone)}
    limits = Thresholds(threshold_px, threshold_px)
    apart = select(trees, lens_of(view), there, limits)
    return Shown(
        view,
        place.select(view, threshold_px, there),
        apart.draw_list(1, view, limits, settled=False),
    )


def holes(place: Place, spot: Spot, views: int) -> Finding:
    """Draw random views; then shorten the skirts until the first hole shows."""
    rng, ours, others, apart, breaks = np.random.default_rng(4), 0, 0, 0, 0.0
    for _ in range(views):
        one = shown(place, spot, rng)
        ours += place.holes(one.drawn, one.view) > 0
        apart += place.holes(one.apart, one.view) > 0
        if place.holes(one.drawn, one.view, breaks) > 0:
            breaks = longest_bad(place, one, breaks)
        others += place.holes(one.drawn, one.view, 0.0) > 0
    note = f"{views} views of lists with tiles missing; without links between zones"
    note += f" {apart} of them have a hole"
    return Finding(1.0, ours, breaks or math.nan, 0.0, others, note)


def longest_bad(place: Place, one: Shown, low: float) -> float:
    """Return the largest share of the skirts' depths with which a view has a hole."""
    high = 1.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        is_bad = place.holes(one.drawn, one.view, middle) > 0
        low, high = (middle, high) if is_bad else (low, middle)
    return low


def _row(name: str, fails: str, spot: Spot) -> Row:
    return Row(
        name,
        fails,
        "depth of skirts, share of what is drawn",
        "views with a hole in the ground",
        0.0,
        lambda place: holes(place, spot, place.count(150, 30)),
        more_is_harder=False,
    )


ROWS = (
    _row("cracks", "gaps between tiles of different detail: no skirts", anywhere),
    _row("poles, holes", "the last row of cells leaves a gap: no skirts", pole),
    _row("antimeridian", "tiles end at 180 degrees: no skirts", antimeridian),
    _row("zone corners", "trees end at their zones' edges: no skirts", zone_corner),
)
