# SPDX-License-Identifier: Apache-2.0
"""Views of any width, shape and direction: what a metre takes on the screen."""

import math

import numpy as np

from geopage.cell_error import error_px_per_m
from geopage.screen_error import NEAR_M, is_hidden, lens_of, px_per_m
from geopage.view import ViewState
from tiles import cells, geodesy
from tiles.frames import Ecef, Floats
from tiles.lanes import Lane
from viewer.camera import FOV_RAD, Pose, project, rotation, view_state
from viewer.stability.place import SCREEN_PX, Place
from viewer.stability.row import Finding, Row, first_bad

Size = tuple[int, int]
STEP = 1e-4
WIDE_DEG, WIDEST_DEG = 60.0, 175.0
SLIM, SLIMMEST = 16 / 9, 1000.0
TURN_RAD = 1e-9
ROUNDED = 1.0 + 1e-6
Random = np.random.Generator


def underrated(size_px: Size, fov_rad: float, spheres: int) -> tuple[float, float]:
    """Return the largest of (pixels of a metre) / (what the selection reckons with).

    Small lengths in all directions, at random points of random spheres, are projected.

    Returns
    -------
    ours, and the same for focal length / distance alone
    """
    rng = np.random.default_rng(5)
    # Straight up: the planet, which hides things, is out of the way.
    view = view_state(Pose(0.4, 0.8, 500.0, 1.0, math.pi / 2), size_px, fov_rad)
    lens, ours, others = lens_of(view), 0.0, 0.0
    for _ in range(spheres):
        away_m = 10.0 ** rng.uniform(0, 6)
        centre = view.eye + way_into(view, rng) * away_m
        radius_m = float(away_m * rng.uniform(0.0, 0.9))
        points = Ecef(centre + radius_m * in_ball(rng, 24))
        seen = project(view, points)
        inside = (
            (seen[:, 2] > 0) & (seen[:, :2] >= 0).all(1) & (seen[:, :2] <= size_px).all(1)
        )
        if inside.any():
            most = float(scales(view, Ecef(points[inside]), rng).max())
            x, y, z = centre.tolist()
            ours = max(ours, most / px_per_m(lens, x, y, z, radius_m))
            others = max(others, most * (away_m - radius_m) / view.focal_px)
    return ours, others


def underrated_ground(place: Place, fov_rad: float, views: int) -> tuple[float, float]:
    """Do the same for a metre of error (focal length / depth) in cells of the ground.

    The others' bound is focal length / distance to the cell's sphere.
    """
    rng, ours, others = np.random.default_rng(5), 0.0, 0.0
    tree, records = place.trees[Lane.TERRAIN], place.ground.records
    for _ in range(views):
        row = int(rng.integers(len(records)))
        lon, lat, height_m = in_cell(records[row], rng)
        points = geodesy.to_ecef(lon, lat, height_m)
        above_m = height_m[0] + tree.radius_m[row] * 10.0 ** rng.uniform(-3, 1)
        heading, pitch = rng.uniform(0, 2 * math.pi), rng.uniform(-math.pi / 2, 0)
        pose = Pose(lon[0], lat[0], above_m, heading, pitch)
        view = view_state(pose, SCREEN_PX, fov_rad)
        seen = project(view, points)
        inside = (seen[:, 2] > 0) & (seen[:, :2] >= 0).all(1)
        inside &= (seen[:, :2] <= SCREEN_PX).all(1)
        lens, centre = lens_of(view), tree.centre[row]
        x, y, z = (centre - view.eye).tolist()
        if not inside.any() or is_hidden(lens, x, y, z, tree.radius_m[row]):
            continue
        most = view.focal_px / float(seen[inside, 2].min())
        bound = error_px_per_m(
            lens, centre, tree.radius_m[row], tree.box_m[row], tree.box_rad[row]
        )
        away_m = max(math.hypot(x, y, z) - float(tree.radius_m[row]), NEAR_M)
        ours, others = (
            max(ours, most / bound),
            max(others, most * away_m / view.focal_px),
        )
    return ours, others


def in_cell(record: np.void, rng: Random) -> tuple[Floats, Floats, Floats]:
    """Return random places in a cell, (24,) each: longitude, latitude, height."""
    west, south, east, north = cells.bounds_rad(record["cell"])
    low, high = float(record["min_height_m"]), float(record["max_height_m"])
    sides = np.array(((west, east), (south, north), (low, high)))
    lon, lat, height_m = rng.uniform(sides[:, :1], sides[:, 1:], (3, 24))
    return lon, lat, height_m


def way_into(view: ViewState, rng: Random) -> Floats:
    """Return a unit vector through a random pixel."""
    half = np.array((view.width_px, view.height_px)) / 2
    x, y = rng.uniform(-half, half) / view.focal_px
    way = np.array((x, y, -1.0)) @ view.rotation
    return np.asarray(way / np.linalg.norm(way))


