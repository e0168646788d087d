# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from tiles import bounds, cells, geodesy

PER_BOX = 100


def boxes(
    rng: np.random.Generator, count: int = 300
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random cells of all levels, among them all roots and many at poles, with heights."""
    level = rng.integers(0, cells.MAX_LEVEL + 1, count)
    level[:32] = 0
    row = np.minimum((rng.random(count) * (4 << level)).astype(np.int64), (4 << level) - 1)
    col = (rng.random(count) * (8 << level)).astype(np.int64)
    row[:32], col[:32] = np.divmod(np.arange(32), 8)
    row[32:64] = np.where(np.arange(32) % 2, 0, (4 << level[32:64]) - 1)
    low = rng.uniform(-11_000, 3_000, count)
    high = low + rng.choice([0.0, 1.0, 500.0, 9_000.0, 2e6], count)
    return cells.from_global(level, row, col), low, high


def samples(
    rng: np.random.Generator, cell: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Points of each box, (n, PER_BOX, 3): anywhere, on faces, edges and corners."""
    west, south, east, north = (side[:, None] for side in cells.bounds_rad(cell))
    u, v, w = np.clip(rng.uniform(-0.4, 1.4, (3, len(cell), PER_BOX)), 0.0, 1.0)
    height = low[:, None] + w * (high - low)[:, None]
    lon, lat = west + u * (east - west), south + v * (north - south)
    return geodesy.to_ecef(lon, lat, height)


def test_every_point_of_a_cell_is_inside_its_upright_box(rng: np.random.Generator) -> None:
    cell, low, high = boxes(rng)
    centre, radius = bounds.sphere_of(cell, low, high)
    half = bounds.half_sides_of(cell, low, high, centre)
    up = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    east = np.cross((0.0, 0.0, 1.0), up)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    axes = np.stack((east, np.cross(up, east), up), axis=1)
    away = samples(rng, cell, low, high) - centre[:, None]
    side = np.abs(np.einsum("nij,npj->npi", axes, away))
    assert (side <= half[:, None] + 1e-6).all()
    small = cells.level(cell) > 3
    flat = small & (high - low < radius / 10)
    assert (side.max(axis=1) > 0.8 * half)[small, :2].mean() > 0.95
    assert (half[flat, 2] < 0.2 * radius[flat]).all()
    assert flat.sum() > 30


def test_every_point_of_a_box_is_inside_its_sphere(rng: np.random.Generator) -> None:
    cell, low, high = boxes(rng)
    centre, radius = bounds.sphere_of(cell, low, high)
    reach = np.linalg.norm(samples(rng, cell, low, high) - centre[:, None], axis=-1)
    assert reach.size > 10_000
    assert (reach <= radius[:, None]).all()


def test_the_sphere_touches_the_box(rng: np.random.Generator) -> None:
    cell, low, high = boxes(rng)
    centre, radius = bounds.sphere_of(cell, low, high)
    west, south, east, north = cells.bounds_rad(cell)
    corners = [
        geodesy.to_ecef(lon, lat, height)
        for lon in (west, east)
        for lat in (south, north)
        for height in (low, high)
    ]
    reach = np.linalg.norm(np.stack(corners) - centre, axis=-1).max(axis=0)
    assert (radius - reach <= 2e-6 + 1e-11 * radius).all()


def smallest_radius(points: np.ndarray, turns: int = 400) -> np.ndarray:
    """Radius of the smallest sphere around each point set (Badoiu and Clarkson)."""
    centre = points.mean(axis=1)
    best = np.full(len(points), np.inf)
    for turn in range(turns):
        reach = np.linalg.norm(points - centre[:, None], axis=-1)
        best = np.minimum(best, reach.max(axis=1))
        far = points[np.arange(len(points)), reach.argmax(axis=1)]
        centre = centre + (far - centre) / (turn + 2)
    return best


def test_no_sphere_is_much_smaller(rng: np.random.Generator) -> None:
    cell, low, high = boxes(rng)
    _, radius = bounds.sphere_of(cell, low, high)
    best = smallest_radius(samples(rng, cell, low, high))
    assert (radius <= 1.1 * best + 2e-6).all()


@pytest.mark.parametrize("level", range(5))
def test_no_edge_of_a_shallow_cell_bulges_out_of_its_sphere(level: int) -> None:
    row, col = np.divmod(np.arange(32 * 4**level), 8 << level)
    cell = cells.from_global(level, row, col)[col < 2]
    centre, radius = bounds.sphere_of(cell, -11_000.0, 9_000.0)
    west, south, east, north = (side[:, None] for side in cells.bounds_rad(cell))
    share = np.linspace(0, 1, 33)
    along, up = west + share * (east - west), south + share * (north - south)
    for lon, lat in ((along, south), (along, north), (west, up), (east, up)):
        edge = geodesy.to_ecef(lon, lat, np.array([[[-11_000.0]], [[9_000.0]]]))
        reach = np.linalg.norm(edge - centre[:, None], axis=-1)
        assert (reach <= radius[:, None]).all()


def test_a_polar_cell_holds_the_pole() -> None:
    for level in (0, 3, 12, 28):
        cell = cells.cell_at(1.0, math.pi / 2, level)
        centre, radius = bounds.sphere_of(cell, 0.0, 0.0)
        pole = geodesy.to_ecef(0.0, math.pi / 2, 0.0)
        assert np.linalg.norm(pole - centre) <= radius


def test_shapes_follow_the_cells() -> None:
    centre, radius = bounds.sphere_of(int(cells.make(3, 4, 5, 6)), 0.0, 10.0)
    assert centre.shape == (3,)
    assert np.ndim(radius) == 0
    ids = cells.make(3, 4, np.arange(6).reshape(2, 3), 1)
    centre, radius = bounds.sphere_of(ids, 0.0, 10.0)
    assert centre.shape == (2, 3, 3)
    assert radius.shape == (2, 3)
