# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tiles import cells, geodesy
from tiles.frames import WGS84_A_M, WGS84_B_M, Ecef

TO_ECEF = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
TO_GEODETIC = pyproj.Transformer.from_crs(4978, 4979, always_xy=True)
GEOD = pyproj.Geod(ellps="WGS84")
HEIGHTS = {(-11_000.0, 9_000.0): 1e-8, (-1e5, 1e6): 1e-8, (1e6, 2e7): 1e-6}


def points(
    rng: np.random.Generator, heights: tuple[float, float], count: int = 20_000
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    lon = rng.uniform(-math.pi, math.pi, count)
    lat = rng.uniform(-math.pi / 2, math.pi / 2, count)
    near = math.pi / 2 - 10.0 ** rng.uniform(-14, -1, count // 10)
    lat[: len(near)] = near * rng.choice([-1, 1], len(near))
    lat[-100:] = np.repeat([math.pi / 2, -math.pi / 2, 0.0, 1e-12], 25)
    return lon, lat, rng.uniform(*heights, count)


@pytest.mark.parametrize("heights", HEIGHTS)
def test_positions_agree_with_proj(
    rng: np.random.Generator, heights: tuple[float, float]
) -> None:
    lon, lat, height = points(rng, heights)
    ours = geodesy.to_ecef(lon, lat, height)
    theirs = np.stack(TO_ECEF.transform(np.degrees(lon), np.degrees(lat), height), -1)
    assert np.linalg.norm(ours - theirs, axis=-1).max() < 3e-8


@pytest.mark.parametrize(("heights", "accuracy_m"), HEIGHTS.items())
def test_projs_positions_are_led_back_to_where_they_came_from(
    rng: np.random.Generator, heights: tuple[float, float], accuracy_m: float
) -> None:
    lon, lat, height = points(rng, heights)
    # Through degrees and back, so that rounding of the degrees is not counted as ours.
    lon, lat = np.radians(np.degrees(lon)), np.radians(np.degrees(lat))
    theirs = np.stack(TO_ECEF.transform(np.degrees(lon), np.degrees(lat), height), -1)
    got_lon, got_lat, got_height = geodesy.to_geodetic(Ecef(theirs))
    arm = WGS84_A_M + height
    east = np.sin(got_lon - lon) * np.cos(lat) * arm
    assert np.abs(east).max() < accuracy_m
    assert np.abs((got_lat - lat) * arm).max() < accuracy_m
    assert np.abs(got_height - height).max() < accuracy_m


def test_geodetic_coordinates_agree_with_proj_near_the_surface(
    rng: np.random.Generator,
) -> None:
    ecef = geodesy.to_ecef(*points(rng, (-500.0, 9_000.0)))
    x, y, z = ecef.T
    lon, lat, height = TO_GEODETIC.transform(x, y, z)
    ours = geodesy.to_geodetic(ecef)
    off_axis = np.hypot(ecef[:, 0], ecef[:, 1]) > 1.0
    assert np.abs(np.degrees(ours[0]) - lon)[off_axis].max() < 1e-6
    assert np.abs(np.degrees(ours[1]) - lat).max() * 111_000 < 1e-6
    # PROJ's inverse takes one step of Bowring's and divides by the cosine of the latitude,
    # which costs it some micrometres beside the poles; its forward way is the exact test.
    assert np.abs(ours[2] - height).max() < 1e-5


@pytest.mark.parametrize("height_m", [-11_000.0, 0.0, 10.0, 2e7])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_axis_is_the_pole(height_m: float, side: int) -> None:
    z = side * (WGS84_B_M + height_m)
    lon, lat, height = geodesy.to_geodetic(Ecef(np.array([0.0, 0.0, z])))
    assert lon == 0.0
    assert lat == side * math.pi / 2
    assert height == pytest.approx(height_m, abs=1e-8)


def test_the_centre_of_the_earth_gives_finite_numbers() -> None:
    assert np.isfinite(geodesy.to_geodetic(Ecef(np.zeros(3)))).all()


def test_the_kernel_gives_what_the_arrays_give(rng: np.random.Generator) -> None:
    lon, lat, height = points(rng, (-1e4, 1e7), 200)
    ours = [geodesy.ecef_of(*point) for point in zip(lon, lat, height, strict=True)]
    assert np.allclose(ours, geodesy.to_ecef(lon, lat, height), rtol=1e-15, atol=5e-9)
    back = [geodesy.geodetic_of(*point) for point in ours]
    assert np.allclose(back, np.transpose([lon, lat, height]), rtol=1e-14, atol=5e-9)


def test_shapes_broadcast() -> None:
    assert geodesy.to_ecef(0.1, 0.2, 3.0).shape == (3,)
    grid = geodesy.to_ecef(np.zeros((5, 1)), np.zeros(4), 0.0)
    assert grid.shape == (5, 4, 3)
    assert [part.shape for part in geodesy.to_geodetic(grid)] == [(5, 4)] * 3
    assert geodesy.enu_axes(np.zeros((5, 1)), np.zeros(4)).shape == (5, 4, 3, 3)
    assert geodesy.up(np.zeros((5, 1)), np.zeros(4)).shape == (5, 4, 3)


def test_the_axes_are_right_handed_unit_vectors(rng: np.random.Generator) -> None:
    axes = geodesy.enu_axes(*points(rng, (0, 1), 1_000)[:2])
    assert np.allclose(axes @ np.swapaxes(axes, -1, -2), np.eye(3), atol=1e-15)
    assert np.allclose(np.linalg.det(axes), 1.0)


def test_east_north_and_up_are_where_a_step_leads(rng: np.random.Generator) -> None:
    lon, lat = rng.uniform(-3, 3, 500), rng.uniform(-1.4, 1.4, 500)
    axes, step = geodesy.enu_axes(lon, lat), 1e-4
    here = geodesy.to_ecef(lon, lat, 0.0)
    for axis, there in enumerate(
        (
            geodesy.to_ecef(lon + step, lat, 0.0),
            geodesy.to_ecef(lon, lat + step, 0.0),
            geodesy.to_ecef(lon, lat, 100.0),
        )
    ):
        moved = (axes @ (there - here)[..., np.newaxis])[..., 0]
        moved /= np.linalg.norm(moved, axis=-1, keepdims=True)
        assert np.allclose(moved, np.eye(3)[axis], atol=2e-3)
    assert np.array_equal(geodesy.up(lon, lat), axes[:, 2])


def geod_area_m2(cell: int, per_edge: int = 400) -> float:
    """Area by Karney's geodesics; parallels in many short pieces, meridians in one."""
    west, south, east, north = np.degrees(cells.bounds_rad(cell))
    along = np.linspace(west, east, per_edge)
    lons = np.concatenate((along, along[::-1]))
    lats = np.repeat((south, north), per_edge)
    return abs(GEOD.polygon_area_perimeter(lons, lats)[0])


@pytest.mark.parametrize("level", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("zone", [3, 14, 17, 31])
def test_the_true_edge_squared_is_the_area_by_geodesics(zone: int, level: int) -> None:
    last = (1 << level) - 1
    for row in {0, last // 2, last}:
        cell = int(cells.make(zone, level, row, last))
        expected = geod_area_m2(cell)
        assert float(geodesy.cell_edge_m(cell)) ** 2 == pytest.approx(expected, rel=1e-5)


def test_the_zones_together_have_the_area_of_the_ellipsoid() -> None:
    e = math.sqrt(1 - (WGS84_B_M / WGS84_A_M) ** 2)
    whole = 2 * math.pi * (WGS84_A_M**2 + WGS84_B_M**2 * math.atanh(e) / e)
    for level in range(5):
        row, col = np.divmod(np.arange(32 * 4**level), 8 << level)
        edge = geodesy.cell_edge_m(cells.from_global(level, row, col))
        assert (edge**2).sum() == pytest.approx(whole, rel=1e-13)


@given(st.integers(0, 31), st.integers(0, 27), st.data())
def test_the_children_together_have_their_parents_area(
    zone: int, level: int, data: st.DataObject
) -> None:
    side = st.one_of(
        st.just(0), st.just((1 << level) - 1), st.integers(0, (1 << level) - 1)
    )
    cell = cells.make(zone, level, data.draw(side), data.draw(side))
    parts = geodesy.cell_edge_m(cells.children(cell)) ** 2
    assert parts.sum() == pytest.approx(geodesy.cell_edge_m(cell) ** 2, rel=1e-12)


@pytest.mark.parametrize("level", [6, 10, 17, 24, 28])
@pytest.mark.parametrize("lat_deg", [-89.9, -60.0, -1.0, 0.5, 6.5, 7.5, 45.0, 80.0])
def test_the_width_is_the_shorter_way_across_the_poleward_half(
    lat_deg: float, level: int
) -> None:
    cell = cells.cell_at(0.3, math.radians(lat_deg), level)
    west, south, east, north = cells.bounds_rad(cell)
    poleward = north if north > 0 else south
    a, b = geodesy.to_ecef(np.array([west, east]), poleward, 0.0)
    across = float(np.linalg.norm(a - b))
    a, b = geodesy.to_ecef(west, np.array([south, north]), 0.0)
    upward = float(np.linalg.norm(a - b))
    # The meridian's straight line differs from its lower bound by its curvature alone.
    assert float(geodesy.cell_width_m(cell)) == pytest.approx(
        min(across, upward), rel=2e-4 if upward < across else 1e-7, abs=2e-9
    )
    assert float(geodesy.cell_width_m(cell)) <= min(across, upward) + 2e-9


def test_a_cell_at_a_pole_has_no_width_and_all_others_have_one() -> None:
    for level in (0, 1, 2, 9, 28):
        rows = np.unique(np.clip([0, 1, 2, (4 << level) // 2], 0, (4 << level) - 1))
        rows = np.concatenate((rows, (4 << level) - 1 - rows))
        width = geodesy.cell_width_m(cells.from_global(level, rows, 3))
        polar = (rows == 0) | (rows == (4 << level) - 1)
        assert np.array_equal(width == 0.0, polar)
        assert (width >= 0.0).all()
