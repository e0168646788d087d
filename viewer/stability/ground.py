# SPDX-License-Identifier: Apache-2.0
"""The eye over the horizon, close above the ground, below it, and below the sea."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from geopage.screen_error import is_hidden, lens_of
from geopage.selection import everything
from geopage.view import ViewState
from tiles import cells, geodesy
from tiles.frames import WGS84_B_M, Ecef, Ints
from tiles.lanes import Lane
from viewer.camera import Pose, project, view_state
from viewer.stability.place import SIZE_PX, Place
from viewer.stability.row import Finding, Row, first_bad

EYE_M, HIGHEST_M = 2.0, 1e7
SAME = 1e-3
"""Distances that differ by less than this share are of one surface."""
Random = np.random.Generator
Flags = NDArray[np.bool_]


def horizon(place: Place) -> Finding:
    """Look at the horizon: nothing that was left out behind it may be in sight."""
    rng, ours, others = np.random.default_rng(7), 0, 0
    views = place.count(80, 16)
    for _ in range(views):
        view = horizon_view(place, rng)
        drawn = place.select(view, 2.0)
        place.draw(drawn, view)
        points = place.session.renderer.read_positions()
        hidden, naive = left_out(place, view, drawn.terrain)
        ours += in_sight(place, view, points, drawn.terrain[hidden])
        others += in_sight(place, view, points, drawn.terrain[naive])
    note = f"{views} views from {EYE_M:g} m to 10,000 km above the finer grounds"
    return Finding(EYE_M, ours, math.nan, EYE_M, others, note)


def horizon_view(place: Place, rng: Random) -> ViewState:
    """Return a view at the horizon from any height."""
    lon, lat = place.fine_spot(rng)
    above_m = 10.0 ** rng.uniform(math.log10(EYE_M), math.log10(HIGHEST_M))
    height_m = place.session.surface.height_at(lon, lat) + above_m
    dip = math.acos(WGS84_B_M / (WGS84_B_M + max(height_m, 0.0)))
    return view_state(Pose(lon, lat, height_m, rng.uniform(0, 2 * math.pi), -dip), SIZE_PX)


def left_out(place: Place, view: ViewState, rows: NDArray[np.int32]) -> tuple[Flags, Flags]:
    """Say which tiles are behind the horizon: by our test, and by their middles alone."""
    lens, forest = lens_of(view), place.ground
    spheres = np.column_stack((forest.centre[rows] - view.eye, forest.radius_m[rows]))
    hidden = [is_hidden(lens, x, y, z, radius_m) for x, y, z, radius_m in spheres.tolist()]
    lon, lat, _ = geodesy.to_geodetic(Ecef(forest.centre[rows]))
    at_sea = geodesy.to_ecef(lon, lat, 0.0)
    below = ((at_sea - view.eye) * geodesy.up(lon, lat)).sum(axis=1) > 0
    return np.array(hidden, np.bool_), below


def in_sight(place: Place, view: ViewState, points: Ecef, rows: NDArray[np.int32]) -> int:
    """Count tiles with a vertex in the picture that nothing drawn is in front of."""
    drawn_m = np.linalg.norm(points - view.eye, axis=-1)
    drawn_m = np.where(np.isnan(drawn_m), np.inf, drawn_m)
    count = 0
    for row in rows.tolist():
        tile = place.tiles.tile(row)
        corners = tile.corners[~np.isnan(tile.corners[:, 0])].reshape(-1, 3)
        vertices = Ecef(corners + tile.centre)
        x, y, depth_m = np.moveaxis(project(view, vertices), -1, 0)
        inside = (depth_m > 0) & (x >= 0) & (y >= 0) & (x < SIZE_PX[0]) & (y < SIZE_PX[1])
        at = y[inside].astype(int), x[inside].astype(int)
        away_m = np.linalg.norm(vertices[inside] - view.eye, axis=1)
        count += bool((away_m < drawn_m[at] * (1 - SAME)).any())
    return count


def below_sea(place: Place) -> Finding:
    """Lower the ground and the eye above it until ground in sight counts as hidden."""
    rng = np.random.default_rng(8)
    count = place.count(2000, 400)

    def lost(depth_m: float) -> int:
        return sum(is_lost(depth_m, rng) for _ in range(count))

    breaks_m = first_bad(lambda d: lost(d) == 0, DEEPEST_M, 60_000.0, 10)
    others = sum(is_lost(DEEPEST_M, rng, lowest_m=0.0) for _ in range(count))
    note = f"{count} points of ground in sight; others: an occluder at sea level"
    return Finding(DEEPEST_M, lost(DEEPEST_M), breaks_m, 60_000.0, others, note)


DEEPEST_M = 10_935.0
"""Challenger Deep"""


def is_lost(depth_m: float, rng: Random, lowest_m: float | None = None) -> bool:
    """Say whether a point on level ground below the sea counts as hidden, though seen."""
    # At a pole, where the planet's surface is nearest to its middle.
    lon, lat = rng.uniform(-math.pi, math.pi), math.pi / 2
    above_m = 10.0 ** rng.uniform(0.3, 5)
    view = view_state(Pose(lon, lat, above_m - depth_m, 0.0, 0.0), SIZE_PX)
    reach = math.sqrt(2 * above_m / WGS84_B_M) * rng.uniform(0.05, 0.95)
    lat -= reach
    point = geodesy.to_ecef(lon, lat, -depth_m)
    lens = lens_of(view) if lowest_m is None else lens_of(view, lowest_m=lowest_m)
    faces_eye = (view.eye - point) @ geodesy.up(lon, lat) > 0
    x, y, z = (point - view.eye).tolist()
    return bool(faces_eye and is_hidden(lens, x, y, z, 0.0))


def stand_ins(place: Place) -> Finding:
    """Stand on the finest ground while only the coarsest is there; then go below it."""
    rng, cell = np.random.default_rng(9), place.ground.records["cell"]
    spots = [place.fine_spot(rng) for _ in range(place.count(24, 6))]

    def bad(above_m: float) -> int:
        return sum(has_hole(place, spot, above_m, cell) for spot in spots)

    ours = bad(EYE_M)
    depths_m = [-(10.0**k) for k in range(-2, 4)]
    heights_m = [EYE_M, 1.5, 1.0, 0.7, 0.5, 0.35, 0.25, 0.1, 0.03, *depths_m]
    breaks_m = next((b for a, b in pairwise(heights_m) if bad(b)), math.nan)
    note = "the finest tiles, and stand-ins that are up to kilometres above the eye"
    return Finding(EYE_M, ours, breaks_m, heights_m[-1], note=note)


def has_hole(place: Place, spot: tuple[float, float], above_m: float, cell: Ints) -> bool:
    """Say whether the ground has a hole, seen from so high above it, at any detail."""
    height_m = place.session.surface.height_at(*spot) + above_m
    for pitch in (-math.pi / 2, -0.3):
        view = view_state(Pose(*spot, height_m, 1.0, pitch), SIZE_PX)
        for level in (0, 2, 5, 30):
            there = everything(place.trees)
            there[Lane.TERRAIN][cells.level(cell) > level] = 0
            if place.holes(place.select(view, 2.0, there), view):
                return True
    return False


def odd_pictures(place: Place) -> Finding:
    """Draw slimmer and slimmer pictures, of wide and narrow views: none has a hole."""
    count = place.count(12, 4)

    def bad(ratio: float) -> int:
        sizes = (round(LINES * ratio), LINES), (LINES, round(LINES * ratio))
        return sum(holes_in(place, size_px, count) for size_px in sizes)

    breaks = first_bad(lambda ratio: bad(ratio) == 0, SLIM, SLIMMEST, place.count(5, 2))
    note = f"fields of view from {FIELDS_DEG[0]:g} to {FIELDS_DEG[1]:g} degrees"
    found = Finding(SLIM, bad(SLIM), breaks, SLIMMEST, note=note)
    place.session.renderer.resize(SIZE_PX)
    return found


def holes_in(place: Place, size_px: tuple[int, int], count: int) -> int:
    """Return how many of some pictures of a size have a hole."""
    rng, found = np.random.default_rng(10), 0
    place.session.renderer.resize(size_px)
    for _ in range(count):
        lon, lat = place.fine_spot(rng)
        height_m = place.session.surface.height_at(lon, lat) + 10.0 ** rng.uniform(1, 6)
        pose = Pose(lon, lat, height_m, rng.uniform(0, 6), rng.uniform(-1.5, 0))
        view = view_state(pose, size_px, math.radians(rng.uniform(*FIELDS_DEG)))
        found += place.holes(place.select(view, 4.0), view) > 0
    return found


LINES, SLIM, SLIMMEST, FIELDS_DEG = 24, 32 / 9, 300.0, (2.0, 150.0)
ROWS = (
    Row(
        "odd pictures",
        "ground is missing at the ends of a very wide or very high picture",
        "longer side / shorter side of the picture",
        "pictures with a hole in the ground",
        0.0,
        odd_pictures,
    ),
    Row(
        "horizon",
        "mountains behind the horizon are missing: a test of tiles' middles at sea level",
        "height of the eye above the ground, m",
        "tiles left out of which something is in sight",
        0.0,
        horizon,
        more_is_harder=False,
    ),
    Row(
        "below sea level",
        "ground below the sea is missing: an occluder at sea level",
        "depth of ground and eye below the ellipsoid, m",
        "points in sight that count as hidden",
        0.0,
        below_sea,
    ),
    Row(
        "eye near the ground",
        "one looks through the ground from below: stand-ins above the eye",
        "height of the eye above the finest ground, m",
        "places with a hole, at any detail",
        0.0,
        stand_ins,
        more_is_harder=False,
    ),
)
