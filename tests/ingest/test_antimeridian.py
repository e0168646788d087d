# SPDX-License-Identifier: Apache-2.0
"""Footprints astride longitude 180 become one, whichever way the file cuts them."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ingest.antimeridian import unwrapped
from ingest.repair import area_m2, repair

HOUSE = shapely.Polygon(
    [(179.9999, -17), (180.0002, -17), (180.0002, -16.9998), (179.9999, -16.9999)],
    [[(179.99995, -16.99995), (180.0001, -16.99995), (180.0001, -16.9999)]],
)


def array(*shapes: shapely.Geometry | None) -> np.ndarray:
    made = np.empty(len(shapes), object)
    made[:] = shapes
    return made


def jumping(shape: shapely.Geometry) -> shapely.Geometry:
    """Longitudes beyond 180 written as those from -180."""

    def wrapped(xy: np.ndarray) -> np.ndarray:
        return np.column_stack(
            (np.where(xy[:, 0] > 180, xy[:, 0] - 360, xy[:, 0]), xy[:, 1])
        )

    return shapely.transform(shape, wrapped)


def cut(shape: shapely.Geometry) -> shapely.Geometry:
    """As RFC 7946 has it: one part on each side."""
    east = shapely.intersection(shape, shapely.box(170, -90, 180, 90))
    west = shapely.intersection(shape, shapely.box(180, -90, 190, 90))
    west = shapely.transform(west, lambda xy: xy - np.array((360, 0)))
    return shapely.MultiPolygon([*shapely.get_parts(east), *shapely.get_parts(west)])


@pytest.mark.parametrize("written", [jumping, cut])
def test_a_footprint_astride_180_is_one(written: object) -> None:
    shape = written(HOUSE)  # type: ignore[operator]
    found = repair(array(shape, shapely.box(10, 0, 10.0001, 0.0001)))
    assert found.reason.tolist() == ["", ""]
    assert found.was_repaired.tolist() == [True, False]
    one = found.polygon[0]
    assert shapely.get_num_geometries(one) == 1
    middle = (one.bounds[0] + one.bounds[2]) / 2
    assert -180 <= middle < 180
    back = shapely.transform(one, lambda xy: xy + np.array((360 if middle < 0 else 0, 0)))
    assert shapely.symmetric_difference(back, HOUSE).area < 1e-12
    assert area_m2(found.polygon)[0] == pytest.approx(area_m2(array(HOUSE))[0])


@given(
    st.floats(-179.9, 179.9), st.floats(-80, 80), st.integers(-1, 1), st.floats(1e-5, 1e-3)
)
def test_every_longitude_ends_in_one_turn_at_the_same_place(
    lon: float, lat: float, turns: int, size: float
) -> None:
    shape = shapely.box(lon, lat, lon + size, lat + size)
    there = shapely.transform(shape, lambda xy: xy + np.array((360 * turns, 0)))
    if not -360 <= there.bounds[0] <= there.bounds[2] <= 360:
        return
    found, joined = unwrapped(array(there))
    assert not joined[0]
    np.testing.assert_allclose(found[0].bounds, shape.bounds, atol=1e-9)


def test_parts_apart_stay_apart_and_what_is_missing_is_left() -> None:
    two = shapely.MultiPolygon(
        [shapely.box(179.999, 0, 179.9995, 1e-3), shapely.box(-179.9995, 0, -179.999, 1e-3)]
    )
    found, joined = unwrapped(array(two, None, shapely.Polygon()))
    assert joined.tolist() == [True, False, False]
    assert shapely.get_num_geometries(found[0]) == 2
    assert found[0].bounds == pytest.approx(
        (-180.001, 0, -179.999, 1e-3), abs=1e-9
    ) or found[0].bounds == pytest.approx((179.999, 0, 180.001, 1e-3), abs=1e-9)


def test_a_ring_around_a_pole_is_named_and_one_beside_it_is_built() -> None:
    lon = np.arange(-180, 180, 20.0)
    around = shapely.Polygon(np.column_stack((lon, np.full(len(lon), -89.9999))))
    beside = shapely.box(30, -89.9999, 60, -89.9997)
    found = repair(array(around, beside))
    assert found.reason.tolist() == ["around a pole, or half the earth", ""]
