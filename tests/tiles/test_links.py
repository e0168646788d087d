# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tiles.places import uv_in_cell
from tiles import cells, geodesy, links

GEOD = pyproj.Geod(ellps="WGS84")
SOUTH, EAST, NORTH, WEST = range(4)


def every_cell(level: int) -> np.ndarray:
    row, col = np.divmod(np.arange(32 * 4**level), 8 << level)
    return cells.from_global(level, row, col)


@st.composite
def edge_loving_cells(draw: st.DrawFn) -> int:
    """Draw cells of all levels, often at zone corners, the antimeridian and poles."""
    level = draw(st.integers(0, cells.MAX_LEVEL))
    last = (1 << level) - 1
    side = st.one_of(st.just(0), st.just(last), st.integers(0, last))
    return int(cells.make(draw(st.integers(0, 31)), level, draw(side), draw(side)))


def touching(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compare rectangles in degrees: every a shares an edge with every b or not.

    Longitudes are compared the shorter way around. At a pole a cell also touches, over
    the pole, the cell of the opposite meridian.
    """
    tiny = 1e-9
    aw, as_, ae, an = (np.degrees(side)[:, None] for side in cells.bounds_rad(a))
    bw, bs, be, bn = (np.degrees(side)[None, :] for side in cells.bounds_rad(b))
    apart = np.abs((aw + ae) / 2 - (bw + be) / 2)
    apart = np.minimum(apart, 360 - apart)
    shared_lon = (ae - aw + be - bw) / 2 - apart
    shared_lat = np.minimum(an, bn) - np.maximum(as_, bs)
    beside = (shared_lat > -tiny) & (shared_lon > -tiny)
    pole = ((an > 90 - tiny) & (bn > 90 - tiny)) | ((as_ < -90 + tiny) & (bs < -90 + tiny))
    columns = (180 - apart) / (ae - aw)
    along = beside & ((shared_lat > tiny) | (shared_lon > tiny))
    return along | (pole & (columns < 0.1))


@pytest.mark.parametrize("level", range(5))
def test_neighbours_are_the_cells_that_touch_along_an_edge(level: int) -> None:
    ids = np.sort(every_cell(level))
    for part in np.array_split(ids, max(1, len(ids) // 512)):
        itself, expected = part[:, None] == ids[None, :], touching(part, ids)
        ours = np.zeros_like(expected)
        found = np.searchsorted(ids, links.edge_neighbours(part))
        np.put_along_axis(ours, found, values=True, axis=1)
        assert np.array_equal(ours, expected & ~itself)


@pytest.mark.parametrize("level", range(5))
def test_every_cell_has_four_different_neighbours_that_know_it(level: int) -> None:
    ids = every_cell(level)
    across = links.edge_neighbours(ids)
    assert np.isin(across, ids).all()
    ordered = np.sort(np.concatenate((across, ids[:, None]), axis=1), axis=1)
    assert (np.diff(ordered, axis=1) > 0).all()
    assert (links.edge_neighbours(across) == ids[:, None, None]).any(axis=-1).all()


@given(edge_loving_cells())
def test_deep_neighbours_are_different_touch_and_know_the_cell(cell: int) -> None:
    across = links.edge_neighbours(cell)
    assert len({cell, *across.tolist()}) == 5
    assert (cells.level(across) == cells.level(cell)).all()
    assert (links.edge_neighbours(across) == cell).any(axis=-1).all()
    assert touching(np.array([cell]), across).all()


@given(edge_loving_cells())
def test_a_neighbour_shares_the_edge_that_its_name_says(cell: int) -> None:
    west, south, east, north = cells.bounds_rad(cell)
    w, s, e, n = cells.bounds_rad(links.edge_neighbours(cell))
    assert w[EAST] == (east if east < math.pi else -math.pi)
    assert e[WEST] == (west if west > -math.pi else math.pi)
    assert s[NORTH] == north or north == math.pi / 2 == n[NORTH]
    assert n[SOUTH] == south or south == -math.pi / 2 == s[SOUTH]


@given(edge_loving_cells())
def test_going_there_and_back_ends_where_it_began(cell: int) -> None:
    south, east, north, west = links.edge_neighbours(cell)
    assert links.edge_neighbours(east)[WEST] == cell
    assert links.edge_neighbours(west)[EAST] == cell
    _, low, _, high = cells.bounds_rad(cell)
    assert links.edge_neighbours(north)[SOUTH if high < math.pi / 2 else NORTH] == cell
    assert links.edge_neighbours(south)[NORTH if low > -math.pi / 2 else SOUTH] == cell


@pytest.mark.parametrize("lat", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("level", [0, 1, 5, 20, 28])
def test_over_a_pole_lies_the_opposite_meridian(lat: float, level: int) -> None:
    lon = 0.1 + np.arange(8) * math.pi / 4
    over = links.edge_neighbours(cells.cell_at(lon, lat, level))
    opposite = cells.cell_at(lon + math.pi, lat, level)
    assert np.array_equal(over[:, NORTH if lat > 0 else SOUTH], opposite)


def test_all_edges_of_all_zones_are_crossed_to_the_zone_beside() -> None:
    zone = np.arange(32)
    across = cells.zone(links.edge_neighbours(cells.make(zone, 0, 0, 0)))
    row, col = zone // 8, zone % 8
    assert np.array_equal(across[:, EAST], row * 8 + (col + 1) % 8)
    assert np.array_equal(across[:, WEST], row * 8 + (col - 1) % 8)
    opposite = row * 8 + (col + 4) % 8
    assert np.array_equal(across[:, NORTH], np.where(row < 3, zone + 8, opposite))
    assert np.array_equal(across[:, SOUTH], np.where(row > 0, zone - 8, opposite))


@given(edge_loving_cells(), st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_linked_cells_are_the_cell_and_those_around_the_nearest_corner(
    cell: int, u: float, v: float
) -> None:
    west, south, east, north = cells.bounds_rad(cell)
    level = int(cells.level(cell))
    point = west + u * (east - west), south + v * (north - south)
    # Decide by the point's own fractions: rounding moves it at the deepest levels.
    got_u, got_v = uv_in_cell(cell, *point)
    if min(abs(got_u - 0.5), abs(got_v - 0.5)) < 1e-6:
        return
    across, along = EAST if got_u > 0.5 else WEST, NORTH if got_v > 0.5 else SOUTH
    around = links.edge_neighbours(cell)
    side, above = around[across], around[along]
    corner = links.edge_neighbours(side)[along]
    assert links.linked_cells(*point, level).tolist() == [cell, side, above, corner]


def test_linked_cells_keep_the_shape_and_are_four_different_cells() -> None:
    lon, lat = np.meshgrid(np.linspace(-4, 4, 50), np.linspace(-1.5707, 1.5707, 40))
    for level in (0, 3, 28):
        linked = links.linked_cells(lon, lat, level)
        assert linked.shape == (40, 50, 4)
        assert (np.diff(np.sort(linked, axis=-1), axis=-1) > 0).all()


def homes(rng: np.random.Generator, level: int, count: int = 3_000) -> np.ndarray:
    """Pick cells with a width: random ones, zone corners, antimeridian, high latitudes."""
    last_row, last_col = (4 << level) - 1, (8 << level) - 1
    row = rng.integers(1, last_row, count)
    col = rng.integers(0, last_col + 1, count)
    quarter = count // 4
    row[:quarter] = rng.choice([1, 2, last_row - 2, last_row - 1], quarter)
    corner = slice(quarter, 2 * quarter)
    row[corner] = (rng.integers(1, 4, quarter) << level) - rng.integers(0, 2, quarter)
    col[corner] = (rng.integers(0, 9, quarter) << level) - rng.integers(0, 2, quarter)
    col[2 * quarter : 3 * quarter] = rng.choice([0, last_col], quarter)
    return cells.from_global(level, row, col)


def disc_points(
    rng: np.random.Generator, home: np.ndarray, radius_m: np.ndarray, spots: int = 24
) -> tuple[np.ndarray, np.ndarray]:
    """Return points, (n, spots) radians, of a disc around a random centre in each cell."""
    west, south, east, north = (side[:, None] for side in cells.bounds_rad(home))
    # A third of the centres lie on edges and corners, where reaching out is easiest.
    place = np.clip(rng.uniform(-0.25, 1.25, (2, len(home), 1)), 1e-9, 1 - 1e-9)
    lon, lat = west + place[0] * (east - west), south + place[1] * (north - south)
    azimuth = np.broadcast_to(np.arange(spots) * 360 / spots, (len(home), spots))
    # Geod is good to a few nanometres, which is no object's.
    radius_m = np.maximum(radius_m - 1e-8, 0.0)
    reach = radius_m[:, None] * np.where(np.arange(spots) % 3 == 2, 0.7, 1.0)
    lon, lat = (np.broadcast_to(np.degrees(x), azimuth.shape) for x in (lon, lat))
    lon, lat, _ = GEOD.fwd(lon, lat, azimuth, reach)
    return np.radians(lon), np.radians(lat)


@pytest.mark.parametrize("level", [1, 2, 4, 8, 14, 17, 22])
def test_every_object_that_reaches_a_point_lives_in_a_linked_cell(
    rng: np.random.Generator, level: int
) -> None:
    home = homes(rng, level)
    lon, lat = disc_points(rng, home, geodesy.cell_width_m(home) / 2)
    linked = links.linked_cells(lon, lat, level)
    assert (linked == home[:, None, None]).any(axis=-1).all()


def test_an_object_wider_than_its_cell_is_missed_by_the_linked_cells(
    rng: np.random.Generator,
) -> None:
    home = homes(rng, 8)
    lon, lat = disc_points(rng, home, geodesy.cell_width_m(home) * 0.55)
    linked = links.linked_cells(lon, lat, 8)
    assert not (linked == home[:, None, None]).any(axis=-1).all()
