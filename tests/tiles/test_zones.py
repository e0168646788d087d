# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tiles import zones

ANY_LON = st.floats(-40.0, 40.0)


def test_zones_count_east_from_the_antimeridian_and_north_from_the_south_pole() -> None:
    zone = np.arange(zones.COUNT)
    row, col = zones.row_col(zone)
    assert np.array_equal(zones.zone_of(row, col), zone)
    west, south, east, north = np.degrees(zones.grid_bounds_rad(0, row, col))
    assert np.allclose(west, -180 + 45 * (zone % 8))
    assert np.allclose(south, -90 + 45 * (zone // 8))
    assert np.allclose(east - west, 45)
    assert np.allclose(north - south, 45)


def test_the_zones_end_exactly_at_the_poles_and_the_antimeridian() -> None:
    west, south, east, north = zones.grid_bounds_rad(
        0, *zones.row_col(np.arange(zones.COUNT))
    )
    assert (west.min(), south.min()) == (-math.pi, -math.pi / 2)
    assert (east.max(), north.max()) == (math.pi, math.pi / 2)


@given(ANY_LON)
def test_a_wrapped_longitude_is_in_range_and_the_same_direction(lon: float) -> None:
    wrapped = float(zones.wrap_lon(lon))
    assert -math.pi <= wrapped < math.pi
    assert math.sin(wrapped) == pytest.approx(math.sin(lon), abs=1e-13)
    assert math.cos(wrapped) == pytest.approx(math.cos(lon), abs=1e-13)
    assert lon == wrapped or not -math.pi <= lon < math.pi


def test_a_longitude_one_bit_outside_wraps_to_the_other_side() -> None:
    assert float(zones.wrap_lon(math.pi)) == -math.pi
    below = float(zones.wrap_lon(np.nextafter(-math.pi, -4.0)))
    assert -math.pi <= below < math.pi
    assert abs(math.sin(below)) < 1e-15


@given(st.integers(0, 29), st.data())
def test_a_point_on_a_grid_line_is_in_the_square_north_east_of_it(
    level: int, data: st.DataObject
) -> None:
    row = data.draw(st.integers(0, (4 << level) - 1))
    col = data.draw(st.integers(0, (8 << level) - 1))
    west, south, east, north = zones.grid_bounds_rad(level, row, col)
    assert np.array_equal(zones.grid_at(west, south, level), (row, col))
    inside = np.nextafter(east, -9.0), np.nextafter(north, -9.0)
    assert np.array_equal(zones.grid_at(*inside, level), (row, col))
    assert zones.grid_bounds_rad(level, row + 1, col + 1)[:2] == (east, north)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_longitude_that_is_no_number_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="finite"), np.errstate(invalid="ignore"):
        zones.grid_at(np.array([0.0, bad]), 0.0, 3)
    with pytest.raises(ValueError, match="finite"):
        zones.grid_at(0.0, math.nan, 3)