def in_ball(rng: Random, count: int) -> Floats:
    """Return points of the unit ball, (count, 3)."""
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return np.asarray(ways * rng.uniform(size=(count, 1)) ** (1 / 3))


def scales(view: ViewState, points: Ecef, rng: Random) -> Floats:
    """Return pixels per metre of short lengths at points, (n,), the largest of some."""
    found = np.zeros(len(points))
    depth_m = (points - view.eye) @ view.forward
    for _ in range(8):
        way = rng.normal(size=points.shape)
        way *= STEP * depth_m[:, None] / np.linalg.norm(way, axis=1, keepdims=True)
        moved = (project(view, points + way) - project(view, points))[:, :2]
        length_m = np.linalg.norm(way, axis=1)
        found = np.maximum(found, np.linalg.norm(moved, axis=1) / length_m)
    return found / (1.0 + 4 * STEP)


def field_of_ground(place: Place) -> Finding:
    """Widen the field of view until the selection underrates an error of the ground."""
    count = place.count(1500, 400)

    def worst(deg: float) -> tuple[float, float]:
        return underrated_ground(place, math.radians(deg), count)

    breaks_deg = first_bad(lambda deg: worst(deg)[0] <= ROUNDED, WIDE_DEG, WIDEST_DEG, 6)
    ours, others = worst(WIDE_DEG)
    return Finding(WIDE_DEG, ours, breaks_deg, WIDEST_DEG, others)


def field(place: Place) -> Finding:
    """Widen the field of view until the selection underrates a building."""
    count = place.count(1500, 300)

    def worst(deg: float) -> tuple[float, float]:
        return underrated(SCREEN_PX, math.radians(deg), count)

    breaks_deg = first_bad(lambda deg: worst(deg)[0] <= 1.0, WIDE_DEG, WIDEST_DEG, 6)
    ours, others = worst(WIDE_DEG)
    return Finding(WIDE_DEG, ours, breaks_deg, WIDEST_DEG, others)


def aspect(place: Place) -> Finding:
    """Make the picture wider, and narrower, until the selection underrates something."""
    count = place.count(1000, 200)

    def worst(ratio: float) -> tuple[float, float]:
        shapes = (round(720 * ratio), 720), (720, round(720 * ratio))
        return max(underrated(one, FOV_RAD, count) for one in shapes)

    breaks = first_bad(lambda ratio: worst(ratio)[0] <= 1.0, SLIM, SLIMMEST, 6)
    ours, others = worst(SLIM)
    return Finding(SLIM, ours, breaks, SLIMMEST, others)


def turning(place: Place) -> Finding:
    """Look straight down, and a little to both sides: the picture must turn as little."""
    rng, worst, others = np.random.default_rng(6), 0.0, 0.0
    for _ in range(place.count(1000, 200)):
        lon, heading = rng.uniform(-math.pi, math.pi), rng.uniform(0, 2 * math.pi)
        lat = rng.choice((-1, 1)) * (math.pi / 2 - rng.choice((0.0, 1e-12, 1e-6, 0.5)))
        beside = [
            rotation(Pose(lon, lat, 0.0, heading, -math.pi / 2 + side * TURN_RAD / 2))
            for side in (-1, 1)
        ]
        up = geodesy.up(lon, lat)
        fixed = [looking_at(-one[2], up) for one in beside]
        worst, others = max(worst, angle(*beside)), max(others, angle(*fixed))
    note = f"at all latitudes, poles too; {TURN_RAD:g} rad from one side to the other"
    return Finding(90.0, worst / TURN_RAD, math.nan, 90.0, others / TURN_RAD, note)


def looking_at(forward: Floats, up: Floats) -> Floats:
    """Return the rotation of a camera that is held by an `up`, as is often done."""
    right = np.cross(forward, up)
    right /= max(float(np.linalg.norm(right)), 1e-300)
    return np.stack((right, np.cross(right, forward), -forward))


def angle(a: Floats, b: Floats) -> float:
    """Return the angle between two rotations, rad, exact also for small ones."""
    return 2.0 * math.asin(min(1.0, float(np.linalg.norm(a - b)) / math.sqrt(8.0)))


METRE = "pixels that a metre takes / pixels that the selection reckons with"
ROWS = (
    Row(
        "field of view, ground",
        "too little detail at the picture's edge: focal length / distance alone",
        "vertical field of view, degrees",
        "pixels of a metre of error / pixels that the selection reckons with",
        ROUNDED,
        field_of_ground,
    ),
    Row(
        "field of view, buildings",
        "too little detail at the picture's edge: focal length / distance alone",
        "vertical field of view, degrees",
        METRE,
        1.0,
        field,
    ),
    Row(
        "aspect, buildings",
        "too little detail at the picture's edge: focal length / distance alone",
        "longer side / shorter side of the picture",
        METRE,
        1.0,
        aspect,
    ),
    Row(
        "straight down",
        "the picture spins when the view passes the vertical: a camera held by its up",
        "how far the view is turned down, degrees",
        "angle by which the picture turns / angle by which the view does",
        1.001,
        turning,
    ),
)
